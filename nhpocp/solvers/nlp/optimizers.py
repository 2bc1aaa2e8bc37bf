"""NLP solvers behind CasADi's nlpsol: IPOPT and fatrop. The one place that knows their options and words."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.outcome import Outcome

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


class Programme(Protocol):
    """A nonlinear programme: what a transcription offers an optimizer."""

    size: int

    @property
    def lower(self) -> Array: ...

    @property
    def upper(self) -> Array: ...

    @property
    def nlp(self) -> ca.Function:
        """x, p ↦ f, g, which CasADi can differentiate."""
        ...

    @property
    def functions(self) -> Mapping[str, Any]:
        """ "nlp", which may be a faster one, and, where there are any, "grad_f", "jac_g", "hess_lag"."""
        ...

    @property
    def structure(self) -> Mapping[str, Any] | None:
        """Stage sizes; None where the programme has no stages."""
        ...


@dataclass(frozen=True)
class Optimum:
    """What an optimizer hands back."""

    x: Array
    objective: float
    multipliers: Array  # of the constraints
    constraints: Array
    outcome: Outcome  # its claim
    status: str  # in its own word
    iterations: list[dict[str, Any]]
    evaluations: int
    log: str
    cut_back: int  # trial steps refused because a function was not a number there


Look = Callable[[], Mapping[str, Any]]  # the rest of an iteration's record, worked out when it is asked for
Watch = Callable[[int, float, Look], bool]  # (iteration, objective, the rest) ↦ whether to stop


class Optimizer(Protocol):
    """A way to solve a `Programme`."""

    kind: ClassVar[str]
    takes_derivatives: ClassVar[bool]  # else it makes its own of the programme's `nlp`
    heeds_stops: ClassVar[bool]  # asks `Watch`; else Ctrl-C waits until it has ended

    @property
    def tolerance(self) -> float: ...

    def settings(self) -> dict[str, Any]: ...

    def solve(
        self, programme: Programme, start: Array, multipliers: Array | None = None, watch: Watch | None = None
    ) -> Optimum:
        """From a start, warm if multipliers come with it."""
        ...


@dataclass(frozen=True)
class Ipopt:
    """IPOPT with exact derivatives where the programme has them, else a limited-memory Hessian. [Wächter, Biegler]"""

    tolerance: float = 1e-6
    max_iterations: int = 1000
    linear_solver: str = "mumps"
    kind: ClassVar[str] = "ipopt"
    takes_derivatives: ClassVar[bool] = True
    heeds_stops: ClassVar[bool] = True

    def __post_init__(self) -> None:
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
            try:
                solution = _call(solver, start, *_ranges(programme), multipliers)
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
        return _optimum(programme, solution, stats, outcome, status, count, log)


@dataclass(frozen=True)
class Fatrop:
    """fatrop, which exploits the stages; needs a programme that has them. [Vanroye et al. 2023]"""

    tolerance: float = 1e-6
    max_iterations: int = 1000
    kind: ClassVar[str] = "fatrop"
    takes_derivatives: ClassVar[bool] = False  # CasADi's interface has no place for them
    heeds_stops: ClassVar[bool] = False  # nor for a callback between iterations

    def settings(self) -> dict[str, Any]:
        return {"plugin": self.kind, "tolerance": self.tolerance, "max_iterations": self.max_iterations}

    def solve(
        self, programme: Programme, start: Array, multipliers: Array | None = None, watch: Watch | None = None
    ) -> Optimum:
        structure = programme.structure
        if structure is None:
            raise InvalidProblemError(
                "fatrop needs the stages of multiple shooting; single shooting has none; use plugin: ipopt",
                path="solvers.nlp.plugin",
            )
        solver = ca.nlpsol(
            "fatrop",
            "fatrop",
            programme.nlp,
            {
                "structure_detection": "manual",
                **structure,
                "equality": [bool(same) for same in programme.lower == programme.upper],
                "print_time": False,
                "show_eval_warnings": False,
                "error_on_fail": False,
                "fatrop": {
                    "tol": min(self.tolerance, 1e-8),
                    "max_iter": self.max_iterations,
                    "print_level": 0,
                },
            },
        )
        # its warm start was slower than its cold one
        solution = _call(solver, start, programme.lower, programme.upper, None)
        stats = solver.stats()
        if stats["success"]:
            outcome = Outcome.CONVERGED
        elif not np.isfinite(np.array(solution["x"])).all():
            outcome = Outcome.NOT_FINITE
        elif stats["iter_count"] >= self.max_iterations:
            outcome = Outcome.ITERATION_LIMIT
        else:
            outcome = Outcome.INFEASIBLE
        status = str(stats.get("unified_return_status", stats["return_status"]))
        return _optimum(programme, solution, stats, outcome, status, int(stats["iter_count"]), "")


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
        return _iteration(self.history(), k)


def _call(
    solver: ca.Function, start: Array, lower: Array, upper: Array, multipliers: Array | None
) -> dict[str, ca.DM]:
    warm = {} if multipliers is None else {"lam_g0": multipliers}
    solution: dict[str, ca.DM] = solver(x0=start, lbg=lower, ubg=upper, **warm)
    return solution


def _ranges(programme: Programme) -> tuple[Array, Array]:
    """The bounds for IPOPT, which refuses more equations than unknowns, be they met or not: ranges in their place."""
    lower, upper = programme.lower, programme.upper
    equations = lower == upper
    half = RANGE * equations if equations.sum() > programme.size else 0.0
    return lower - half, upper + half


def _optimum(
    programme: Programme,
    solution: Mapping[str, ca.DM],
    stats: Mapping[str, Any],
    outcome: Outcome,
    status: str,
    count: int,
    log: str,
) -> Optimum:
    history = stats.get("iterations") or {}
    records = [_iteration(history, k) for k in range(len(history.get("obj", [])))]
    # evaluated again: an optimizer that gave up early hands back zeros
    objective, constraints = programme.functions["nlp"](solution["x"], [])
    if not records:  # fatrop keeps no history
        records = [{"k": count, "error": None, "objective": float(objective)}]
    return Optimum(
        x=np.array(solution["x"]).ravel(),
        objective=float(objective),
        multipliers=np.array(solution["lam_g"]).ravel(),
        constraints=np.array(constraints).ravel(),
        outcome=outcome,
        status=status,
        iterations=records,
        evaluations=int(stats.get("n_call_nlp_g", len(records))),
        log=log,
        cut_back=log.count("evaluation error"),
    )


def _iteration(history: Mapping[str, Sequence[float]], k: int) -> dict[str, Any]:
    """A line of IPOPT's table; its error is the primal infeasibility."""
    return {
        "k": k,
        "error": float(history["inf_pr"][k]),
        "dual_infeasibility": float(history["inf_du"][k]),
        "objective": float(history["obj"][k]),
        "barrier": float(history["mu"][k]),
        "step": float(history["alpha_pr"][k]),
    }


def failed(programme: Programme, start: Array, error: Exception) -> Optimum:
    """What is left where an optimizer raised: the start."""
    objective, constraints = programme.functions["nlp"](start, [])
    return Optimum(
        x=np.asarray(start),
        objective=float(objective),
        multipliers=np.zeros(len(programme.lower)),
        constraints=np.array(constraints).ravel(),
        outcome=Outcome.SOLVER_ERROR,
        status=f"an error ({str(error).strip().splitlines()[-1]})",
        iterations=[{"k": 0, "error": None, "objective": float(objective)}],
        evaluations=0,
        log=str(error),
        cut_back=0,
    )
