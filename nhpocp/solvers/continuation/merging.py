"""Manoeuvres in sequence made one motion of little effort: neighbours merged, pair by pair, again and again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from math import ceil
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.projection import project
from nhpocp.controls.sequence import SequenceBasis, join, retimed
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import ALLOWED
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.least_cost.null_space import NoSurfaceError
from nhpocp.solvers.least_cost.stretch import FEWEST_STEPS, Shortening, Stretch
from nhpocp.solvers.least_cost.walls import walls

SHORTEST = 0.5  # of the mean duration: what a part of little effort gets of a merged stretch
RELAXING, MOST_RELAXING = (0.5,), 40  # weights of the walls, sweep after sweep, and steps of each search
ON_THE_WAY, MOST_ON_THE_WAY = (1.0, 0.2), 80  # while there are neighbours
AT_THE_END, MOST_AT_THE_END = (0.2, 0.05), 300
SETTLED = 5e-3  # of the effort: what the last of these takes off a plan that no surface holds
FUNCTIONS, FEWEST_FUNCTIONS = 4.0, 12  # of a smooth basis, for each radian of √E, and at least
FEWER = 0.8  # of the functions that there are: how many may be left where others take their place
AT_REST = 1e-6  # of the cost's gradient: what is left of it in the null space
DEARER = 1.05  # times the effort of the stretch: what the smooth basis may cost at first
STEPS_PER_FUNCTION = 8
FINE_STEPS = 400  # of a manoeuvre, when its end is worked out


class Merging:
    """Manoeuvres, each from the pose where the one before ends, merged into one.

    Off the singular surfaces a displacement z along the brackets costs 4π|z| by one loop, and n times that by n loops
    of a displacement z/n each: long sequences are dear, and near a saddle rather than a minimum. As one they are too
    sensitive to be searched. So two neighbours at a time are one stretch between poses that are held, its effort
    falls in the null space of J with `Walls` that repel, and the pose between them goes where that
    leads. After that they stay one, and so on with stretches twice as long, until one is left.
    """

    def __init__(
        self, problem: PlanningProblem, controls: Sequence[Control], tolerance: float, most: int
    ) -> None:
        """controls: of unit time. tolerance: on E. most: evaluations of each search."""
        self.problem, self.most, self.allowed = problem, most, ALLOWED * tolerance
        self.stationary = False
        self.walls = walls(problem)
        self.stretches = self._stretches(controls)
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
        """Merges until one stretch is left; yields the effort that remains. Errors: Ctrl-C's."""
        if self.walls is None:
            return
        with Interruption() as interruption, np.errstate(all="ignore"):
            search = Shortening(self.problem, self.walls, self.allowed, interruption.check)
            for weight in RELAXING:
                for first in (0, 1):
                    yield from self._relax(search, first, weight)
            while len(self.stretches) > 1:
                merged: list[Stretch] = []
                for pair in _groups(self.stretches):
                    merged.append(self._merged(search, pair))
                    yield self.effort
                self.stretches = merged
            yield from self._finish(search)
            self.evaluations = search.evaluations

    @property
    def effort(self) -> float:
        """Of all stretches in unit time, divided among them as is best."""
        return float(sum(stretch.length for stretch in self.stretches) ** 2)

    @property
    def control(self) -> Control:
        """Of all stretches, in unit time."""
        return concatenated([stretch.control for stretch in self.stretches])

    @property
    def steps(self) -> int:
        """By which the control is resolved."""
        return sum(stretch.steps for stretch in self.stretches)

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

    def _relax(self, search: Shortening, first: int, weight: float) -> Iterator[float]:
        """Lets the poses between neighbours go where both together have less effort, from that one on."""
        for place in range(first, len(self.stretches) - 1, 2):
            pair = self.stretches[place : place + 2]
            try:
                both, _ = search.shortened(_together(pair), (weight,), MOST_RELAXING, Budget(self.most))
            except NoSurfaceError:
                continue
            self.stretches[place : place + 2] = self._cut(both, pair)
            yield self.effort

    def _cut(self, both: Stretch, pair: Sequence[Stretch]) -> list[Stretch]:
        """A stretch cut where the first of the two ends that it was made of."""
        count, pieces = len(pieces_of(pair[0].control)), pieces_of(both.control)
        controls = [retimed(joined(part), 1.0) for part in (pieces[:count], pieces[count:])]
        middle = self._end(both.start, controls[0], FINE_STEPS + both.steps)
        steps = max(FEWEST_STEPS, both.steps // 2)
        values = self.problem.system.state_space.unpack(middle)
        return [
            Stretch(both.start, values, controls[0], steps),
            Stretch(middle, both.goal, controls[1], steps),
        ]

    def _end(self, start: Array, control: Control, steps: int) -> Array:
        flow = flow_through(self.problem.system, control.basis, 1.0, RungeKutta4(steps), ())
        return self.problem.system.state_space.nearest(flow.end(start, control.coefficients))

    def _merged(self, search: Shortening, pair: Sequence[Stretch]) -> Stretch:
        if len(pair) == 1:
            return pair[0]
        both = _together(pair)
        try:
            both, _ = search.shortened(both, ON_THE_WAY, MOST_ON_THE_WAY, Budget(self.most))
        except NoSurfaceError:
            return both
        return self._smooth(search, both)

    def _smooth(self, search: Shortening, stretch: Stretch) -> Stretch:
        """Over a smooth basis of fewer functions, if that costs less or hardly more."""
        functions = max(FEWEST_FUNCTIONS, ceil(FUNCTIONS * stretch.length))
        if functions >= FEWER * stretch.control.basis.size:
            return stretch
        smooth = project(stretch.control, BSpline(3, functions - 3))
        try:
            steps = max(stretch.steps // 2, STEPS_PER_FUNCTION * functions)
            over = replace(stretch, control=smooth, steps=steps)
            ended, _ = search.shortened(over, ON_THE_WAY[-1:], MOST_ON_THE_WAY, Budget(self.most))
        except NoSurfaceError:
            return stretch
        return ended if ended.control.effort <= DEARER * stretch.control.effort else stretch

    def _finish(self, search: Shortening) -> Iterator[float]:
        budget = Budget(self.most * len(AT_THE_END))
        for weight in (*AT_THE_END, 0.0):
            (stretch,), last = self.stretches, self.effort
            try:
                ended, rests = search.shortened(stretch, (weight,), MOST_AT_THE_END, budget, AT_REST)
            except NoSurfaceError:
                return
            free = weight == 0.0
            if ended.control.effort <= stretch.control.effort and (rests or not free):
                self.stretches, self.stationary = [ended], free
            yield self.effort
            if weight == AT_THE_END[-1] and self.effort < (1.0 - SETTLED) * last:
                return  # it falls on towards a surface


def _together(stretches: Sequence[Stretch]) -> Stretch:
    control = concatenated([stretch.control for stretch in stretches])
    steps = sum(stretch.steps for stretch in stretches)
    return Stretch(stretches[0].start, stretches[-1].goal, control, steps)


def _groups(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    """Neighbours, two or as many as are as long as two are on average; short ones are hardly worth a search."""
    enough = sum(stretch.length for stretch in stretches) / len(stretches)
    groups: list[list[Stretch]] = [[]]
    for stretch in stretches:
        if len(groups[-1]) >= 2 and sum(each.length for each in groups[-1]) >= enough:
            groups.append([])
        groups[-1].append(stretch)
    return groups


def concatenated(controls: Sequence[Control]) -> Control:
    """One control of unit time that does these, the pieces of sequences among them side by side."""
    if len(controls) == 1:
        return controls[0]
    weights = np.sqrt([control.effort for control in controls])
    weights = np.maximum(weights, SHORTEST * weights.mean())
    parts = [retimed(c, w / weights.sum()) for c, w in zip(controls, weights, strict=True)]
    return retimed(joined([piece for part in parts for piece in pieces_of(part)]), 1.0)


def joined(pieces: Sequence[Control]) -> Control:
    """Pieces in sequence; one alone is itself."""
    return join(pieces) if len(pieces) > 1 else pieces[0]


def pieces_of(control: Control) -> list[Control]:
    """Those of a sequence; of another basis the control itself."""
    basis = control.basis
    if not isinstance(basis, SequenceBasis):
        return [control]
    firsts = list(accumulate((each.size for each in basis.bases), initial=0))
    return [
        Control(each, control.coefficients[:, first : first + each.size], fraction * control.horizon)
        for each, fraction, first in zip(basis.bases, basis.shares, firsts[:-1], strict=True)
    ]
