"""What an optimizer is asked and hands back, whichever it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.outcome import Outcome


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


def optimum(
    programme: Programme,
    solution: Mapping[str, Any],
    stats: Mapping[str, Any],
    outcome: Outcome,
    status: str,
    count: int,
    log: str,
) -> Optimum:
    history = stats.get("iterations") or {}
    records = [iteration(history, k) for k in range(len(history.get("obj", [])))]
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


def iteration(history: Mapping[str, Sequence[float]], k: int) -> dict[str, Any]:
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
    left = {"x": start, "lam_g": np.zeros(len(programme.lower))}
    status = f"an error ({str(error).strip().splitlines()[-1]})"
    counts = {"n_call_nlp_g": 0}
    return replace(optimum(programme, left, counts, Outcome.SOLVER_ERROR, status, 0, str(error)), cut_back=0)
