"""fatrop behind CasADi's nlpsol: the one place that knows its options and words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.declared import check, positive, whole
from nhpocp.errors import InvalidProblemError
from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.optimizer import Optimum, Programme, Watch, optimum


@dataclass(frozen=True)
class Fatrop(Constructed):
    """fatrop, which exploits the stages; needs a programme that has them. [Vanroye et al. 2023]"""

    tolerance: float = positive(1e-6, "on optimality and constraints, scaled")
    max_iterations: int = whole(1000, "iterations before giving up")
    kind: ClassVar[str] = "fatrop"
    takes_derivatives: ClassVar[bool] = False  # CasADi's interface has no place for them
    heeds_stops: ClassVar[bool] = False  # nor for a callback between iterations

    def __post_init__(self) -> None:
        check(self)

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
        solution = solver(x0=start, lbg=programme.lower, ubg=programme.upper)
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
        return optimum(programme, solution, stats, outcome, status, int(stats["iter_count"]), "")
