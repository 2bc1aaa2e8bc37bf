"""What to try when the direct way fails: other starts, the goal walked up to, manoeuvres in sequence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.controls.sequence import join
from nhpocp.errors import OrientationAtPiError
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem import Horizon, PlanningProblem
from nhpocp.solution import Outcome, Progress, Solution
from nhpocp.solvers.continuation import Continuation
from nhpocp.solvers.step_rules import Adaptive
from nhpocp.systems.numeric import numeric_system

FINER = 4  # times the steps of a claim, for the check that a strategy makes of it
PIECES = (1, 2, 4, 8, 16)
SEEDS = 8  # per manoeuvre
SPREAD = 0.5  # standard deviation of a manoeuvre's first coefficients, times its duration
EVALUATIONS = 60  # per try: starts that lead to the goal need 5 to 30
HALVINGS = 6  # of the walk along the goal's geodesic


@dataclass(frozen=True)
class Auto:
    """Solver: the adaptive continuation, and what else may reach the goal, in this order.

    1. From the problem's own start (a seeded one if that has no full rank). 2. From ``restarts`` seeded starts.
    3. The goal walked along the geodesic from the pose that a start reaches. 4. Manoeuvres: the geodesic from start to
    goal cut into 1, 2, 4, … pieces, each planned from small seeded controls over its share of the horizon, joined into
    one control of basis `sequence`, and the waste taken out of the whole. (7) is driftless and, where S is regular and
    the growth vector is (3, 6), locally controllable, so every path clear of the singularities can be followed so.
    A claim counts only if a simulation with ``FINER`` times as many steps confirms it.
    """

    continuation: Continuation = field(default_factory=lambda: Continuation(step_rule=Adaptive()))
    restarts: int = 4
    name: ClassVar[str] = "jacobian"

    @property
    def tolerance(self) -> float:
        return self.continuation.tolerance

    def settings(self) -> dict[str, Any]:
        return {**self.continuation.settings(), "step_rule": "auto"}

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        began = perf_counter()
        tried: list[dict[str, Any]] = []
        records: list[dict[str, Any]] = []
        best: Solution | None = None
        for words, solution in self._attempts(problem, progress):
            records += [{**record, "attempt": len(tried)} for record in solution.iterations]
            good = solution.outcome is Outcome.CONVERGED and self._confirmed(problem, solution.control)
            outcome = (
                solution.outcome.value
                if good or solution.outcome is not Outcome.CONVERGED
                else "not_confirmed"
            )
            tried.append(
                {
                    "way": words,
                    "outcome": outcome,
                    "error": solution.final_error,
                    "evaluations": solution.evaluations,
                }
            )
            if best is None or good or solution.final_error < best.final_error:
                best = solution
            if good or solution.outcome is Outcome.INTERRUPTED:
                break
        else:
            good = False
        if best is None:
            raise RuntimeError("a strategy without attempts")
        return self._ended(problem, best, good, tried, records, perf_counter() - began)

    def _ended(
        self,
        problem: PlanningProblem,
        best: Solution,
        good: bool,
        tried: list[dict[str, Any]],
        records: list[dict[str, Any]],
        seconds: float,
    ) -> Solution:
        outcome, message = best.outcome, best.message
        if good and len(tried) > 1:
            message = f"{best.message[:-1]} by {tried[-1]['way']}, after {len(tried) - 1} other tries."
        if not good and outcome is not Outcome.INTERRUPTED:
            outcome = Outcome.NOT_REACHED
            ways = "; ".join(
                f"{entry['way']}: {entry['outcome']} (E = {entry['error']:.3g})" for entry in tried
            )
            message = f"Nothing that was tried reached the goal. {ways}."
        return replace(
            best,
            problem=problem,
            settings=self.settings(),
            outcome=outcome,
            message=message,
            iterations=records,
            evaluations=len(records),
            details={**best.details, "tried": tried},
            timing={"build_s": best.timing["build_s"], "solve_s": max(0.0, seconds - best.timing["build_s"])},
        )

    def _attempts(
        self, problem: PlanningProblem, progress: Progress | None
    ) -> Iterator[tuple[str, Solution]]:
        """Every way in order, solved when it is asked for."""
        base = replace(self.continuation, max_iterations=min(self.continuation.max_iterations, EVALUATIONS))
        first = base.solve(problem, progress)
        yield "the given start" if problem.initial is not None else "a seeded start", first
        reached = [first]
        for seed in range(1, self.restarts + 1):
            solver = replace(base, seed=base.seed + seed)
            solution = solver.solve(replace(problem, initial=None), progress)
            reached.append(solution)
            yield f"seeded start {seed}", solution
        walked = self._walk(problem, reached, progress)
        if walked is not None:
            yield "walking the goal", walked
        for pieces in PIECES:
            sequence = self._manoeuvres(problem, pieces, progress)
            if sequence is not None:
                yield f"{pieces} manoeuvre{'s' if pieces > 1 else ''} in sequence", sequence

    def _walk(
        self, problem: PlanningProblem, reached: list[Solution], progress: Progress | None
    ) -> Solution | None:
        """Goal continuation: from the pose that the best start reaches to the goal, in steps that succeed."""
        usable = [solution for solution in reached if np.isfinite(solution.final_error)]
        if not usable or set(problem.goal) != set(problem.system.state_space.names):
            return None
        best = min(usable, key=lambda solution: solution.final_error)
        space = problem.system.state_space
        here = self._end(problem, best.control)
        coefficients, share, step = np.array(best.control.coefficients), 0.0, 0.5
        solution: Solution | None = None
        if not np.isfinite(here).all():
            return None
        try:
            tangent = space.difference(problem.goal_point, here)
        except OrientationAtPiError:
            return None
        while share < 1.0 and step > 0.5**HALVINGS:
            towards = min(1.0, share + step)
            pose = space.unpack(np.asarray(space.retract(here, towards * tangent)))
            tried = replace(problem, goal=pose if towards < 1.0 else problem.goal, initial=coefficients)
            solution = replace(self.continuation, objective="none").solve(tried, progress)
            if solution.outcome is Outcome.CONVERGED:
                coefficients, share, step = np.array(solution.control.coefficients), towards, 1.5 * step
            else:
                step *= 0.5
        return self.continuation.solve(replace(problem, initial=coefficients), progress)

    def _manoeuvres(
        self, problem: PlanningProblem, pieces: int, progress: Progress | None
    ) -> Solution | None:
        """The geodesic in pieces, one plan after another; None where a piece cannot be planned."""
        space, horizon = problem.system.state_space, problem.horizon.fixed / pieces
        try:
            tangent = space.difference(problem.goal_point, problem.start_point)
        except OrientationAtPiError:
            return None
        here, controls = problem.start_point, []
        for piece in range(1, pieces + 1):
            pose = space.unpack(np.asarray(space.retract(problem.start_point, piece / pieces * tangent)))
            goal = {name: pose[name] for name in problem.goal} if piece < pieces else problem.goal
            part = replace(
                problem,
                start=space.unpack(here),
                goal=goal,
                horizon=Horizon(horizon),
                initial=None,
                bounds=(),
                via=(),
            )
            found = self._piece(part, progress)
            if found is None:
                return None
            controls.append(found.control)
            here = self._end(part, found.control)
        joined = join(controls)
        whole = replace(problem, basis=joined.basis, initial=joined.coefficients)
        objective = self.continuation.objective
        # every piece was planned with the solver's own number of steps
        integrator = self.continuation.integrator
        if isinstance(integrator, RungeKutta4):
            integrator = RungeKutta4(pieces * integrator.steps)
        solver = replace(
            self.continuation, objective="effort" if objective == "none" else objective, integrator=integrator
        )
        return replace(solver.solve(whole, progress), problem=problem)

    def _piece(self, part: PlanningProblem, progress: Progress | None) -> Solution | None:
        """One manoeuvre: the shortest of the plans that the first seeds find."""
        solver = replace(self.continuation, objective="none", max_iterations=EVALUATIONS)
        shape = (part.system.input_space.size, part.basis.size)
        found = []
        for seed in range(SEEDS):
            random = np.random.default_rng(self.continuation.seed + seed)
            start = random.normal(0.0, SPREAD / part.horizon.fixed, shape)
            solution = solver.solve(replace(part, initial=start), progress)
            if solution.outcome is Outcome.CONVERGED and self._confirmed(part, solution.control):
                found.append(solution)
            if len(found) == 2 or solution.outcome is Outcome.INTERRUPTED:
                break
        return min(found, key=lambda solution: solution.control.effort, default=None)

    def _end(self, problem: PlanningProblem, control: Control) -> Array:
        """Where a control leads, with finer steps than the claim's."""
        steps = FINER * getattr(self.continuation.integrator, "steps", 100)
        flow = RungeKutta4(steps).flow(
            numeric_system(problem.system).rate_function, control.basis, control.horizon
        )
        return flow.end(problem.start_point, control.coefficients)

    def _confirmed(self, problem: PlanningProblem, control: Control) -> bool:
        return bool(problem.goal_error(self._end(problem, control)) <= self.tolerance)
