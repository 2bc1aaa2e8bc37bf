"""Manoeuvres as one plan: joined, corrected as one, and merged where less is asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from nhpocp.controls.control import Control
from nhpocp.controls.sequence import retimed
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.simulation import simulate
from nhpocp.flow.step_error import FINER, FOLLOWED, MOST, path_error
from nhpocp.interruption import STOPPED
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.cheapest import on_its_side
from nhpocp.solvers.continuation.confirmation import begun_from
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.delicate_chain import joined_by_steps
from nhpocp.solvers.continuation.merging import Merging
from nhpocp.solvers.continuation.pieces import joined

SHORTEST = 0.3  # of the mean duration: shorter ones would ask for many steps of all
STEPS_PER_PIECE = 0.4  # of the steps of a whole plan, for the shortest manoeuvre of a sequence
RESERVE = 1.3  # times the steps that would be enough where their error fell as their fourth power
JUDGED, BEHIND = 2, 1.6  # levels of a merge, after which one that costs so much more than another is given up


class Search(Protocol):
    """What plans are joined for: it solves, and hears what is being tried."""

    problem: PlanningProblem
    base: Continuation
    tried: list[dict[str, Any]]
    way: str

    def telling(self, way: str) -> None:
        """Hears what is being tried."""
        ...

    def solve(self, solver: Continuation, problem: PlanningProblem, updates: int = 0) -> ContinuationResult:
        """A confirmed solve."""
        ...

    def finished(self, first: ContinuationResult, solver: Continuation) -> ContinuationResult:
        """Least cost and the bounds, for what has reached the goal."""
        ...


class JoinedPlans:
    """Plans of manoeuvres in sequence, one after another; what merges had come to is remembered."""

    def __init__(self, search: Search) -> None:
        self._search, self._problem, self._base = search, search.problem, search.base
        # efforts when they were judged, of merges that led to plans that count
        self._merged = list[float]()

    def plan(self, controls: list[Control], steps: int) -> ContinuationResult:
        """Manoeuvres as one control, corrected as one; merged where less is asked for."""
        first = self._as_one(controls, steps)
        solver = replace(self._base, integrator=first.integrator)
        asked = self._base.objective != "none" and not self._problem.via
        if not asked or first.outcome is not Outcome.CONVERGED:
            return self._search.finished(first, solver)
        seed = self._base.seed + len(self._search.tried)
        merging = Merging(self._problem, controls, replace(self._base, seed=seed))
        try:
            reached = self._merges(merging)
        except KeyboardInterrupt:
            return replace(first, outcome=Outcome.INTERRUPTED, message=STOPPED)
        if reached is None:
            words = "given up: others had come to far less effort by that time"
            return replace(first, outcome=Outcome.STAGNATED, message=words)
        plan = self._of_merged(merging, first, solver)
        if plan.outcome is Outcome.CONVERGED and "objective_value" in plan.details:
            self._merged.append(reached)
        return plan

    def _of_merged(
        self, merging: Merging, first: ContinuationResult, solver: Continuation
    ) -> ContinuationResult:
        """The plan that a merge has left, or what the joined one comes to without it."""
        merged = self._confirmed_of(merging)
        if merged is None or not merged.control.effort < first.control.effort:
            return self._lowered(first, solver)
        if self._problem.bounds or self._base.objective != "effort":
            return self._search.finished(merged, replace(self._base, integrator=merged.integrator))
        return merging.told(merged)

    def _merges(self, merging: Merging) -> float | None:
        """Its effort after `JUDGED` levels; None, and not gone on with, where plans that count had far less by then.

        Errors: Ctrl-C's.
        """
        reached = None
        for effort in merging.run():
            self._search.telling(f"merging manoeuvres, effort {effort / self._problem.horizon.fixed:.4g}")
            if reached is None and merging.level >= JUDGED:
                reached = effort
                if effort > BEHIND * min(self._merged, default=np.inf):
                    return None
        return merging.effort if reached is None else reached

    def _confirmed_of(self, merging: Merging) -> ContinuationResult | None:
        """The most merged that finer steps confirm: close to a surface some paths cannot be checked."""
        merging_on = True
        while merging_on:
            parts = [stretch.control for stretch in merging.stretches]
            merged = self._as_one(parts, max(stretch.steps for stretch in merging.stretches))
            if merged.outcome in (Outcome.CONVERGED, Outcome.INTERRUPTED):
                return merged
            merging_on = merging.back()
        return None

    def _lowered(self, first: ContinuationResult, solver: Continuation) -> ContinuationResult:
        """What a joined plan comes to without merging, on its side of the separating surfaces."""
        found = self._search.finished(first, solver)
        lost = found.outcome is Outcome.CONVERGED and not on_its_side(self._problem, found)
        if not (lost and on_its_side(self._problem, first)):
            return found
        name = solver.objective
        cost = simulate(self._problem, first.control).costs[name]
        words = f"{first.message}; {name} {cost:.6g}, of which less was found beyond a singular surface only"
        return replace(
            first, message=words, details={**first.details, "objective_value": cost, "stationary": False}
        )

    def _as_one(self, controls: list[Control], steps: int) -> ContinuationResult:
        """Manoeuvres as one control over the problem's horizon, corrected as one; steps: for the shortest, at least.

        Manoeuvre i costs E_i in unit time; with √E_i / Σ √E of the horizon the whole costs the least, (Σ √E)²/T.
        """
        weights = np.sqrt([control.effort for control in controls])
        weights = np.maximum(weights, SHORTEST * weights.mean())
        durations = self._problem.horizon.fixed * weights / weights.sum()
        whole = joined([retimed(control, time) for control, time in zip(controls, durations, strict=True)])
        integrator = self._base.integrator
        if isinstance(integrator, RungeKutta4):
            steps = max(steps, int(STEPS_PER_PIECE * integrator.steps))
            steps = min(MOST // FINER, int(steps * weights.sum() / weights.min()))
            integrator = replace(integrator, steps=steps)
        solver = replace(self._base, integrator=integrator, objective="none")
        self._search.way = f"{len(controls)} manoeuvres as one"
        problem = replace(self._problem, bounds=())
        result = self._search.solve(solver, begun_from(problem, whole))
        ended = (
            result.outcome in (Outcome.CONVERGED, Outcome.INTERRUPTED) or problem.via or len(controls) == 1
        )
        plan = result if ended else joined_by_steps(problem, controls, solver, self._search.solve)
        return self._resolved(plan)

    def _resolved(self, plan: ContinuationResult) -> ContinuationResult:
        """Itself if its steps resolve the whole path, or with more of them; else no claim.

        The end may be right where what leads there is not.
        """
        for more in (True, False):
            if plan.outcome is not Outcome.CONVERGED:
                return plan
            wrong, integrator = path_error(self._problem, plan.control, plan.integrator), plan.integrator
            if wrong <= FOLLOWED:
                return plan
            if more and isinstance(integrator, RungeKutta4) and np.isfinite(wrong):
                steps = min(MOST, int(RESERVE * integrator.steps * (wrong / FOLLOWED) ** 0.25))
                solver = replace(self._base, integrator=replace(integrator, steps=steps), objective="none")
                plan = self._search.solve(solver, begun_from(replace(self._problem, bounds=()), plan.control))
        words = f"{plan.message}; its steps may be wrong by {wrong:.2g} of the task's scales on the way"
        return replace(plan, outcome=Outcome.NOT_VERIFIED, message=words)
