"""IPOPT behind CasADi's nlpsol: the one place that knows its options and words."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.declared import check, positive, whole
from nhpocp.errors import InvalidProblemError
from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.optimizer import Look, Optimum, Programme, Watch, iteration, optimum

# ma27, ma57, ma86 and pardiso are absent from CasADi's wheel, ma97 crashes the interpreter at exit
LINEAR_SOLVERS = ("mumps", "spral")
RANGE = 1e-9  # half of one, in the place of an equation
ENDINGS = {
    "Solve_Succeeded": Outcome.CONVERGED,
    "Infeasible_Problem_Detected": Outcome.INFEASIBLE,
    "Restoration_Failed": Outcome.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Outcome.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Outcome.ITERATION_LIMIT,
    "Search_Direction_Becomes_Too_Small": Outcome.STAGNATED,
    "Solved_To_Acceptable_Level": Outcome.CONVERGED,  # the level is the tolerance asked for, see `Ipopt`
    "Not_Enough_Degrees_Of_Freedom": Outcome.INFEASIBLE,
    "Feasible_Point_Found": Outcome.CONVERGED,  # as many equations as unknowns: nothing is left to optimise
    "Diverging_Iterates": Outcome.DIVERGED,
    "Invalid_Number_Detected": Outcome.NOT_FINITE,
    "User_Requested_Stop": Outcome.INTERRUPTED,
}


@dataclass(frozen=True)
class Ipopt(Constructed):
    """IPOPT with exact derivatives where the programme has them, else a limited-memory Hessian. [Wächter, Biegler]

    linear_solver: one that `nhpocp doctor` lists, mumps unless said.
    """

    tolerance: float = positive(1e-6, "on optimality and constraints, scaled")
    max_iterations: int = whole(1000, "iterations before giving up")
    linear_solver: str = "mumps"
    kind: ClassVar[str] = "ipopt"
    takes_derivatives: ClassVar[bool] = True
    heeds_stops: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check(self)
        if self.linear_solver not in LINEAR_SOLVERS:
            raise InvalidProblemError(
                f"linear solver {self.linear_solver!r}; available: {', '.join(LINEAR_SOLVERS)} (see `nhpocp doctor`)",
                path="solvers.nlp",
            )

    def settings(self) -> dict[str, Any]:
        return {"plugin": self.kind, "tolerance": self.tolerance, "max_iterations": self.max_iterations}

    def _options(self, log: Path, exact: bool, warm: bool) -> dict[str, Any]:
        """exact: the Hessian is; warm: multipliers come with the start."""
        options: dict[str, Any] = {
            "tol": min(self.tolerance, 1e-8),
            "constr_viol_tol": min(self.tolerance, 1e-7),
            # aims at 1e-8; gets stuck above it in a valley of equal optima, as systems with symmetries have them
            "acceptable_iter": 0,
            "acceptable_tol": self.tolerance,
            "acceptable_dual_inf_tol": self.tolerance,
            "acceptable_compl_inf_tol": self.tolerance,
            "acceptable_constr_viol_tol": min(self.tolerance, 1e-9),
            # 5 by default: 16 iterations on the paper's task with `default`, 14 with 2; elsewhere as many or fewer
            "filter_reset_trigger": 2,
            "max_iter": self.max_iterations,
            "linear_solver": self.linear_solver,
            "print_level": 0,
            "sb": "yes",
            "output_file": str(log),
            "file_print_level": 5,
        }
        if not exact:
            options["hessian_approximation"] = "limited-memory"
        if warm:
            options.update(warm_start_init_point="yes", mu_init=1e-6, warm_start_bound_push=1e-8)
        return options

    def solve(
        self, programme: Programme, start: Array, multipliers: Array | None = None, watch: Watch | None = None
    ) -> Optimum:
        functions: dict[str, Any] = dict(programme.functions)
        nlp = functions.pop("nlp")
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "ipopt.log"
            exact = "hess_lag" in functions or "exact" in functions
            options = self._options(file, exact, warm=multipliers is not None)
            callback = _Callback(programme.size, len(programme.lower), watch) if watch else None
            plugin: dict[str, Any] = {
                "print_time": False,
                "show_eval_warnings": False,
                "error_on_fail": False,
                # ∇f + ∇gᵀλ by AD, which nobody asks for and a kernel does not have
                "no_nlp_grad": True,
                "calc_lam_p": False,
                "ipopt": options,
            }
            plugin.update(
                {name: functions[name] for name in ("grad_f", "jac_g", "hess_lag") if name in functions}
            )
            if callback:
                plugin["iteration_callback"] = callback
            solver = ca.nlpsol("ipopt", "ipopt", nlp, plugin)
            if callback:
                callback.history = lambda: solver.stats().get("iterations", {})
            lower, upper = _ranges(programme)
            warm = {} if multipliers is None else {"lam_g0": multipliers}
            try:
                solution = solver(x0=start, lbg=lower, ubg=upper, **warm)
            finally:
                if callback:  # two that hold each other would never be freed
                    callback.history = dict
            log = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
        stats = solver.stats()
        if callback:
            callback.history = partial(dict, stats.get("iterations") or {})
        status = str(stats["return_status"])
        outcome = ENDINGS.get(status, Outcome.SOLVER_ERROR)
        # where IPOPT never started it has no history, and its count is garbage
        count = int(stats["iter_count"]) if stats.get("iterations") else 0
        return optimum(programme, solution, stats, outcome, status, count, log)


class _Callback(ca.Callback):
    """CasADi's iteration callback: asks ``watch`` whether to stop."""

    def __init__(self, size: int, constraints: int, watch: Watch) -> None:
        ca.Callback.__init__(self)
        self._sizes = {"x": size, "lam_x": size, "g": constraints, "lam_g": constraints, "f": 1, "lam_p": 0}
        self._watch, self._count = watch, 0
        self.history: Look = dict  # IPOPT's own, as far as it has come
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return ca.nlpsol_out(i)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        stop = self._watch(self._count, float(arguments[1]), partial(self._look, self._count))
        self._count += 1
        return [int(stop)]

    def _look(self, k: int) -> Mapping[str, Any]:
        return iteration(self.history(), k)


def _ranges(programme: Programme) -> tuple[Array, Array]:
    """The bounds for IPOPT, which refuses more equations than unknowns, be they met or not: ranges in their place."""
    lower, upper = programme.lower, programme.upper
    equations = lower == upper
    half = RANGE * equations if equations.sum() > programme.size else 0.0
    return lower - half, upper + half
