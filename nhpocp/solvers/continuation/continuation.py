"""The Jacobian (endogenous configuration space) continuation, [Paper] eqs. (16)-(17).

The loop is written once; how long a step is (`StepRule`), how J is inverted (`GeneralizedInverse`), how λ is measured
(`Metric`), how the robot is integrated (`Integrator`) and differentiated (`EndPointMapFactory`) are objects passed in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import chain
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.declared import check
from nhpocp.errors import expect
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, EndPointMapFactory
from nhpocp.flow.integrators import Integrator, RungeKutta4
from nhpocp.flow.step_error import StepError, finer, resolving
from nhpocp.interruption import STOPPED
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.ending import Ending
from nhpocp.solvers.continuation.evaluation import Evaluation, Evaluator
from nhpocp.solvers.continuation.generalized_inverses import GeneralizedInverse, MoorePenrose
from nhpocp.solvers.continuation.initial_control import NoStartError, initial_coefficients
from nhpocp.solvers.continuation.recorded_evaluator import RecordedEvaluator
from nhpocp.solvers.continuation.resolved_residuals import ResolvedResiduals
from nhpocp.solvers.continuation.step_rules import Euler, StepRule
from nhpocp.solvers.continuation.stop_criteria import StopCriteria, arrival
from nhpocp.solvers.least_cost.least_cost import LeastCost
from nhpocp.solvers.metrics import CoefficientMetric, Coordinates, Metric


@dataclass(frozen=True)
class Continuation(Constructed):
    """Solver: drives the end-point error E to zero along (16), one step rule at a time.

    step_rule: `Adaptive()`, `Euler(gamma)` as in (17), `Ode(gamma)`, or your own `StepRule`. inverse: `MoorePenrose()`,
    `Damped()`, `Transpose()` or `Lagrangian()`. metric: the size of a control, `CoefficientMetric()` or `L2Metric()`.
    integrator: `RungeKutta4(steps)`, `CasadiRungeKutta(steps)` or `Cvodes()`. sensitivity: makes the end-point map; the
    default differentiates the integrator, `VariationalEndPointMap` integrates (11)-(12).
    """

    step_rule: StepRule = field(default_factory=Euler)
    inverse: GeneralizedInverse = field(default_factory=MoorePenrose)
    metric: Metric = field(default_factory=CoefficientMetric)
    integrator: Integrator = field(default_factory=RungeKutta4)
    sensitivity: EndPointMapFactory = DifferentiatedEndPointMap
    tolerance: float = declared.positive(
        1e-3, "the E [rad] that counts as reached; lengths are divided by the problem's error_length"
    )
    max_iterations: int = declared.whole(500, "updates before giving up")
    objective: str = declared.choice(
        "none",
        ["none", *costs_of_motion()],
        "what motion in the null space of J minimises, or none",
    )
    seed: int = declared.whole(0, "of everything random")
    name: ClassVar[str] = "jacobian"

    def __post_init__(self) -> None:
        check(self)
        expect(self.step_rule, StepRule, "a step rule such as Adaptive()", "Continuation.step_rule")
        expect(self.inverse, GeneralizedInverse, "an inverse such as MoorePenrose()", "Continuation.inverse")
        expect(self.metric, Metric, "a metric such as L2Metric()", "Continuation.metric")
        expect(self.integrator, Integrator, "an integrator such as RungeKutta4()", "Continuation.integrator")

    def settings(self) -> dict[str, Any]:
        return {
            "step_rule": self.step_rule.kind,
            **self.step_rule.settings(),
            "inverse": self.inverse.kind,
            "metric": self.metric.kind,
            "tolerance": self.tolerance,
            "max_iterations": self.max_iterations,
            "integrator": self.integrator.kind,
            "steps": getattr(self.integrator, "steps", None),
            "sensitivity": "automatic" if self.sensitivity is DifferentiatedEndPointMap else "variational",
            "objective": self.objective,
            "seed": self.seed,
        }

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        return self.find(problem, progress).solution(self, problem)

    def find(
        self, problem: PlanningProblem, progress: Progress | None = None, updates: int = 0
    ) -> ContinuationResult:
        """The control alone, without the motion that it makes: what strategies of many tries need.

        ``updates``: those that led to the problem's initial control, where this solve goes on with another's.
        """
        return _Loop(self, problem, progress, updates).result()


class _Loop:
    """One solve: the loop of (17), and the search for least cost at its end."""

    def __init__(
        self, solver: Continuation, problem: PlanningProblem, progress: Progress | None, updates: int
    ) -> None:
        began = perf_counter()
        solver = replace(solver, integrator=resolving(solver.integrator, problem.basis))
        self.solver, self.problem, self.horizon = solver, problem, problem.horizon.fixed
        self.integrator = solver.integrator
        evaluator = self._evaluator()
        self.map = evaluator.map
        rule, tolerance = solver.step_rule, solver.tolerance
        self.budget = Budget(1 + solver.max_iterations * rule.evaluations)
        self.evaluate = RecordedEvaluator(evaluator, self.budget, rule, tolerance, progress, updates)
        self.criteria = StopCriteria(tolerance, sum(task.size for task in problem.tasks), self.budget)
        self.details: dict[str, Any] = {}
        self.build_seconds = perf_counter() - began

    def _evaluator(self) -> Evaluator:
        """Of controls, by the integrator of the moment."""
        solver, problem = self.solver, self.problem
        end_point_map = solver.sensitivity(
            problem.system,
            problem.basis,
            self.horizon,
            problem.start_point,
            self.integrator,
            [task.share for task in problem.tasks[:-1]],
            along=solver.inverse.looks_along,
        )
        coordinates = Coordinates.natural(solver.metric, problem.basis, problem.scales.inputs, self.horizon)
        return Evaluator(problem, end_point_map, solver.inverse, coordinates)

    def result(self) -> ContinuationResult:
        """Of the whole solve, whatever happens."""
        began = perf_counter()
        first = np.zeros((self.problem.system.input_space.size, self.problem.basis.size))
        with self.evaluate.interruption as interruption:
            try:
                first = initial_coefficients(self.problem, self.map, self.solver.seed)
                outcome, message = self._iterate(first)
            except NoStartError as error:
                outcome, message = Outcome.RANK_DEFICIENT, f"`initial: auto`: {error.message}"
            except KeyboardInterrupt:
                outcome, message = Outcome.INTERRUPTED, STOPPED
            except MemoryError as error:
                outcome, message = Outcome.SOLVER_ERROR, f"Out of memory: {error}"
            except RuntimeError as error:  # CasADi and SUNDIALS report through RuntimeError
                outcome = Outcome.INTERRUPTED if interruption.noted else Outcome.SOLVER_ERROR
                message = f"CasADi failed: {str(error).strip().splitlines()[-1]}"
            seconds, here = perf_counter() - began, self.evaluate.here
            return ContinuationResult(
                outcome,
                message,
                here.error if here else np.nan,
                self.problem.control(here.coefficients if here else first, self.horizon),
                self.evaluate.records,
                self.details,
                self.build_seconds,
                seconds,
                self.integrator,
                self.evaluate.updates,
            )

    def _iterate(self, first: Array) -> Ending:
        """(17): evaluate, stop or step."""
        here = self.evaluate(first, 0.0)
        for current in chain([here], self.solver.step_rule.updates(here, self.evaluate)):
            if self.budget.refused:
                break
            here = current
            self.evaluate.accept(here)
            ending = self.criteria.ending(here, self.evaluate.accepted, self.evaluate.updates)
            if ending and ending.outcome is Outcome.CONVERGED and self._leaves_a_choice(here):
                return self._improve(here)
            if ending:
                return ending
        if self.budget.refused:
            sentence = f"E = {here.error:.3g} after {self.budget.taken} evaluations"
            return Ending(Outcome.ITERATION_LIMIT, sentence)
        return Ending(Outcome.STAGNATED, f"E = {here.error:.3g}: no step, however short, reduces it")

    def _leaves_a_choice(self, reached: Evaluation) -> bool:
        """Whether more is asked for than the goal; without inputs there is nothing to choose."""
        asked = self.solver.objective != "none" or bool(self.problem.bounds)
        return asked and bool(reached.coefficients.size)

    def _improve(self, reached: Evaluation) -> Ending:
        """Every bound, and the least cost, without leaving the goal; the better control becomes the current one."""
        evaluate, allowed = self.evaluate, self.solver.max_iterations
        wanted = (
            "into the bounds" if self.solver.objective == "none" else f"to the least {self.solver.objective}"
        )
        evaluate.phase = wanted
        self.budget.extend(allowed)  # bounds each of the phases
        improved = self._least_cost(reached).run()
        if improved.held:  # by a surface that no path crosses, or where these steps are too coarse
            evaluate.phase, self.integrator = f"{wanted}, with finer steps", finer(self.integrator)
            evaluate.evaluator = self._evaluator()
            self.budget.extend(1 + allowed)
            off = self._least_cost(evaluate(improved.coefficients, 0.0)).run(off=True)
            if off.moved:
                improved = replace(off, details={**improved.details, **off.details})
        if improved.moved:
            self.budget.extend(1)
            reached = evaluate(improved.coefficients, 0.0)
            evaluate.accept(reached)
        self.details = improved.details
        return Ending(improved.outcome, f"{arrival(reached.error, evaluate.updates)}; {improved.sentence}")

    def _least_cost(self, reached: Evaluation) -> LeastCost:
        """The search from a control that reaches the goal."""
        solver, problem = self.solver, self.problem
        step_error = StepError(problem, self.integrator, self.horizon)
        residuals = ResolvedResiduals(self.evaluate, step_error, reached, solver.tolerance)
        return LeastCost(
            problem,
            self.horizon,
            self.integrator,
            solver.objective,
            solver.tolerance,
            residuals,
            reached.coefficients,
        )
