"""What a solver recorded of its evaluations, as arrays for pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution

Record = Mapping[str, Any]


def column(records: Iterable[Record], name: str) -> Array:
    """One entry of every record, NaN where it is missing."""
    values = [record.get(name) for record in records]
    return np.array([np.nan if value is None else float(value) for value in values])


def positive(values: Array) -> Array:
    """Numbers for a log axis, NaN where there is none."""
    return np.where(np.isfinite(values) & (values > 0), values, np.nan)


def accepted(records: Iterable[Record]) -> Array:
    return np.array([bool(record.get("accepted", True)) for record in records], dtype=bool)


def own_records(solution: Solution, kept: bool = True) -> list[Record]:
    """The accepted records, or the refused, of the try that the solution came from: the last, or else the best."""
    tries: dict[Any, list[Record]] = {}
    for record in solution.iterations:
        tries.setdefault(record.get("attempt"), []).append(record)

    def least(records: Sequence[Record]) -> float:
        return float(
            np.min(column(records, "error"), initial=np.inf, where=np.isfinite(column(records, "error")))
        )

    every = list(tries.values()) or [[]]
    own = every[-1] if solution.outcome is Outcome.CONVERGED else min(every, key=least)
    return [record for record, there in zip(own, accepted(own), strict=True) if there == kept]


def error_history(solution: Solution, kept: bool = True) -> tuple[Array, Array]:
    """(k, E) of `own_records`; E is NaN where it is missing or not a positive number."""
    records = own_records(solution, kept)
    ks = [record.get("k", i) for i, record in enumerate(records)]
    return np.array(ks, dtype=float), positive(column(records, "error"))


def step_sums(solution: Solution) -> tuple[Array, Array] | None:
    """(θ, log of the product of 1-γ) at every accepted record, or None where the solver names no γ.

    A record's own ``gamma`` is the step that led to it; without one it is the setting's.
    """
    common = solution.settings.get("gamma")
    steps = [record.get("gamma", common) for record in own_records(solution)]
    if solution.solver != "jacobian" or len(steps) < 2 or any(step is None for step in steps[1:]):
        return None
    gammas = np.array([0.0, *(float(step) for step in steps[1:])])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.cumsum(gammas), np.cumsum(np.log1p(-np.minimum(gammas, 1.0)))


def decays(solution: Solution) -> tuple[Array, Array] | None:
    """E as eqs. (9) and (17) promise it from the first E on: E(0) e^{-γθ} and E(0) (1-γ)^k at every accepted record."""
    sums, (_, errors) = step_sums(solution), error_history(solution)
    known = np.flatnonzero(np.isfinite(errors))
    if sums is None or not len(known):
        return None
    first = known[0]
    with np.errstate(invalid="ignore", over="ignore"):
        exponential = errors[first] * np.exp(sums[0][first] - sums[0])
        geometric = errors[first] * np.exp(sums[1] - sums[1][first])
    return exponential, positive(geometric)
