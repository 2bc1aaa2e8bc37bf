"""The Jacobian (endogenous configuration space) continuation, [Paper] eqs. (16)-(17).

The loop is written once; how long a step is (`StepRule`), how J is inverted (`GeneralizedInverse`), how λ is measured
(`Metric`), how the robot is integrated (`Integrator`) and differentiated (`EndPointMapFactory`) are objects passed in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import log
from time import perf_counter
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, EndPoint, EndPointMapFactory
from nhpocp.flow.integrators import Integrator, RungeKutta4
from nhpocp.flow.simulation import simulate
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Progress, Solution
from nhpocp.solvers.end_point_error import EndPointError
from nhpocp.solvers.generalized_inverses import (
    CoefficientMetric,
    Direction,
    GeneralizedInverse,
    Metric,
    MoorePenrose,
)
from nhpocp.solvers.initial_control import NoStartError, initial_coefficients
from nhpocp.solvers.interruption import Interruption
from nhpocp.systems.numeric import NumericSystem

DIVERGED_ABOVE = (
    1e3  # times (1 + the first error): far outside any workspace measured in the problem's own units
)
SINGULAR = {"s": Outcome.SINGULAR_S, "w": Outcome.SINGULAR_W}  # by the name of the regularity matrix
SINGULAR_BELOW = 0.05  # |det| against its value at the start, before a path that is not finite
STAGNATION_WINDOW = 50  # iterations
STAGNATION_SHARE = 0.01  # of the decay that the step sizes promise


@dataclass(frozen=True)
class Evaluation:
    """One control and where it leads."""

    coefficients: Array
    end: EndPoint
    residual: EndPointError | None  # None where the end point is not finite or at π
    direction: Direction | None
    failure: Outcome | None = None
    message: str = ""

    @property
    def error(self) -> float:
        """E, infinite where there is none."""
        return self.residual.norm if self.residual else np.inf


Evaluate = Callable[[Array, float], Evaluation]


class StepRule(Protocol):
    """How far to go along the full step; may evaluate as often as it needs."""

    kind: ClassVar[str]

    def step(self, here: Evaluation, evaluate: Evaluate) -> Evaluation:
        """The next control, evaluated: ``evaluate(coefficients, γ)`` records it."""
        ...

    def settings(self) -> dict[str, Any]:
        """The rule's own settings under the problem file's names."""
        ...


@dataclass(frozen=True)
class Euler:
    """Λ ← Λ - γ J^# e, [Paper] eq. (17). The paper names no γ; 0.1 is ours."""

    gamma: float = 0.1
    kind: ClassVar[str] = "euler"

    def step(self, here: Evaluation, evaluate: Evaluate) -> Evaluation:
        change = here.direction.step.reshape(here.coefficients.shape) if here.direction else 0.0
        return evaluate(here.coefficients + self.gamma * change, self.gamma)

    def settings(self) -> dict[str, Any]:
        return {"gamma": self.gamma}


@dataclass(frozen=True)
class Continuation:
    """Solver: drives the end-point error E to zero along (16), one step rule at a time.

    ``sensitivity`` makes the end-point map; the default differentiates the integrator, `VariationalEndPointMap`
    integrates (11)-(12). ``tolerance`` is on E [radians; lengths divided by the problem's error_length].
    """

    step_rule: StepRule = field(default_factory=Euler)
    inverse: GeneralizedInverse = field(default_factory=MoorePenrose)
    metric: Metric = field(default_factory=CoefficientMetric)
    integrator: Integrator = field(default_factory=RungeKutta4)
    sensitivity: EndPointMapFactory = DifferentiatedEndPointMap
    tolerance: float = 1e-3
    max_iterations: int = 500
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
            "seed": self.seed,
        }

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        return _Run(self, problem, progress).solve()


class _Run:
    """One solve: the state of the loop and its records."""

    def __init__(self, solver: Continuation, problem: PlanningProblem, progress: Progress | None) -> None:
        self.solver, self.problem, self.progress = solver, problem, progress
        began = perf_counter()
        self.horizon = problem.horizon.fixed
        self.numeric = NumericSystem(problem.system)
        self.map = solver.sensitivity(
            problem.system, problem.basis, self.horizon, problem.start_point, solver.integrator
        )
        self.factor = solver.metric.factor(problem.basis, problem.system.input_space.size, self.horizon)
        self.records: list[dict[str, Any]] = []
        self.warnings: list[str] = []
        self.here: Evaluation | None = None
        self.interruption = Interruption()
        self.build_seconds = perf_counter() - began

    def solve(self) -> Solution:
        began = perf_counter()
        first = np.zeros((self.problem.system.input_space.size, self.problem.basis.size))
        with Interruption() as self.interruption:
            try:
                first = initial_coefficients(self.problem, self.map, self.solver.seed)
                outcome, message = self.iterate(first)
            except NoStartError as error:
                outcome, message = Outcome.RANK_DEFICIENT, f"`initial: auto`: {error.message}"
            except KeyboardInterrupt:
                outcome, message = Outcome.INTERRUPTED, "Stopped by hand"
            except RuntimeError as error:  # CasADi and SUNDIALS report through RuntimeError
                outcome = Outcome.SOLVER_ERROR
                message = f"CasADi failed: {str(error).strip().splitlines()[-1]}"
            seconds = perf_counter() - began
            return self.solution(outcome, message, self.here.coefficients if self.here else first, seconds)

    def iterate(self, first: Array) -> tuple[Outcome, str]:
        """The loop of (17): evaluate, stop or step."""
        here = self.evaluate(first, 0.0)
        while True:
            self.here = here
            ended = self.ended(here)
            if ended:
                return ended
            here = self.solver.step_rule.step(here, self.evaluate)

    def ended(self, here: Evaluation) -> tuple[Outcome, str] | None:
        """Whether the loop stops here, and with what sentence."""
        k, error = len(self.records) - 1, here.error
        first = self.records[0]["error"]
        if here.failure:
            return here.failure, f"Iteration {k}: {here.message}"
        if error < self.solver.tolerance:
            jumped = self.sign_change(here.end.path)
            if jumped:
                return jumped[0], f"E = {error:.3g} is below the tolerance, but {jumped[1]}"
            return Outcome.CONVERGED, f"E = {error:.3g} after {k} updates"
        if error > DIVERGED_ABOVE * (1 + first):
            jumped = self.sign_change(here.end.path)
            return jumped or (
                Outcome.DIVERGED,
                f"Iteration {k}: E = {error:.3g}, from {first:.3g} at the start",
            )
        direction, rows = here.direction, len(self.problem.error_rows)
        if direction is not None and direction.rank < rows:
            return self.sign_change(here.end.path) or (
                Outcome.RANK_DEFICIENT,
                f"Iteration {k}: the Jacobian has rank {direction.rank} of {rows} "
                f"(singular values {' '.join(f'{x:.2g}' for x in direction.singular_values)}), E = {error:.3g}",
            )
        if k >= self.solver.max_iterations:
            return (
                Outcome.ITERATION_LIMIT,
                f"E = {error:.3g} after {k} updates, tolerance {self.solver.tolerance:g}",
            )
        return self.stagnation(k)

    def stagnation(self, k: int) -> tuple[Outcome, str] | None:
        """Whether the error fell by less than a share of what the last steps promised, Σγ on the log scale."""
        if k < STAGNATION_WINDOW:
            return None
        errors = [record["error"] if record["error"] is not None else np.inf for record in self.records]
        best, before = min(errors), min(errors[:-STAGNATION_WINDOW])
        promised = sum(record["gamma"] for record in self.records[-STAGNATION_WINDOW:])
        if log(before / best) >= STAGNATION_SHARE * promised:
            return None
        return (
            Outcome.STAGNATED,
            f"E = {best:.3g} at best, and no better over the last {STAGNATION_WINDOW} updates",
        )

    def evaluate(self, coefficients: Array, gamma: float) -> Evaluation:
        """Where a control leads; every call leaves a record."""
        evaluation = self.evaluation(coefficients, gamma)
        margins = self.margins(evaluation.end.path)
        values = evaluation.direction.singular_values if evaluation.direction else np.array([np.nan])
        change = np.linalg.norm(coefficients - self.here.coefficients) if self.here else 0.0
        record = {
            "k": len(self.records),
            "error": evaluation.error if np.isfinite(evaluation.error) else None,
            "step": float(change),
            "gamma": gamma,
            "rank": evaluation.direction.rank if evaluation.direction else None,
            "sigma_jacobian": float(values[-1]),
            **margins,
        }
        self.records.append(record)
        if self.progress:
            self.progress(record)
        self.interruption.check()
        return evaluation

    def evaluation(self, coefficients: Array, gamma: float) -> Evaluation:
        end = self.map(coefficients)
        if not (np.isfinite(end.path).all() and np.isfinite(end.jacobian).all()):
            outcome, message = self.blow_up(end.path)
            return Evaluation(coefficients, end, None, None, outcome, message)
        residual = EndPointError(self.problem, end)
        if residual.half_turn:
            message = f"the orientation error is {residual.angle:.9f} rad, a half turn"
            return Evaluation(coefficients, end, None, None, Outcome.ORIENTATION_AT_PI, message)
        direction = self.solver.inverse(residual.jacobian, residual.vector, self.factor)
        return Evaluation(coefficients, end, residual, direction)

    def margins(self, path: Array) -> dict[str, float | None]:
        """Least σ of each regularity matrix over the finite part of the path."""
        finite = path[np.isfinite(path).all(axis=1)]
        margins = self.numeric.margins(finite, self.problem.scale)
        found = {name: v[np.isfinite(v)] for name, v in margins.items() if name.startswith("sigma")}
        return {name: float(values.min()) if values.size else None for name, values in found.items()}

    def sign_change(self, path: Array) -> tuple[Outcome, str] | None:
        """The first change of sign of a determinant that these equations invert, as an ending."""
        for name, values in self.breaking_determinants(path).items():
            changes = np.flatnonzero(np.sign(values) * np.sign(values[0]) <= 0)
            if changes.size and changes[0] == 0:
                return SINGULAR.get(name, Outcome.NOT_FINITE), f"det {name.upper()} vanishes at the start"
            if changes.size:
                times = self.map.times[changes[0] - 1 : changes[0] + 1]
                sentence = f"det {name.upper()} changes sign between t = {times[0]:.4g} and {times[1]:.4g}"
                return SINGULAR.get(name, Outcome.NOT_FINITE), sentence
        return None

    def blow_up(self, path: Array) -> tuple[Outcome, str]:
        """Why a path is not finite: it ran into a singular surface (a fixed step may land on either side), or not."""
        crossed = self.sign_change(path)
        if crossed:
            return crossed
        for name, values in self.breaking_determinants(path).items():
            share = np.abs(values / values[0])
            if share.min() < SINGULAR_BELOW:
                where = self.map.times[int(np.argmin(share))]
                sentence = (
                    f"det {name.upper()} falls to {share.min():.2g} of its first value at t = {where:.4g}"
                )
                return SINGULAR.get(name, Outcome.NOT_FINITE), sentence
        return self.overflow(path)

    def breaking_determinants(self, path: Array) -> dict[str, Array]:
        """The determinants that the system's equations divide by, along the finite part of a path."""
        finite = path[np.isfinite(path).all(axis=1)]
        determinants = self.numeric.determinants(finite)
        # undefined counts as zero: a leg along its own w4 axis has no w3
        return {name: np.nan_to_num(determinants[name], nan=0.0) for name in self.problem.system.breaking()}

    def overflow(self, path: Array) -> tuple[Outcome, str]:
        good = int(np.isfinite(path).all(axis=1).sum())
        where = self.map.times[min(good, len(self.map.times) - 1)]
        return Outcome.NOT_FINITE, f"the integration is not finite from t = {where:.4g} on"

    def solution(self, outcome: Outcome, message: str, coefficients: Array, seconds: float) -> Solution:
        control = self.problem.control(coefficients, self.horizon)
        motion = simulate(self.problem, control, self.numeric)
        advice = "" if outcome is Outcome.CONVERGED else f" {outcome.advice}"
        return Solution(
            problem=self.problem,
            solver=self.solver.name,
            settings=self.solver.settings(),
            tolerance=self.solver.tolerance,
            outcome=outcome,
            message=f"{message}.{advice}",
            final_error=self.here.error if self.here else np.nan,
            control=control,
            trajectory=motion.trajectory,
            costs=motion.costs,
            iterations=self.records,
            evaluations=len(self.records),
            warnings=self.warnings,
            timing={"build_s": self.build_seconds, "solve_s": seconds},
        )
