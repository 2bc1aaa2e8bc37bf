"""What to try when the direct way fails: other starts, the goal walked up to, manoeuvres in sequence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations
from time import perf_counter
from typing import Any, ClassVar

from nhpocp import declared
from nhpocp.constraints.leg_acceleration import lacking_derivative
from nhpocp.constructed import Constructed
from nhpocp.declared import check, whole_number
from nhpocp.deferred import Deferred
from nhpocp.errors import expect
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution, telling
from nhpocp.solvers.continuation.along_routes import AlongRoutes
from nhpocp.solvers.continuation.cheapest import cheapest
from nhpocp.solvers.continuation.confirmation import begun_from, confirmed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.ending import Ending
from nhpocp.solvers.continuation.geodesic import Geodesic
from nhpocp.solvers.continuation.joined_plans import JoinedPlans
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.route.find_route import lacking
from nhpocp.solvers.route.wanted import ROUTE, ROUTE_SECONDS, ROUTES

EVALUATIONS = 25  # per try: starts that lead to the goal need 5 to 20
SAME = 0.01  # of a violation: how far two may be apart that count as one
BUDGET = 3000  # evaluations, after which no new try begins
FUTILE = 2  # starts that end outside a bound, after which a route is looked for
FURTHER = 2  # times the restarts: seeded starts that are tried where all else failed


@dataclass(frozen=True)
class Auto(Constructed):
    """Solver: the adaptive continuation, and what else may reach the goal, in this order.

    1. From the problem's own start (a seeded one if that has no full rank). 2. From ``restarts`` seeded starts.
    3. Manoeuvres: a route of poses from start to goal (`find_route`) in pieces, each planned from small seeded
    controls, joined into one control of basis `sequence`. (7) is driftless and, where S is regular and the growth
    vector is (3, 6), locally controllable, so every path clear of the singularities can be followed so; systems with
    drift go without. Without a route, the geodesic takes its place. 4. The goal walked along the geodesic from the
    pose that the best of the starts reaches. 5. That start again, beyond the few evaluations that every try has been
    given until then.

    The search for least cost (`Continuation.objective`) ends in the valley where it begins, and few of them are deep:
    it follows on the first way that reaches the goal, and again from seeded starts until six agree on the least. Where
    that way led along a route, plans along eight routes are merged (`Merging`) and compared before.
    continuation: the method that every try is made with. restarts: seeded starts. route: "auto", or "always" first of
    all, or "never". route_seconds: processor time for which one is looked for, at most.
    Errors: `InvalidProblemError` for restarts that are no whole number, `CallError` for another method;
    `MissingDependencyError` where a route is wanted always and OMPL is not installed.
    """

    continuation: Continuation = field(default_factory=lambda: Continuation(step_rule=Adaptive()))
    restarts: int = 4
    route: str = declared.choice("auto", ROUTES, ROUTE)
    route_seconds: float = declared.positive(10.0, ROUTE_SECONDS)
    name: ClassVar[str] = "jacobian"

    def __post_init__(self) -> None:
        check(self)
        expect(self.continuation, Continuation, "a Continuation", "Auto.continuation")
        whole_number(self.restarts, "Auto.restarts")

    @property
    def tolerance(self) -> float:
        return self.continuation.tolerance

    def settings(self) -> dict[str, Any]:
        routes = {"route": self.route, "route_seconds": self.route_seconds}
        return {**self.continuation.settings(), "step_rule": "auto", **routes}

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        with Interruption():  # also between the tries; the next one stops at once
            return _Search(self, problem, progress).result().solution(self, problem)


class _Search:
    """One solve of `Auto`: the ways in order, and the records of all that was evaluated on them."""

    def __init__(self, solver: Auto, problem: PlanningProblem, progress: Progress | None) -> None:
        self.base, self.restarts = solver.continuation, solver.restarts
        self.route = solver.route
        self.along_routes = AlongRoutes(self, solver.route_seconds, required=solver.route == "always")
        # what the first search leaves of them is for the cheapest
        self._plans_along_routes = self._along_a_route()
        self._rates = {bound.label for bound in problem.bounds_on_rates}
        self.problem, self.progress = problem, progress
        self.joined = JoinedPlans(self)
        self.records: list[Deferred] = []
        self.tried: list[dict[str, Any]] = []
        self.way = ""  # what is being tried, in words
        self.solves = 0
        self.stalled: list[tuple[float, set[str]]] = []  # violations where ways rest, and what is broken
        self.given_up = False  # for want of evaluations

    def result(self) -> ContinuationResult:
        """The first try whose control a finer simulation confirms; otherwise the one that came nearest."""
        began = perf_counter()
        ended: list[ContinuationResult] = []
        ways, stopped = self._ways(), False  # held, for one that is let go closes what it yields from
        try:
            for way, result in ways:
                ended.append(result)
                self.note(way, result.outcome.value, result.error)
                if result.outcome in (Outcome.CONVERGED, Outcome.INTERRUPTED):
                    break
        except KeyboardInterrupt:
            stopped = True
        if not ended:
            self.way = self._own_start
            with Interruption(patient=True):
                ended.append(self.attempt(self.problem, 0))  # which stops at once
            self.note(self.way, ended[-1].outcome.value, ended[-1].error)
        last = ended[-1]
        best = last if last.outcome is Outcome.CONVERGED else min(ended, key=_nearness)
        outcome, message = self._ending(best, stopped or last.outcome is Outcome.INTERRUPTED)
        best = replace(best, outcome=outcome, message=message)
        if outcome is Outcome.CONVERGED and "objective_value" in best.details:
            best = cheapest(self, best, self._plans_along_routes)
        unseen = self.along_routes.sketch if best.outcome is not Outcome.CONVERGED else {}
        return replace(
            best,
            records=self.records,
            details={**unseen, **best.details, "tried": self.tried},
            solve_seconds=perf_counter() - began - best.build_seconds,
        )

    def _ending(self, best: ContinuationResult, stopped: bool) -> Ending:
        """Of all tries, which end with the best."""
        ways, no_route = len(self.tried), self.along_routes.no_route
        if best.outcome is Outcome.CONVERGED:
            after = f", by {self.tried[-1]['way']}, after {ways - 1} other ways" if ways > 1 else ""
            return Ending(best.outcome, best.message + after)
        if stopped:
            return Ending(Outcome.INTERRUPTED, STOPPED)
        if best.outcome is Outcome.CONSTRAINT_VIOLATED:
            no_route = f"; {no_route}" if no_route else ""
            return Ending(best.outcome, f"{best.message}; {ways} ways were tried{no_route}")
        given_up = f"Given up after {len(self.records)} evaluations. " if self.given_up else ""
        no_route = f" {no_route[:1].upper()}{no_route[1:]}." if no_route else ""
        each = "; ".join(f"{way['way']}: {way['outcome']} (E = {way['error']:.3g})" for way in self.tried)
        return Ending(
            Outcome.NOT_REACHED, f"Nothing that was tried reached the goal.{no_route} {given_up}{each}"
        )

    def note(self, way: str, outcome: str, error: float) -> None:
        """A way that has ended, and what was evaluated on it."""
        evaluations = len(self.records) - sum(entry["evaluations"] for entry in self.tried)
        self.tried.append({"way": way, "outcome": outcome, "error": error, "evaluations": evaluations})

    def _ways(self) -> Iterator[tuple[str, ContinuationResult]]:
        """Every way in order, each tried when it is asked for."""
        problem, starts, futile = self.problem, list[ContinuationResult](), 0
        if self.route == "always":
            yield from self._plans_along_routes
        for way, result in self._starts(range(1 + self.restarts)):
            starts.append(result)
            finished = self._remembered(self.finished(result, self.base))
            yield way, finished
            if self._hopeless(only_rates=True):
                return
            futile += bool(self._broken(finished) - self._rates)
            if self._hopeless() or (futile == FUTILE and self.route == "auto" and not lacking(problem)):
                break
        if self.given_up:
            return
        if self.route == "auto":
            yield from self._plans_along_routes
        geodesic = Geodesic(self)
        # a drift moves the pose between manoeuvres, and forbids them another time than the one they were planned for
        controls = (
            geodesic.manoeuvres() if problem.system.driftless and not self.along_routes.followed else None
        )
        if controls is not None:
            yield f"{len(controls)} manoeuvres in sequence", self.joined.plan(controls, 0)
        if self._hopeless():
            return
        nearest = min(starts, key=lambda result: result.rank)
        walked = geodesic.walk(nearest)
        if walked is not None:
            yield "walking the goal", self.finished(walked, self.base)
        for way, result in self._starts(range(1 + self.restarts, 1 + (1 + FURTHER) * self.restarts)):
            yield way, self._remembered(self.finished(result, self.base))
            if self._hopeless():
                return
        if nearest.outcome is Outcome.ITERATION_LIMIT and self.base.max_iterations > EVALUATIONS:
            self.way = "the nearest start, to the end"
            solver = replace(self.base, objective="none")
            longer = self.solve(
                solver, begun_from(replace(problem, bounds=()), nearest.control), nearest.updates
            )
            yield self.way, self.finished(longer, self.base)

    def _along_a_route(self) -> Iterator[tuple[str, ContinuationResult]]:
        """Manoeuvres along a route of poses, where there is one."""
        for way, controls, steps, sketch in self.along_routes.ways():
            plan = self.joined.plan(controls, steps)
            yield way, replace(plan, details={**plan.details, **sketch})

    def telling(self, way: str) -> None:
        """Says what is being tried."""
        self.way = way
        if self.progress is not None:
            self.progress({"k": None, "error": None, "stage": self.way})

    @property
    def _own_start(self) -> str:
        """The problem's own, in words."""
        return "the given start" if self.problem.initial is not None else "a seeded start"

    def _starts(self, numbers: range) -> Iterator[tuple[str, ContinuationResult]]:
        """Where these starts lead, 0 being the problem's own."""
        own = self._own_start
        for start in numbers:
            if not self.may_try():
                return
            tried = self.problem if start == 0 else replace(self.problem, initial=None)
            way = own if start == 0 else f"seeded start {start}"
            self.way = own if start == 0 else f"{way} of {numbers[-1]}"
            yield way, self.attempt(tried, start)

    def _remembered(self, result: ContinuationResult) -> ContinuationResult:
        """Itself; the least violation of the bounds near its control is kept, if the search came to rest there."""
        known = result.details.get("constraints", {})
        if known.get("stalled"):
            self.stalled.append((known["stalled"], self._broken(result)))
        return result

    @staticmethod
    def _broken(result: ContinuationResult) -> set[str]:
        """The bounds outside which a search ended."""
        return set(result.details.get("constraints", {}).get("broken", ()))

    def _hopeless(self, only_rates: bool = False) -> bool:
        """Whether two ways have come to rest at one violation, the least that there seems to be; a judgement, no proof.

        ``only_rates``: of bounds that more manoeuvring makes worse.
        """
        return any(
            abs(one - other) <= SAME * max(one, other)
            and (not only_rates or (broken | others) <= self._rates)
            for (one, broken), (other, others) in combinations(self.stalled, 2)
        )

    def solve(self, solver: Continuation, problem: PlanningProblem, updates: int = 0) -> ContinuationResult:
        """A confirmed solve, its records among the search's."""
        self.solves += 1
        told = telling(self.progress, way=f"try {self.solves}: {self.way}")
        result = confirmed(solver, problem, told, updates)
        attempt = len(self.tried)
        self.records += [record | {"attempt": attempt} for record in result.records]
        return result

    def may_try(self) -> bool:
        """Whether there are evaluations for another try; what has begun well is finished without."""
        self.given_up = len(self.records) > BUDGET
        return not self.given_up

    def attempt(self, problem: PlanningProblem, seed: int) -> ContinuationResult:
        """The continuation to the goal alone, given up soon; converged only if confirmed."""
        limit = min(self.base.max_iterations, EVALUATIONS)
        solver = replace(self.base, objective="none", max_iterations=limit, seed=self.base.seed + seed)
        return self.solve(solver, replace(problem, bounds=()) if problem.bounds else problem)

    def finished(self, first: ContinuationResult, solver: Continuation) -> ContinuationResult:
        """The second phase, for a try that has reached the goal: least cost, and the bounds.

        What had reached the goal is kept where the second phase ends with a claim that finer steps refute.
        """
        if first.outcome is not Outcome.CONVERGED or (solver.objective == "none" and not self.problem.bounds):
            return first
        objective = OBJECTIVES.get(solver.objective)
        if objective and (words := objective.lacking_control(first.control.basis)):
            first = replace(
                first, message=f"{first.message}; not searched for less {objective.name}: {words}"
            )
            if not self.problem.bounds:
                return first
            solver = replace(solver, objective="none")
        if words := lacking_derivative(self.problem.bounds, first.control.basis):
            words = f"{first.message}; {words} from one piece to the next"
            return replace(first, outcome=Outcome.CONSTRAINT_VIOLATED, message=words)
        second = self.solve(solver, begun_from(self.problem, first.control), first.updates)
        if second.outcome in (Outcome.CONVERGED, Outcome.CONSTRAINT_VIOLATED, Outcome.INTERRUPTED):
            return second
        if self.problem.bounds:
            return replace(second, outcome=Outcome.CONSTRAINT_VIOLATED)
        return replace(
            first, message=f"{first.message}; finer steps refuted the search for less {solver.objective}"
        )


def _nearness(result: ContinuationResult) -> tuple[bool, float]:
    """For the least: what only breaks a bound comes first, then the smallest error."""
    return result.outcome is not Outcome.CONSTRAINT_VIOLATED, result.rank
