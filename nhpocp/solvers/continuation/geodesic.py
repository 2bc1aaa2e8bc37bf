"""Ways along the geodesic from start to goal: manoeuvres in sequence, and the goal walked up to."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.errors import OrientationAtPiError
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.confirmation import end_of
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.initial_control import drawn

PIECES = 32  # at most
SEEDS = 8  # per manoeuvre
HALVINGS = 6  # of a part of the geodesic


class Tries(Protocol):
    """What tries a problem: the search that these ways are of."""

    problem: PlanningProblem
    base: Continuation
    way: str  # what is being tried, in words
    given_up: bool  # for want of evaluations

    def attempt(self, problem: PlanningProblem, seed: int) -> ContinuationResult:
        """The continuation to the goal alone, given up soon; converged only if confirmed."""
        ...

    def may_try(self) -> bool:
        """Whether there are evaluations for another try."""
        ...

    def note(self, way: str, outcome: str, error: float) -> None:
        """How a way ended that leaves no plan."""
        ...


class Geodesic:
    """The geodesic from start to goal, as a search goes along it."""

    def __init__(self, search: Tries) -> None:
        self._search, self._problem = search, search.problem
        self._space = search.problem.system.state_space

    def manoeuvres(self) -> list[Control] | None:
        """One plan after another, of unit time each, as far as it succeeds; None if one gets stuck.

        A plan that fails is tried again for half of the way.
        """
        here, step = self._problem.start_point, 0.5
        controls: list[Control] = []
        while step > 0.5**HALVINGS and len(controls) < PIECES:
            goal = self._problem.goal if step == 1.0 else self._between(here, step)
            if goal is None:
                return None
            start = self._space.unpack(here)
            part = replace(self._problem, start=start, goal=goal, horizon=Horizon(1.0), via=())
            self._search.way = f"manoeuvre {len(controls) + 1}, over {step:.3g} of what is left"
            control = self._piece(part, step**0.5)
            if self._search.given_up:
                return None
            if control is None:
                step *= 0.5
                continue
            controls.append(control)
            if step == 1.0:
                return controls
            here, step = end_of(part, control, self._search.base.integrator), min(1.0, 2.0 * step)
        self._search.note(
            f"manoeuvres in sequence, stuck after {len(controls)}",
            "stagnated",
            self._problem.goal_error(here),
        )
        return None

    def _piece(self, part: PlanningProblem, size: float) -> Control | None:
        """One manoeuvre: the shorter of the first two plans that seeded starts lead to.

        A loop of size s moves a driftless system by s² along its brackets, so the starts shrink like √distance.
        """
        plans: list[Control] = []
        for seed in range(SEEDS):
            if not self._search.may_try():
                break
            random = np.random.default_rng(self._search.base.seed + seed)
            tried = self._search.attempt(replace(part, initial=drawn(part, random, size)), seed)
            if tried.outcome is Outcome.INTERRUPTED:
                raise KeyboardInterrupt
            if tried.outcome is Outcome.CONVERGED:
                plans.append(tried.control)
            if len(plans) == 2:
                break
        return min(plans, key=lambda control: control.effort, default=None)

    def walk(self, nearest: ContinuationResult) -> ContinuationResult | None:
        """Goal continuation: from the pose that a start reaches to the goal, in steps that succeed; None if stuck."""
        problem = self._problem
        here = end_of(problem, nearest.control, self._search.base.integrator)
        coefficients, walked, step = np.array(nearest.control.coefficients), 0.0, 0.5
        while np.isfinite(here).all() and walked < 1.0 and step > 0.5**HALVINGS:
            if not self._search.may_try():
                return None
            towards = min(1.0, walked + step)
            self._search.way = f"walking the goal, at {towards:.3g} of the way"
            goal = problem.goal if towards == 1.0 else self._between(here, towards)
            if goal is None:
                return None
            result = self._search.attempt(replace(problem, goal=goal, initial=coefficients), 0)
            if result.outcome is Outcome.INTERRUPTED:
                raise KeyboardInterrupt
            if result.outcome is Outcome.CONVERGED:
                coefficients, walked, step = np.array(result.control.coefficients), towards, 1.5 * step
            else:
                step *= 0.5
        if not self._search.may_try():
            return None
        return self._search.attempt(replace(problem, initial=coefficients), 0)

    def _between(self, here: Array, fraction: float) -> dict[str, Array] | None:
        """The goal's blocks part of the geodesic to it; None where it has two (a half turn) or names outputs."""
        if not set(self._problem.goal) <= set(self._space.names):
            return None
        try:
            tangent = self._space.difference(self._problem.goal_point, here)
        except OrientationAtPiError:
            return None
        there = self._space.unpack(np.asarray(self._space.retract(here, fraction * tangent)))
        return {name: there[name] for name in self._problem.goal}
