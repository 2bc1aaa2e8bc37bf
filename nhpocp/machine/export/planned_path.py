"""The path of a plan, integrated again, with the exact derivatives of all that moves along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.errors import InvalidProblemError
from nhpocp.solution import Solution
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.replay import replay

TABLE = 2_000_000  # numbers of a table of basis functions
SAME_TIME = 1e-12  # of the horizon: a time so near to a jump of the control is after it


@dataclass(frozen=True)
class Sampled:
    """A plan at its own times (k,): x, ξ and dξ/dt, u and du/dt, and lengths of legs with both derivatives.

    states: packed points (k, size); velocities, accelerations: tangent vectors (k, dimension); controls,
    control_rates: (k, inputs); lengths, speeds, length_rates: (k, legs), none of systems without legs.
    """

    states: Array
    velocities: Array
    accelerations: Array
    controls: Array
    control_rates: Array
    lengths: Array
    leg_speeds: Array
    leg_accelerations: Array


class PlannedPath:
    """x(t) of a solution's control, from the problem's start, by the integrator of verification.

    Errors: `InvalidProblemError` for a path that does not come to its end.
    """

    def __init__(self, solution: Solution) -> None:
        self.problem, self.control = solution.problem, solution.control
        self.system: Any = solution.problem.system
        numeric = NumericSystem(self.system)
        self._path = replay(numeric, self.control, self.problem.start_point, self.problem.scales.points)
        if self._path.stopped:
            reached, horizon = self._path.reached, self.control.horizon
            words = f"this motion ends at t={reached:.6g} of {horizon:.6g}: {self._path.stopped}"
            raise InvalidProblemError(f"{words}; there is nothing for a machine here")

    @property
    def horizon(self) -> float:
        """T of the plan [time]."""
        return self.control.horizon

    @cached_property
    def motors(self) -> list[int]:
        """Which of the lengths have a motor; none of systems without legs."""
        return motors_of(self.system)

    def sample(self, times: Array, before_jumps: Array | None = None) -> Sampled:
        """At times (k,) of the plan; at a jump of the control after it, or before it where `before_jumps` says so."""
        times = self._snapped(np.asarray(times, dtype=float))
        left = times >= self.horizon
        if before_jumps is not None:
            left = left | before_jumps
        controls = self._from_either_side(self.control, times, left)
        rates = self._from_either_side(self.control.derivative, times, left)
        states = self._path(times)
        values = call(mapped(self._derivatives, len(times)), states, controls, rates)
        velocities, accelerations, lengths, speeds, length_rates = (
            np.asarray(value).reshape(len(times), -1) for value in values
        )
        return Sampled(states, velocities, accelerations, controls, rates, lengths, speeds, length_rates)

    def drives(self, times: Array, before_jumps: Array | None = None) -> tuple[Array, Array]:
        """Speeds and their derivatives (k, drives) of the motors: of the legs, without any of the inputs."""
        at = self.sample(times, before_jumps)
        if self.motors:
            return at.leg_speeds[:, self.motors], at.leg_accelerations[:, self.motors]
        return at.controls, at.control_rates

    def _from_either_side(self, of: Callable[..., Array], times: Array, left: Array) -> Array:
        """`control` or `control.derivative` at times (k,), from the left where `left` says so, some at a time."""
        values = np.empty((len(times), len(self.control.coefficients)))
        some = max(1, TABLE // self.control.basis.size)
        for side, chosen in (("left", np.flatnonzero(left)), ("right", np.flatnonzero(~left))):
            for first in range(0, len(chosen), some):
                part = chosen[first : first + some]
                values[part] = of(times[part], side)
        return values

    def _snapped(self, times: Array) -> Array:
        """Times that differ from a jump, or from the end, by rounding alone are that time."""
        breaks = np.append(self.control.breakpoints, self.horizon)
        above = np.searchsorted(breaks, times)
        for place in (above - 1, above):
            near = breaks[np.clip(place, 0, len(breaks) - 1)]
            times = np.where(np.abs(times - near) <= SAME_TIME * self.horizon, near, times)
        return times

    @cached_property
    def _derivatives(self) -> ca.Function:
        """(x, u, du/dt) ↦ ξ, dξ/dt, l, dl/dt, d²l/dt², by the chain rule along ẋ."""
        space, inputs = self.system.state_space, self.system.input_space.size
        both, u_rate = ca.SX.sym("xu", space.size + inputs), ca.SX.sym("u_rate", inputs)
        x, u = both[: space.size], both[space.size :]
        velocity = ca.densify(ca.SX(self.system.velocity(x, u)))
        rate = ca.vertcat(ca.densify(self.system.rate(x, u)), u_rate)
        lengths = ca.SX(self.system.output("leg_lengths", x, u)) if self.motors else ca.SX(0, 1)
        speeds = ca.jtimes(lengths, both, rate)
        results = [velocity, ca.jtimes(velocity, both, rate), lengths, speeds, ca.jtimes(speeds, both, rate)]
        made = ca.Function("made", [both, u_rate], [ca.densify(result) for result in results])
        point, control = ca.SX.sym("x", space.size), ca.SX.sym("u", inputs)
        whole: Any = made(ca.vertcat(point, control), u_rate)  # CasADi's stubs know of a single result
        return ca.Function("derivatives", [point, control, u_rate], list(whole))


def motors_of(system: Any) -> list[int]:
    """Which of a system's leg lengths have a motor; none of systems without legs."""
    if "leg_lengths" not in (system.known_outputs or ()):
        return []
    legs = [leg for leg in getattr(system, "legs", ()) if not leg.pinned]
    return [i for i, leg in enumerate(legs) if leg.actuated]
