"""An experiment: SciPy's least squares on the end-point map, without a path of controls to follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp import declared
from nhpocp.constructed import Constructed
from nhpocp.solvers.settings import SolverSettings

if TYPE_CHECKING:
    from nhpocp.arrays import Array
    from nhpocp.flow.compiled.kernels import Kernels
    from nhpocp.problem import PlanningProblem
    from nhpocp.solution import Progress, Solution, Solver


@dataclass(frozen=True)
class LeastSquaresSettings(SolverSettings):
    """An experiment: least squares on the end-point map."""

    tolerance: float = declared.positive(1e-3, "the error E that counts as reached")
    max_iterations: int = declared.count(200, "evaluations before giving up")
    steps: int = declared.count(100, "integration steps over the horizon")
    seed: int = declared.whole(0, "of a control to begin with, where the file gives none")

    meaning: ClassVar[str] = "least squares on the end-point map"

    def solver(self, kernels: Kernels | None, others: Mapping[str, Solver]) -> Solver:
        return LeastSquares(self, kernels)


@dataclass(frozen=True)
class LeastSquares(Constructed):
    """Solver: min |e(Λ)|² by a trust region, e as in [Paper] eq. (8); it knows of no bounds and lowers no cost.

    given: a `LeastSquaresSettings`. kernels: `Interpreted()`, `Compiled()` or `CompiledWhenReady()`, the default.
    Errors: `InvalidProblemError` for settings out of their limits.
    """

    given: LeastSquaresSettings
    kernels: Kernels | None = None
    name: ClassVar[str] = "least_squares"

    @property
    def tolerance(self) -> float:
        return self.given.tolerance

    def settings(self) -> dict[str, Any]:
        return asdict(self.given)

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        import numpy as np
        from scipy.optimize import least_squares

        from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
        from nhpocp.flow.integrators import RungeKutta4
        from nhpocp.interruption import Interruption
        from nhpocp.outcome import Outcome
        from nhpocp.solvers.claimed import claimed
        from nhpocp.solvers.continuation.end_point_error import EndPointError
        from nhpocp.solvers.continuation.initial_control import initial_coefficients

        began, horizon = perf_counter(), problem.horizon.fixed
        records: list[dict[str, Any]] = []
        chosen: dict[str, Any] = {} if self.kernels is None else {"kernels": self.kernels}
        fractions = [task.share for task in problem.tasks[:-1]]
        integrator = RungeKutta4(steps=self.given.steps, **chosen)
        ends = DifferentiatedEndPointMap(
            problem.system, problem.basis, horizon, problem.start_point, integrator, fractions
        )
        first = initial_coefficients(problem, ends, self.given.seed)
        units = np.repeat(problem.scales.inputs, problem.basis.size)

        def at(y: Array) -> EndPointError:
            return EndPointError(problem, ends((units * y).reshape(first.shape)))

        def residual(y: Array) -> Array:
            interruption.check()
            error, e = at(y).measured()
            records.append({"k": len(records), "error": error})
            if progress:
                progress(records[-1])
            return e

        limits = {"xtol": 1e-15, "ftol": 1e-15, "max_nfev": self.given.max_iterations}
        with Interruption() as interruption:
            fit = least_squares(residual, first.ravel() / units, lambda y: at(y).jacobian * units, **limits)
        control = problem.control((units * fit.x).reshape(first.shape), horizon)
        error, _ = at(fit.x).measured()
        reached = error <= self.tolerance
        ending = Outcome.ITERATION_LIMIT if fit.status == 0 else Outcome.STAGNATED
        outcome = Outcome.CONVERGED if reached else ending
        message = f"E = {error:.3g} after {fit.nfev} evaluations.{'' if reached else ' ' + ending.advice}"
        timing = {"build_s": 0.0, "solve_s": perf_counter() - began}
        more = {"iterations": records, "evaluations": len(records), "objective": "none", "timing": timing}
        return claimed(problem, self, control, outcome, message, error, **more)
