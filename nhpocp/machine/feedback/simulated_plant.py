"""A machine in the computer, by the equations of a system whose parameters need not be the model's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call
from nhpocp.declared import real
from nhpocp.errors import CallError, InvalidProblemError, expect, refuse
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.kept import kept
from nhpocp.machine.feedback.set_points import positions_function
from nhpocp.poses import checked_start
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

SERVO = 0.5  # of its lag, what a servo makes up in a step of the integration


class SimulatedPlant:
    """A `Plant` that moves by ẋ = f(x) + G(x) u of ``system``, and is measured with noise.

    Legs are driven so that their own lengths follow the commanded ones, u = ḋ + κ (d - l), and the pose moves by
    [Paper] eq. (3) of this machine's geometry. Systems without legs take inputs as they are, times ``gains``.
    system: with the machine's own parameters. start: the pose in which it stands, as a problem's. noise: standard
    deviation of every tangent number when it is measured [its unit]. gains: of inputs (m,), default 1. seed: of the
    noise. step: the longest of the integration [time].
    Errors: `InvalidProblemError` for a start that is none, or numbers that are none.
    """

    def __init__(
        self,
        system: System,
        start: Mapping[str, Any],
        *,
        noise: float = 0.0,
        gains: Sequence[float] | None = None,
        seed: int | Sequence[int] = 0,
        step: float = 0.005,
    ) -> None:
        expect(system, System, "a system such as ThreeUPU()", "SimulatedPlant.system")
        wrong: list[InvalidProblemError] = []
        values = checked_start(system.state_space, start, wrong)
        refuse(wrong)
        for name, number, least in (("noise", noise, 0.0), ("step", step, 1e-12)):
            if real(number, f"SimulatedPlant.{name}") < least:
                words = f"{number:g}; expected a number {'>= 0' if least == 0 else '> 0'}"
                raise InvalidProblemError(words, path=f"SimulatedPlant.{name}")
        self.system, self.noise, self.step = system, noise, step
        actuated = system.actuated()
        self._driven = actuated[0] if actuated else system
        self._follow, self._lengths = _servo(system, self._driven), positions_function(system)
        self._random = np.random.default_rng(seed)
        self._point = np.asarray(system.state_space.pack(values), dtype=float)
        inputs = self._driven.input_space.size
        self._gains = np.ones(inputs) if gains is None else np.asarray(gains, dtype=float)
        if self._gains.shape != (inputs,):
            raise CallError(f"{self._gains.size} numbers; expected {inputs}", path="SimulatedPlant.gains")
        self._offset: Array | float = 0.0  # of its own lengths from what it is told
        self._from: Array | None = None  # set-points when the next `advance` begins
        self._to: Array | None = None  # and when it ends

    @property
    def point(self) -> Array:
        """The packed state (size,) as it is, without noise."""
        return self.system.state_space.nearest(self._point)

    def measure(self) -> dict[str, Array]:
        """The state, every tangent number of it with noise."""
        space, point = self.system.state_space, self.point
        if self.noise:
            point = np.asarray(
                space.retract(point, self.noise * self._random.standard_normal(space.dimension))
            )
        return space.unpack(point)

    def command(self, set_points: Array) -> None:
        """Set-points (n,). Errors: `CallError` for another number of them, or what is not finite."""
        values = np.array(set_points, dtype=float)
        if values.shape != self._gains.shape or not np.isfinite(values).all():
            words = f"expected {self._gains.size} finite numbers, got {values}"
            raise CallError(words, path="SimulatedPlant.command")
        if self._lengths is None:
            self._from = self._to = self._gains * values
            return
        if self._to is None:  # homing
            self._offset = call(self._lengths, self._point)[0].ravel() - values
        own = values + self._offset
        self._from, self._to = own if self._to is None else self._to, own

    def advance(self, seconds: float) -> None:
        """Integrates by RK4. Errors: `ArithmeticError` where the machine comes to a singular pose."""
        if self._from is None or self._to is None:
            self._from = self._to = np.zeros(self._gains.shape)
            if self._lengths is not None:
                self.command(call(self._lengths, self._point)[0].ravel())
        steps = ceil(seconds / self.step * (1 - 1e-9))
        begun, change = self._from, (self._to - self._from)
        for k in range(steps):
            ends = begun + k / steps * change, begun + (k + 1) / steps * change
            self._point = call(self._follow, self._point, *ends, np.array([seconds / steps]))[0].ravel()
        if not np.isfinite(self._point).all():
            raise ArithmeticError("the machine came to a singular pose")
        self._from = self._to


@dataclass(frozen=True)
class KinematicWorkshop:
    """A `Workshop` of simulated plants; start, noise, step: as of `SimulatedPlant`."""

    start: Mapping[str, Any]
    noise: float = 0.0
    step: float = 0.005

    def made(self, system: System, gains: Array | None, seed: int | Sequence[int]) -> SimulatedPlant:
        values = None if gains is None else gains.tolist()
        return SimulatedPlant(system, self.start, noise=self.noise, gains=values, seed=seed, step=self.step)

    @property
    def facts(self) -> dict[str, Any]:
        return {"kind": "kinematic", "noise": self.noise}


@kept(most=16)
def _servo(system: System, driven: System) -> ca.Function:
    """(x, set-points before and after, h) ↦ x after a step of RK4; of inputs the latter are held."""
    x, h = ca.SX.sym("x", system.state_space.size), ca.SX.sym("h")
    before, after = (ca.SX.sym(name, driven.input_space.size) for name in ("before", "after"))
    lengths, rate = positions_function(system), numeric_system(driven).rate_function

    def moved(point: ca.SX, place: int) -> ca.SX:
        if lengths is None:
            return rate(point, after)
        wanted = before + CLASSICAL.fractions[place] * (after - before)
        return rate(point, (after - before + SERVO * (wanted - lengths(point))) / h)

    return ca.Function("servo", [x, before, after, h], [CLASSICAL.step(moved, x, h)[0]])
