"""A stretch of a motion, from pose to pose, made to cost less by motion in the null space of J between `Walls`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.controls.control import Control
from nhpocp.errors import OrientationAtPiError
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.null_space import NoSurfaceError, NullSpaceResult, minimise
from nhpocp.solvers.least_cost.walls import Walls, clear_of
from nhpocp.solvers.metrics import Coordinates, WeightedMetric

FEWEST_STEPS, MOST_STEPS = 80, 12_000  # of a stretch's integration
REFINED = 8  # times the steps that a search begins with, at most
EVEN = 0.7  # of the steps: laid evenly in time, the rest where the motion is fast or near a wall
FINER = 2  # the coarse path, by which the error of the steps is known, has one step for so many
LOOSEST = 5.0  # times that error: what a search may begin with
COARSE = 0.3  # of the error of the steps that is allowed: where a search that ends goes on with more of them
GOAL = 1e-7  # on e
WORTH = 0.02  # of the cost: what a search takes off that is gone on with, on finer steps


@dataclass(frozen=True)
class Stretch:
    """A control of unit time from one pose to another. steps: by which it is resolved."""

    start: Array
    goal: Mapping[str, Any]  # values of blocks, as a problem's
    control: Control
    steps: int

    @property
    def length(self) -> float:
        """√E: what counts of a part, as a whole costs (Σ √E)²/T with the best division of the horizon."""
        return float(np.sqrt(self.control.effort))


@dataclass(frozen=True)
class _Seen:
    """Where one control leads."""

    error: Array
    jacobian: Array
    path: Array


@dataclass(frozen=True)
class _Price:
    """What the walls along its path cost, and that cost's derivative by the coefficients."""

    value: float
    slope: Array
    slacks: Array


class _Paths:
    """Controls over one basis on one grid of times."""

    def __init__(self, problem: PlanningProblem, walls: Walls, stretch: Stretch, times: Array) -> None:
        self.stretch, self.times = stretch, times
        basis = stretch.control.basis
        rk4 = RungeKutta4(kernels=RungeKutta4().kernels.for_long_work())
        motion = dynamics(problem.system)
        self._flow, self._coarse = (rk4.flow(motion, basis, 1.0, each) for each in (times, times[::FINER]))
        self._walled = rk4.flow(walls.dynamics, basis, 1.0, times)
        self._start = stretch.start
        self._space, self._task = problem.system.state_space, replace(problem.tasks[-1], values=stretch.goal)
        self._weights = np.asarray(self._space.weights(problem.error_length))

    def see(self, coefficients: Array) -> _Seen | None:
        """None where the path is not finite."""
        with np.errstate(all="ignore"):
            path, derivatives, _ = self._flow.sensitivity(self._start, coefficients)
        if not (np.isfinite(path).all() and np.isfinite(derivatives).all()):
            return None
        try:
            error = self._task.scales * self._task.difference(path[-1])
        except OrientationAtPiError:
            return None
        return _Seen(error, self._task.jacobian(path[-1], derivatives[-1]), path)

    def price(self, coefficients: Array) -> _Price | None:
        """None where the path is not finite or not clear; among obstacles it takes some twenty times as long."""
        with np.errstate(all="ignore"):
            path, derivatives, slacks = self._walled.sensitivity(np.append(self._start, 0.0), coefficients)
        if not (np.isfinite(path).all() and np.isfinite(derivatives).all() and clear_of(slacks)):
            return None
        return _Price(float(path[-1, -1]), derivatives[-1][-1], slacks)

    def step_error(self, coefficients: Array, end: Array) -> float:
        """Of the end [E's unit], from the path with half the steps."""
        with np.errstate(all="ignore"):
            coarse = self._coarse.end(self._start, coefficients)
        if not np.isfinite(coarse).all():
            return np.inf
        change = self._weights * np.asarray(self._space.lower(end, coarse - end))
        return float(norm(change)) / (FINER**4 - 1)


def graded(times: Array, path: Array, slacks: Array, scales: Array, breakpoints: Array, steps: int) -> Array:
    """About that many steps, in pairs of equal ones, shorter where a path moves fast or its slacks change fast.

    scales: of the state, packed. A Runge-Kutta step is wrong by (h/τ)⁵, τ being the time in which the path changes.
    """
    moved = np.abs(np.diff(path, axis=0) / scales).sum(axis=1)
    if slacks.size:
        moved = moved + np.abs(np.diff(np.log(slacks), axis=0)).sum(axis=1)
    density = np.diff(times) * EVEN + (1.0 - EVEN) * moved / max(moved.sum(), 1e-12)
    along = np.concatenate([[0.0], np.cumsum(density)])
    knots = np.concatenate([[0.0], breakpoints, [1.0]])
    at_knots = np.interp(knots, times, along)
    parts = []
    for first, last, low, high in zip(knots, knots[1:], at_knots, at_knots[1:], strict=False):
        pairs = max(2, int(np.ceil(0.5 * steps * (high - low) / along[-1])))
        inner = np.interp(np.linspace(low, high, pairs + 1)[:-1], along, times)
        inner[0] = first
        ends = np.append(inner[1:], last)
        parts.append(np.column_stack([inner, 0.5 * (inner + ends)]).ravel())
    return np.append(np.concatenate(parts), 1.0)


class Shortening:
    """Searches for less effort from stretches of one problem's motion.

    allowed: the error of integration [E] that a path may carry. most: steps of one search.
    """

    def __init__(
        self, problem: PlanningProblem, walls: Walls, allowed: float, check: Callable[[], None]
    ) -> None:
        self.problem, self.walls, self.allowed, self.check = problem, walls, allowed, check
        self.evaluations = 0
        self._metric = WeightedMetric(1.0 / problem.scales.inputs**2)

    def shortened(
        self, stretch: Stretch, weights: tuple[float, ...], most: int, budget: Budget, tolerance: float = 1e-3
    ) -> tuple[Stretch, bool]:
        """With less effort, and whether the last search came to rest; weights: of the walls, shares of the effort.

        Errors: `NoSurfaceError` where the stretch itself cannot be used; Ctrl-C's.
        """
        shortened = self._descended(stretch, weights[0], most, budget, tolerance)
        for weight in weights[1:]:
            with suppress(NoSurfaceError):
                shortened = self._descended(shortened[0], weight, most, budget, tolerance)
        return shortened

    def _descended(
        self, stretch: Stretch, weight: float, most: int, budget: Budget, tolerance: float
    ) -> tuple[Stretch, bool]:
        most_steps = min(MOST_STEPS, REFINED * stretch.steps)
        while True:
            search = _Descent(self, stretch, budget)
            ended = search.run(weight, most, tolerance)
            coarse = ended is None or search.step_error(ended.y) > COARSE * self.allowed
            rests = budget.left <= 0
            if ended is not None:
                stretch = replace(stretch, control=search.control(ended.y))
                rests |= ended.converged or ended.cost > (1.0 - WORTH) * ended.history[0]["cost"]
            if rests or not coarse or 2 * stretch.steps > most_steps:
                break
            stretch = replace(stretch, steps=2 * stretch.steps)
        if ended is None:
            raise NoSurfaceError("the stretch cannot be used")
        return stretch, ended.converged


class _Descent:
    """One search, from one control on one grid."""

    def __init__(self, owner: Shortening, stretch: Stretch, budget: Budget) -> None:
        problem = owner.problem
        control = stretch.control
        self.owner, self.stretch, self.budget = owner, stretch, budget
        self.coordinates = Coordinates.natural(owner._metric, control.basis, problem.scales.inputs, 1.0)
        self.shape = control.coefficients.shape
        self.y = self.coordinates.of(control.coefficients.ravel())
        self.effort = cost_map("effort", problem, control.basis, 1.0, RungeKutta4())
        self.unit = float(np.max(problem.scales.inputs)) ** 2  # of the effort in unit time
        even = graded(
            np.linspace(0.0, 1.0, 3),
            np.zeros((3, 1)),
            np.empty((3, 0)),
            np.ones(1),
            control.breakpoints,
            stretch.steps,
        )
        self.paths = _Paths(problem, owner.walls, stretch, even)
        self.first = self._first()
        if self.first:
            path, slacks = self.first[0].path, self.first[1].slacks
            times = graded(even, path, slacks, problem.scales.points, control.breakpoints, stretch.steps)
            self.paths = _Paths(problem, owner.walls, stretch, times)
            self.first = self._first()
        self._last: tuple[Array, _Seen] | None = None
        first_error = self.step_error(self.y) if self.first else np.inf
        self.allowed = min(max(owner.allowed, 2.0 * first_error), LOOSEST * owner.allowed)

    def _first(self) -> tuple[_Seen, _Price] | None:
        """What the control to begin with leads to, and costs; None where it cannot be used."""
        coefficients = self.stretch.control.coefficients
        seen, price = self.paths.see(coefficients), self.paths.price(coefficients)
        return (seen, price) if seen and price else None

    def control(self, y: Array) -> Control:
        return Control(self.stretch.control.basis, self._coefficients(y))

    def _coefficients(self, y: Array) -> Array:
        return self.coordinates.coefficients(y).reshape(self.shape)

    def run(self, weight: float, most: int, tolerance: float) -> NullSpaceResult | None:
        """None where the first control cannot be brought to the goal."""
        if self.first is None:
            return None
        share = weight * self.effort(self._coefficients(self.y))[0] / self.unit
        share /= max(self.first[1].value, 1e-12)

        def cost(y: Array) -> tuple[float, Array]:
            coefficients = self._coefficients(y)
            price, (value, slope) = self.paths.price(coefficients), self.effort(coefficients)
            if price is None:
                return np.inf, self.coordinates.jacobian(slope) / self.unit
            slope = slope / self.unit + share * price.slope
            return value / self.unit + share * price.value, self.coordinates.jacobian(slope)

        try:
            return minimise(
                self._surface,
                cost,
                self.y,
                curvature=2.0,
                tolerance=tolerance,
                goal=GOAL,
                most=most,
                budget=self.budget,
            )
        except (NoSurfaceError, np.linalg.LinAlgError):
            return None

    def step_error(self, y: Array) -> float:
        seen = self._seen(y)
        return self.paths.step_error(self._coefficients(y), seen.path[-1]) if seen else np.inf

    def _seen(self, y: Array) -> _Seen | None:
        if self._last is None or not np.array_equal(self._last[0], y):
            seen = self.paths.see(self._coefficients(y))
            if seen is None:
                return None
            self._last = np.array(y), seen
        return self._last[1]

    def _surface(self, y: Array) -> tuple[Array, Array] | None:
        self.owner.check()
        if not self.budget.take():
            return None
        self.owner.evaluations += 1
        seen = self._seen(y)
        if seen is None:
            return None
        if not self.step_error(y) <= self.allowed:
            return None
        return seen.error, self.coordinates.jacobian(seen.jacobian)
