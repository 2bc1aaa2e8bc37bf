"""Other plans than the first that reaches the goal, and of all the one of least cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from nhpocp.deferred import Deferred
from nhpocp.flow.end_point_map import flow_through
from nhpocp.interruption import STOPPED
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.solvers.continuation.singularity_crossings import keeps_sign
from nhpocp.systems.numeric import numeric_system

ALONG = "along a route"  # how the names of such ways end
ROUTES = 8  # along which plans are compared: one route or seed may end at three times the effort of another
STARTS = 32  # at most, that are compared by what they cost in the end
WIDTHS = (1.0, 0.5, 2.0)  # of the seeded among them, in turn
AGREEING = 6  # starts that lead to the least cost so far: others are hardly worth the work
ALIKE = 5e-3  # relative, of two costs
NOTHING = 1e-6  # of the objective's unit: less is not worth a search
BUDGET = 3000  # evaluations, after which no new start begins

Ways = Iterator[tuple[str, ContinuationResult]]


class Search(Protocol):
    """What can try other starts, and takes down what it has tried."""

    problem: PlanningProblem
    base: Continuation
    records: list[Deferred]
    tried: list[dict[str, Any]]
    way: str

    def note(self, way: str, outcome: str, error: float) -> None:
        """How a way ended."""
        ...

    def attempt(self, problem: PlanningProblem, seed: int) -> ContinuationResult:
        """The continuation to the goal alone."""
        ...

    def finished(self, first: ContinuationResult, solver: Continuation) -> ContinuationResult:
        """What the search for least cost makes of it."""
        ...


def cheapest(search: Search, first: ContinuationResult, routes: Ways) -> ContinuationResult:
    """Of the plan that is at hand, those along other routes, and those from seeded starts.

    routes: plans along those that have not been followed yet. Stopped by Ctrl-C, the least so far.
    """
    plans, stopped = [_numbered(search, first)], False
    along = search.tried[-1]["way"].endswith(ALONG)
    try:
        for plan in _others(search, plans, routes if along else iter(()), along):
            plans.append(_numbered(search, plan))
    except KeyboardInterrupt:
        stopped = True
    least = min(plans, key=_cost)
    # the records of the least are the last, as ever
    search.records.sort(key=lambda record: record["attempt"] == least.details["attempt"])
    if stopped:
        return replace(least, outcome=Outcome.INTERRUPTED, message=f"{STOPPED}; best so far: {least.message}")
    message = f"{least.message}; the least of {len(plans)} plans" if len(plans) > 1 else least.message
    costs = sorted(map(_cost, plans))
    return replace(least, message=message, details={**least.details, "costs_of_starts": costs})


def _others(
    search: Search, plans: list[ContinuationResult], routes: Ways, along: bool
) -> Iterator[ContinuationResult]:
    """Further plans, as long as one may be cheaper than those that there are; those along routes stay on their side."""
    for number, (way, plan) in enumerate(routes, 2):
        search.note(way, plan.outcome.value, plan.error)
        if plan.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        if _counts(plan):
            yield plan
        if number == ROUTES:
            break
    allowed = len(search.records) + BUDGET
    nothing = NOTHING * OBJECTIVES[search.base.objective].scale(search.problem.scales)
    for start in range(1, STARTS):
        least = min(plans, key=_cost)
        agreed = sum(_alike(plan, least) for plan in plans) == AGREEING
        if agreed or _cost(least) <= nothing or len(search.records) > allowed:
            return
        search.way = f"start {start + 1} of {STARTS} for less {search.base.objective}"
        plan = _from_start(search, start)
        search.note(search.way, plan.outcome.value, plan.error)
        if _counts(plan) and (not along or on_its_side(search.problem, plan)):
            yield plan


def _from_start(search: Search, start: int) -> ContinuationResult:
    """What a seeded start leads to, the search for least cost included. Errors: Ctrl-C's."""
    random = np.random.default_rng([search.base.seed, start])
    initial = drawn(search.problem, random, WIDTHS[start % len(WIDTHS)])
    plan = search.attempt(replace(search.problem, initial=initial), start)
    if plan.outcome is Outcome.CONVERGED:
        plan = search.finished(plan, search.base)
    if plan.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return plan


def on_its_side(problem: PlanningProblem, plan: ContinuationResult) -> bool:
    """Whether a plan stays on the start's side of every separating surface, as what goes along a route does."""
    control = plan.control
    flow = flow_through(problem.system, control.basis, control.horizon, plan.integrator, ())
    path = flow.states(problem.start_point, control.coefficients)
    determinants = numeric_system(problem.system).determinants(path)
    return all(bool(keeps_sign(determinants[name])) for name in problem.system.separating())


def _numbered(search: Search, plan: ContinuationResult) -> ContinuationResult:
    """The plan of the last try, with its number."""
    return replace(plan, details={**plan.details, "attempt": len(search.tried) - 1})


def _counts(plan: ContinuationResult) -> bool:
    return plan.outcome is Outcome.CONVERGED and "objective_value" in plan.details


def _cost(plan: ContinuationResult) -> float:
    """What a plan costs by the objective that was searched for less."""
    return float(plan.details["objective_value"])


def _alike(one: ContinuationResult, other: ContinuationResult) -> bool:
    return abs(_cost(one) - _cost(other)) <= ALIKE * abs(_cost(other))
