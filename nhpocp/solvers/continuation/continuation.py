"""The Jacobian (endogenous configuration space) continuation, [Paper] eqs. (16)-(17).

The loop is written once; how long a step is (`StepRule`), how J is inverted (`GeneralizedInverse`), how λ is measured
(`Metric`), how the robot is integrated (`Integrator`) and differentiated (`EndPointMapFactory`) are objects passed in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from math import log
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.deferred import Deferred
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, EndPointMapFactory
from nhpocp.flow.integrators import Integrator, RungeKutta4, enough_steps, resolving
from nhpocp.flow.simulation import simulate
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Progress, Solution, Solver
from nhpocp.solvers.continuation.evaluation import Evaluation, Evaluator
from nhpocp.solvers.continuation.generalized_inverses import GeneralizedInverse, MoorePenrose
from nhpocp.solvers.continuation.initial_control import NoStartError, initial_coefficients
from nhpocp.solvers.continuation.step_error import StepError
from nhpocp.solvers.continuation.step_rules import Euler, StepRule
from nhpocp.solvers.least_cost.least_cost import LeastCost, Residual
from nhpocp.solvers.least_cost.null_space import LimitReached
from nhpocp.solvers.metrics import CoefficientMetric, Coordinates, Metric

RESOLVED = 0.25  # of the tolerance: the error of integration that a search for less may run into
DIVERGED_ABOVE = 1e3  # times (1 + the first error): far outside any workspace
STAGNATION_WINDOW = 50  # updates
STAGNATION_SHARE = 0.01  # of the decay that the step sizes promise


@dataclass(frozen=True)
class Continuation:
    """Solver: drives the end-point error E to zero along (16), one step rule at a time.

    ``sensitivity`` makes the end-point map; the default differentiates the integrator, `VariationalEndPointMap`
    integrates (11)-(12). ``objective``: once the goal is reached, the cost (a name of `OBJECTIVES`) that motion in the
    null space of J then minimises. ``tolerance`` is on E [radians; lengths divided by the problem's error_length].
    """

    step_rule: StepRule = field(default_factory=Euler)
    inverse: GeneralizedInverse = field(default_factory=MoorePenrose)
    metric: Metric = field(default_factory=CoefficientMetric)
    integrator: Integrator = field(default_factory=RungeKutta4)
    sensitivity: EndPointMapFactory = DifferentiatedEndPointMap
    tolerance: float = 1e-3
    max_iterations: int = 500
    objective: str = "none"
    seed: int = 0
    name: ClassVar[str] = "jacobian"

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
        return solution(self, problem, self.find(problem, progress))

    def find(self, problem: PlanningProblem, progress: Progress | None = None, updates: int = 0) -> Found:
        """The control alone, without the motion that it makes: what strategies of many tries need.

        ``updates``: those that led to the problem's initial control, where this solve goes on with another's.
        """
        return _Run(self, problem, progress, updates).found()


@dataclass(frozen=True)
class Found:
    """How a continuation ended, and with what control."""

    outcome: Outcome
    message: str
    error: float  # E as the continuation believes
    control: Control
    records: list[Deferred]
    details: dict[str, Any]
    build_seconds: float
    solve_seconds: float
    updates: int = 0  # that led to the control

    @property
    def rank(self) -> float:
        """The error, for choosing the best of several."""
        return self.error if np.isfinite(self.error) else np.inf


def solution(solver: Solver, problem: PlanningProblem, found: Found) -> Solution:
    """What was found, with the motion that its control makes."""
    motion = simulate(problem, found.control)
    advice = "" if found.outcome is Outcome.CONVERGED else f" {found.outcome.advice}"
    settings = solver.settings()
    return Solution(
        problem=problem,
        solver=solver.name,
        settings=settings,
        tolerance=solver.tolerance,
        outcome=found.outcome,
        message=f"{found.message}.{advice}",
        final_error=found.error,
        control=found.control,
        trajectory=motion.trajectory,
        costs=motion.costs,
        iterations=found.records,
        evaluations=len(found.records),
        objective=settings["objective"],
        details=found.details,
        warnings=_of_steps(settings, problem.basis),
        timing={"build_s": found.build_seconds, "solve_s": found.solve_seconds},
    )


def _of_steps(settings: dict[str, Any], basis: ControlBasis) -> list[str]:
    """What is to be said of the steps of an integration that a basis asks for more of."""
    given = settings.get("steps")
    taken = given and enough_steps(given, basis)
    if taken == given or settings["integrator"] == "cvodes":
        return []
    return [
        f"{given} steps cannot resolve a control over {basis.size} functions of {basis.kind}: {taken} were taken"
    ]


class _Run:
    """One solve: the state of the loop and its records."""

    def __init__(
        self, solver: Continuation, problem: PlanningProblem, progress: Progress | None, updates: int
    ) -> None:
        solver = replace(solver, integrator=resolving(solver.integrator, problem.basis))
        self.solver, self.problem, self.progress = solver, problem, progress
        began = perf_counter()
        self.horizon = problem.horizon.fixed
        self.map = solver.sensitivity(
            problem.system,
            problem.basis,
            self.horizon,
            problem.start_point,
            solver.integrator,
            [task.share for task in problem.tasks[:-1]],
            along=solver.inverse.looks_along,
        )
        coordinates = Coordinates.natural(solver.metric, problem.basis, problem.scales.inputs, self.horizon)
        self.evaluator = Evaluator(problem, self.map, solver.inverse, coordinates)
        self.records: list[Deferred] = []
        self.updates, self.limit = updates, solver.max_iterations * solver.step_rule.evaluations
        self.details: dict[str, Any] = {}
        self.phase = f"to the goal ({solver.step_rule.kind})"
        self.here: Evaluation | None = None
        self.interruption = Interruption()
        self.build_seconds = perf_counter() - began

    def found(self) -> Found:
        began = perf_counter()
        first = np.zeros((self.problem.system.input_space.size, self.problem.basis.size))
        with Interruption() as self.interruption:
            try:
                first = initial_coefficients(self.problem, self.map, self.solver.seed)
                outcome, message = self.iterate(first)
            except NoStartError as error:
                outcome, message = Outcome.RANK_DEFICIENT, f"`initial: auto`: {error.message}"
            except LimitReached:
                outcome = Outcome.ITERATION_LIMIT
                message = f"E = {self.here.error if self.here else np.nan:.3g} after {len(self.records)} evaluations"
            except KeyboardInterrupt:
                outcome, message = Outcome.INTERRUPTED, "Stopped by hand"
            except MemoryError as error:
                outcome, message = Outcome.SOLVER_ERROR, f"Out of memory: {error}"
            except RuntimeError as error:  # CasADi and SUNDIALS report through RuntimeError
                outcome = Outcome.INTERRUPTED if self.interruption.noted else Outcome.SOLVER_ERROR
                message = f"CasADi failed: {str(error).strip().splitlines()[-1]}"
            seconds = perf_counter() - began
            return Found(
                outcome,
                message,
                self.here.error if self.here else np.nan,
                self.problem.control(self.here.coefficients if self.here else first, self.horizon),
                self.records,
                self.details,
                self.build_seconds,
                seconds,
                self.updates,
            )

    def iterate(self, first: Array) -> tuple[Outcome, str]:
        """The loop of (17): evaluate, stop or step."""
        here = self.evaluate(first, 0.0)
        for current in chain([here], self.solver.step_rule.updates(here, self.evaluate)):
            self.accept(current)
            ended = self.ended(current)
            if (
                ended
                and ended[0] is Outcome.CONVERGED
                and (self.solver.objective != "none" or self.problem.bounds)
                and current.coefficients.size  # without inputs there is nothing to choose
            ):
                return self.improve(current)
            if ended:
                return ended
        return Outcome.STAGNATED, f"E = {self.records[-1]['error']:.3g}: no step, however short, reduces it"

    def improve(self, reached: Evaluation) -> tuple[Outcome, str]:
        """Every bound, and the least cost, without leaving the goal; the better control becomes the current one."""
        solver = self.solver
        resolution = StepError(self.problem, solver.integrator, self.horizon)
        at_first = resolution.error(reached.coefficients, reached.end.state)
        allowed = max(RESOLVED * solver.tolerance, 2.0 * at_first)

        def attempt(coefficients: Array) -> Residual | None:
            try:
                tried = self.evaluate(coefficients, 0.0)
            except RuntimeError:  # a trial that CasADi cannot integrate
                if self.interruption.noted:
                    raise
                return None
            if tried.failure or tried.crossing or tried.vector is None or tried.jacobian is None:
                return None
            resolved = resolution.error(coefficients, tried.end.state) <= allowed
            return Residual(tried.vector, tried.jacobian, tried.end.path) if resolved else None

        self.phase = "into the bounds" if solver.objective == "none" else f"to the least {solver.objective}"
        self.limit += solver.max_iterations  # bounds each of the two phases
        search = LeastCost(
            self.problem,
            self.horizon,
            solver.integrator,
            self.map.times,
            solver.objective,
            solver.tolerance,
            attempt,
            reached.coefficients,
        )
        found = search.run()
        if found.coefficients is not reached.coefficients:
            self.limit += 1
            reached = self.evaluate(found.coefficients, 0.0)
            self.accept(reached)
        self.details = found.details
        return found.outcome, f"{self.arrived(reached)}; {found.sentence}"

    def arrived(self, here: Evaluation) -> str:
        """The sentence of a control that reaches the goal."""
        return f"E = {here.error:.3g} after {self.updates} updates"

    def evaluate(self, coefficients: Array, gamma: float) -> Evaluation:
        """Where a control leads; every call leaves a record, which counts as refused until it is accepted."""
        self.interruption.check()
        if len(self.records) > self.limit:
            raise LimitReached
        if self.records and not self.records[-1]["accepted"]:
            self.records[-1] |= {"k": self.updates}  # it was a trial, and refused
        evaluation = self.evaluator(coefficients)
        change = norm((coefficients - self.here.coefficients).ravel()) if self.here else 0.0
        known = {
            "k": self.updates + (self.here is not None),
            "error": evaluation.error if np.isfinite(evaluation.error) else None,
            "step": float(change),
            "gamma": gamma,
            "accepted": False,
        }
        self.records.append(Deferred(partial(self.evaluator.looked_at, evaluation), known))
        if self.progress:
            self.progress(self.records[-1] | self.prospect(evaluation.error))
        return evaluation

    def prospect(self, error: float) -> dict[str, Any]:
        """What a listener is told besides, see `Progress`."""
        solver, reached = self.solver, self.here is not None and self.here.error < self.solver.tolerance
        return {
            "tolerance": solver.tolerance,
            "phase": self.phase,
            "at_most": self.limit - len(self.records) + 1,
            "expected": None if reached else solver.step_rule.updates_left(error, solver.tolerance),
        }

    def accept(self, here: Evaluation) -> None:
        """Makes an evaluated control the current one; the last record is its own."""
        self.updates += self.here is not None
        self.here = here
        self.records[-1] |= {"k": self.updates, "accepted": True}

    def ended(self, here: Evaluation) -> tuple[Outcome, str] | None:
        """Whether the loop stops here, and with what sentence."""
        k, error = self.updates, here.error
        first = self.records[0]["error"]
        if here.failure:
            return here.failure.outcome, f"Update {k}: {here.failure.sentence}"
        if error < self.solver.tolerance:
            if here.crossing:
                sentence = f"E = {error:.3g} is below the tolerance, but {here.crossing.sentence}"
                return here.crossing.outcome, sentence
            return Outcome.CONVERGED, self.arrived(here)
        direction = here.direction
        lost = error > DIVERGED_ABOVE * (1 + first)
        deficient = direction is not None and direction.blocked
        if (lost or deficient) and here.crossing:
            return here.crossing.outcome, f"Update {k}: {here.crossing.sentence}"
        if lost:
            return Outcome.DIVERGED, f"Update {k}: E = {error:.3g}, from {first:.3g} at the start"
        if direction is not None and deficient:
            rows = sum(task.size for task in self.problem.tasks)
            values = " ".join(f"{x:.2g}" for x in direction.singular_values)
            sentence = f"the Jacobian has rank {direction.rank} of {rows} (singular values {values}), E = {error:.3g}"
            return Outcome.RANK_DEFICIENT, f"Update {k}: {sentence}"
        if len(self.records) > self.limit:
            sentence = f"E = {error:.3g} after {len(self.records)} evaluations"
            return Outcome.ITERATION_LIMIT, f"{sentence}, tolerance {self.solver.tolerance:g}"
        return self.stagnation()

    def stagnation(self) -> tuple[Outcome, str] | None:
        """Whether the error fell by less than a share of what the last steps promised, Σγ on the log scale."""
        accepted = [record for record in self.records if record["accepted"]]
        if len(accepted) <= STAGNATION_WINDOW:
            return None
        errors = [record["error"] for record in accepted]
        best, before = min(errors), min(errors[:-STAGNATION_WINDOW])
        promised = sum(record["gamma"] for record in accepted[-STAGNATION_WINDOW:])
        if best > 0 and log(before / best) >= STAGNATION_SHARE * promised:
            return None
        return (
            Outcome.STAGNATED,
            f"E = {best:.3g} at best, and no better over the last {STAGNATION_WINDOW} updates",
        )
