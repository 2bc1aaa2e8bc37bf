"""The path that a machine really made, where it is in a computer, and how it kept the problem's bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import PPoly

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.constraints.bound import BoundReport, check_bounds
from nhpocp.machine.feedback.guarded_plant import GuardedPlant
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import DISTANCE, System
from nhpocp.verification.distances import distance_report


@dataclass(frozen=True, eq=False)
class ExecutedPath:
    r"""Where a machine was at times of a run, and between them under inputs that are held from one to the next:

        uᵢ = argmin |f(x̄) + G(x̄) u - ẋ̄|,   x̄ = (xᵢ + xᵢ₊₁) / 2,   ẋ̄ = (xᵢ₊₁ - xᵢ) / (tᵢ₊₁ - tᵢ)

    Each piece is the cubic with the ends xᵢ, xᵢ₊₁ and the rates there under uᵢ.
    problem: whose bounds count. system: with the machine's own parameters. times (k,): of the machine, since the run
    began. points (k, size): packed states.
    """

    problem: PlanningProblem
    system: System
    times: Array
    points: Array

    def __call__(self, times: Array) -> Array:
        """States (k, size) at times (k,) between the first and the last."""
        return np.asarray(self._pieces(times))

    @cached_property
    def inputs(self) -> Array:
        """uᵢ (k - 1, m); not finite where the equations are not."""
        middles = 0.5 * (self.points[1:] + self.points[:-1])
        rates = np.diff(self.points, axis=0) / np.diff(self.times)[:, None]
        size = self.system.input_space.size
        drift = self._rates(middles, np.zeros((len(middles), size)))
        columns = [self._rates(middles, np.tile(unit, (len(middles), 1))) - drift for unit in np.eye(size)]
        matrices, inputs = np.stack(columns, axis=2), np.full((len(middles), size), np.nan)
        good = np.isfinite(matrices).all(axis=(1, 2)) & np.isfinite(drift).all(axis=1)
        inputs[good] = np.einsum("kij,kj->ki", np.linalg.pinv(matrices[good]), (rates - drift)[good])
        return inputs

    @cached_property
    def bounds(self) -> tuple[BoundReport, ...]:
        """How the problem's bounds were kept; of rates by their means between two times.

        A bound on accelerations has no report: commands that come one by one have none to speak of. Nor has one on what
        is nowhere finite.
        """
        reports = []
        with np.errstate(all="ignore"):
            for bound in self.problem.bounds:
                if bound.quantity == DISTANCE:
                    reports.append(distance_report(bound, self.system, self, self.times)[0])
                    continue
                times, trajectory = self._means if bound.quantity in self._rated else self._everywhere
                if bound.quantity not in trajectory:
                    continue
                values = trajectory[bound.quantity]
                known = np.isfinite(values).reshape(len(values), -1).all(axis=1)
                if known.any():
                    reports += check_bounds([bound], times[known], {bound.quantity: values[known]})
        return tuple(reports)

    @property
    def broken(self) -> tuple[BoundReport, ...]:
        """Of the bounds those that were not kept."""
        return tuple(report for report in self.bounds if not report.ok)

    @cached_property
    def _pieces(self) -> PPoly:
        begun, ended, widths = self.points[:-1], self.points[1:], np.diff(self.times)[:, None]
        straight = (ended - begun) / widths
        first, last = (self._rates(points, self.inputs) for points in (begun, ended))
        first, last = (np.where(np.isfinite(rates), rates, straight) for rates in (first, last))
        cubic = (first + last - 2 * straight) / widths**2
        square = (3 * straight - 2 * first - last) / widths
        return PPoly(np.stack([cubic, square, first, begun]), self.times)

    @property
    def _rated(self) -> set[str]:
        """Quantities that say how fast something goes, and are known between two times only."""
        return {block.name for kind, block in self.problem.quantities if kind == "input" or block.rate} - set(
            self.system.state_space.names
        )

    @cached_property
    def _means(self) -> tuple[Array, Mapping[str, Array]]:
        """Amid two times each."""
        middles = 0.5 * (self.times[1:] + self.times[:-1])
        return middles, self._trajectory(middles, self.inputs)

    @cached_property
    def _everywhere(self) -> tuple[Array, Mapping[str, Array]]:
        """At the times and amid them."""
        times = np.union1d(self.times, self._means[0])
        held = np.searchsorted(self.times, times, side="right") - 1
        return times, self._trajectory(times, self.inputs[held.clip(0, len(self.inputs) - 1)])

    def _trajectory(self, times: Array, inputs: Array) -> Mapping[str, Array]:
        return numeric_system(self.system).trajectory(self(times), inputs, self.problem.scale)

    def _rates(self, points: Array, inputs: Array) -> Array:
        """ẋ (k, size)."""
        function: ca.Function = numeric_system(self.system).rate_function
        return call(mapped(function, len(points)), points, inputs)[0].reshape(points.shape)


class RecordedPlant:
    """A `Plant` that notes where its machine is after each `advance`, where that is known and something is bounded."""

    def __init__(self, plant: GuardedPlant, problem: PlanningProblem) -> None:
        self._plant, self._problem = plant, problem
        own = problem.system
        known = plant.system if problem.bounds else None
        if known is None or known.state_space != own.state_space:
            self._system = None
        else:  # among the same, and from the same rest
            around = None if own.surroundings is None else own.surroundings.obstacles
            rest = None if own.rest is None else np.array(own.rest)
            self._system = known.resting(rest).accelerating(False).among(around)
        self._times: list[float] = []
        self._points: list[Array] = []

    def begin(self) -> None:
        """A run begins."""
        self._times, self._points = [], []
        self._note(0.0)

    def ended(self) -> ExecutedPath | None:
        """The path since it began, once; None where there is none, or nobody knows it."""
        times, points = self._times, self._points
        self._times, self._points = [], []
        if self._system is None or len(times) < 2:
            return None
        return ExecutedPath(self._problem, self._system, np.array(times), np.array(points))

    def measure(self) -> Mapping[str, Any]:
        return self._plant.measure()

    def command(self, set_points: Array) -> None:
        self._plant.command(set_points)

    def advance(self, seconds: float) -> None:
        self._plant.advance(seconds)
        if self._times and seconds > 0:
            self._note(self._times[-1] + seconds)

    def _note(self, time: float) -> None:
        if self._system is not None and (point := self._plant.point) is not None:
            self._times.append(time)
            self._points.append(point)
