"""Manoeuvres in sequence made one motion of little effort: neighbours merged, pair by pair, again and again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.projection import project
from nhpocp.controls.sequence import retimed
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import Flow, RungeKutta4
from nhpocp.flow.step_error import ALLOWED
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.direct_controls import DirectControls
from nhpocp.solvers.continuation.pieces import between, concatenated, joined, middle, pieces_of
from nhpocp.solvers.least_cost.null_space import NoSurfaceError
from nhpocp.solvers.least_cost.stretch import FEWEST_STEPS, Shortening, Stretch
from nhpocp.solvers.least_cost.walls import walls


class Level(NamedTuple):
    """How the sweeps along a motion search, until one takes less than that share off its length."""

    weight: float  # of the walls
    most: int  # steps of each search
    worth: float


# from coarse to fine: what is far from the least is not worth many steps, and walls weigh less and less
LEVELS = (
    Level(0.5, 15, 0.15),
    Level(0.2, 30, 0.1),
    Level(0.05, 60, 0.05),
    Level(0.0125, 60, 0.02),
    Level(0.003, 60, 0.01),
)
WHOLE = 3.0  # length in units of the inputs: what two come to that stay one; longer ones are cut in halves
DIRECT = 2  # of the direct controls that are searched
TOO_DEAR = 1.3  # times the length of what one would replace: dearer ones are not
CALM = 2  # the level from which on the whole is searched as one, after sweeps through all
MOST_AT_THE_END = 100  # steps of the searches of the whole
SETTLED = 5e-3  # of the effort: what the last of these takes off a plan that no surface holds
FUNCTIONS, FEWEST_FUNCTIONS = 4.0, 12  # of a smooth basis, for each unit of length, and at least
FEWER = 0.8  # of the functions that there are: how many may be left where others take their place
HALF = 0.6  # of the length of both: what counts of each half
AT_REST = 1e-6  # of the cost's gradient: what is left of it in the null space
DEARER = 1.05  # times the effort of the stretch: what the smooth basis may cost at first
STEPS_PER_FUNCTION = 8
ROUNDING = 1e-6  # of a length
FINE_STEPS = 400  # of a manoeuvre, when its end is worked out


class Merging:
    """Manoeuvres, each from the pose where the one before ends, merged into fewer.

    Off the singular surfaces a displacement z along the brackets costs 4π|z| by one loop, and n times that by n loops
    of a displacement z/n each: long sequences are dear, and near a saddle rather than a minimum. As one they are too
    sensitive to be searched. So two neighbours at a time are one stretch between poses that are held. Its effort falls
    in the null space of J with `Walls` that repel, from what they do and from `DirectControls`; then it stays one, or
    is cut anew in halves, and so on along the motion, until nothing is gained. At the end the whole is searched as one.
    """

    def __init__(self, problem: PlanningProblem, controls: Sequence[Control], solver: Continuation) -> None:
        """controls: of unit time. solver: its tolerance on E, evaluations of each search, and seed."""
        self.problem, self._solver = problem, solver
        self.most, self.allowed = solver.max_iterations, ALLOWED * solver.tolerance
        self.stationary = False
        self.walls = walls(problem)
        self._unit = float(np.max(problem.scales.inputs))
        self.stretches = self._stretches(controls)
        self._before = list[list[Stretch]]()  # what was left after each level
        self.began = self.effort / problem.horizon.fixed
        self.evaluations = 0

    def _stretches(self, controls: Sequence[Control]) -> list[Stretch]:
        space, here, stretches = self.problem.system.state_space, self.problem.start_point, []
        for place, control in enumerate(controls, 1):
            end = self._end(here, control, FINE_STEPS)
            goal = self.problem.goal if place == len(controls) else space.unpack(end)
            stretches.append(Stretch(here, goal, control, FEWEST_STEPS))
            here = end
        return stretches

    def run(self) -> Iterator[float]:
        """Merges as long as that gains; yields the effort that remains. Errors: Ctrl-C's."""
        if self.walls is None:
            return
        with Interruption() as interruption, np.errstate(all="ignore"):
            search = Shortening(self.problem, self.walls, self.allowed, interruption.check)
            direct = DirectControls(self.problem, self._solver, self.walls, interruption)
            for level in LEVELS:
                gains = len(self.stretches) > 1
                while gains:
                    before = self.effort
                    for first in (0, 1):
                        yield from self._sweep(search, direct, level, first)
                    gains = len(self.stretches) > 1 and self.effort <= (1.0 - level.worth) ** 2 * before
                self._before.append(list(self.stretches))
            yield from self._finish(search)
            self.evaluations = search.evaluations

    @property
    def effort(self) -> float:
        """Of all stretches in unit time, divided among them as is best."""
        return _length(self.stretches) ** 2

    @property
    def level(self) -> int:
        """Levels of sweeps that are done."""
        return len(self._before)

    def back(self) -> bool:
        """Goes back to what was left a level before, farther from the walls; whether there is such."""
        while self._before:
            stretches = self._before.pop()
            if _length(stretches) > (1.0 + ROUNDING) * _length(self.stretches):
                self.stretches, self.stationary = stretches, False
                return True
        return False

    def told(self, result: ContinuationResult) -> ContinuationResult:
        """The result of the control that is left, with what is known of its effort."""
        surfaces = self.walls.names if self.walls else ()
        details: dict[str, Any] = {"objective_value": result.control.effort, "stationary": self.stationary}
        words = "at a stationary point" if self.stationary else "not at a stationary point"
        if surfaces and not self.stationary:
            details["falls_towards"] = list(surfaces)
            words = f"held off {' and '.join(surfaces)}, towards which it falls"
        message = (
            f"{result.message}; effort {result.control.effort:.6g} {words}, of {self.began:.4g} as joined"
        )
        return replace(result, message=message, details={**result.details, **details})

    def _sweep(self, search: Shortening, direct: DirectControls, level: Level, first: int) -> Iterator[float]:
        """Along the motion, neighbour by neighbour from that one on."""
        place = first
        while place + 1 < len(self.stretches):
            pair = self.stretches[place : place + 2]
            ways = [
                *self._from_joined(search, pair, level),
                *self._from_direct(search, direct.between(pair[0].start, pair[1].goal), pair, level),
            ]
            if ways:
                both = min(ways, key=_own_length)
                pair = min((self._parts(search, both, pair, level), [both], pair), key=_length)
            self.stretches[place : place + 2] = pair
            place += len(pair)
            yield self.effort

    def _from_joined(self, search: Shortening, pair: Sequence[Stretch], level: Level) -> Iterator[Stretch]:
        """What two come to as one, from what they do."""
        with suppress(NoSurfaceError):
            yield self._smooth(search, self._searched(search, together(pair), level), level)

    def _from_direct(
        self, search: Shortening, controls: Sequence[Control], pair: Sequence[Stretch], level: Level
    ) -> Iterator[Stretch]:
        """What the cheapest of some controls come to in the place of two."""
        count = 0
        for control in controls:
            if count == DIRECT or np.sqrt(control.effort) > TOO_DEAR * _length(pair):
                return
            smooth = between(control, 0.0, 1.0, self._basis(np.sqrt(control.effort)))
            for each in (smooth, control):
                stretch = Stretch(pair[0].start, pair[1].goal, each, _steps(each))
                with suppress(NoSurfaceError):
                    yield self._searched(search, stretch, level)
                    count += 1
                    break

    def _parts(self, search: Shortening, both: Stretch, pair: list[Stretch], level: Level) -> list[Stretch]:
        """One where it is short; else its halves, or where these cannot be searched what the two have become."""
        if both.length <= WHOLE * self._unit:
            return [both]
        with suppress(NoSurfaceError):
            return self._halves(search, both, level)
        first, second = (len(pieces_of(stretch.control)) for stretch in pair)
        pieces = pieces_of(both.control)
        if len(pieces) != first + second:
            return [both]
        controls = [retimed(joined(part), 1.0) for part in (pieces[:first], pieces[first:])]
        steps = max(FEWEST_STEPS, both.steps // 2)
        at = self._end(both.start, controls[0], FINE_STEPS + both.steps)
        return self._cut(both, at, controls, [steps, steps])

    def _halves(self, search: Shortening, stretch: Stretch, level: Level) -> list[Stretch]:
        """Both over smooth bases. Errors: `NoSurfaceError` where these do not lead where the stretch does."""
        control, steps = stretch.control, FINE_STEPS + stretch.steps
        time = middle(control, steps)
        path = self._flow(control, steps).states(stretch.start, control.coefficients)
        at = self.problem.system.state_space.nearest(path[round(time * steps)])
        basis = self._basis(HALF * stretch.length)
        controls = [between(control, *times, basis) for times in ((0.0, time), (time, 1.0))]
        halves = self._cut(stretch, at, controls, [_steps(each) for each in controls])
        return [self._searched(search, half, level) for half in halves]

    def _cut(
        self, stretch: Stretch, at: Array, controls: Sequence[Control], steps: Sequence[int]
    ) -> list[Stretch]:
        """Two stretches, by way of a pose."""
        values = self.problem.system.state_space.unpack(at)
        return [
            Stretch(stretch.start, values, controls[0], steps[0]),
            Stretch(at, stretch.goal, controls[1], steps[1]),
        ]

    def _flow(self, control: Control, steps: int) -> Flow:
        return flow_through(self.problem.system, control.basis, 1.0, RungeKutta4(steps), ())

    def _end(self, start: Array, control: Control, steps: int) -> Array:
        return self.problem.system.state_space.nearest(
            self._flow(control, steps).end(start, control.coefficients)
        )

    def _basis(self, length: float) -> BSpline:
        """A smooth one for a control of that length."""
        return BSpline(3, max(FEWEST_FUNCTIONS, ceil(FUNCTIONS * length / self._unit)) - 3)

    def _searched(self, search: Shortening, stretch: Stretch, level: Level) -> Stretch:
        """At less effort. Errors: `NoSurfaceError` where it cannot be used."""
        return search.shortened(stretch, (level.weight,), level.most, Budget(self.most))[0]

    def _smooth(self, search: Shortening, stretch: Stretch, level: Level) -> Stretch:
        """Over a smooth basis of fewer functions, if that costs less or hardly more."""
        basis = self._basis(stretch.length)
        if basis.size >= FEWER * stretch.control.basis.size:
            return stretch
        smooth = project(stretch.control, basis)
        over = replace(stretch, control=smooth, steps=max(stretch.steps // 2, _steps(smooth)))
        with suppress(NoSurfaceError):
            ended = self._searched(search, over, level)
            if ended.control.effort <= DEARER * stretch.control.effort:
                return ended
        return stretch

    def _finish(self, search: Shortening) -> Iterator[float]:
        """The whole as one, and without walls where none holds it."""
        budget, weights = Budget(self.most * len(LEVELS)), [level.weight for level in LEVELS]
        if len(self.stretches) > 1:
            weights = weights[CALM:]  # they have been through the others
        for weight in (*weights, 0.0):
            whole, last = together(self.stretches), self.effort
            try:
                ended, rests = search.shortened(whole, (weight,), MOST_AT_THE_END, budget, AT_REST)
            except NoSurfaceError:
                return
            free = weight == 0.0
            if ended.control.effort <= whole.control.effort and (rests or not free):
                self.stretches, self.stationary = [ended], free
            yield self.effort
            if weight == weights[-1] and self.effort < (1.0 - SETTLED) * last:
                return  # it falls on towards a surface


def together(stretches: Sequence[Stretch]) -> Stretch:
    """One stretch that does what these do."""
    if len(stretches) == 1:
        return stretches[0]
    control = concatenated([stretch.control for stretch in stretches])
    steps = sum(stretch.steps for stretch in stretches)
    return Stretch(stretches[0].start, stretches[-1].goal, control, steps)


def _steps(control: Control) -> int:
    return max(FEWEST_STEPS, STEPS_PER_FUNCTION * control.basis.size)


def _length(stretches: Sequence[Stretch]) -> float:
    return sum(stretch.length for stretch in stretches)


def _own_length(stretch: Stretch) -> float:
    return stretch.length
