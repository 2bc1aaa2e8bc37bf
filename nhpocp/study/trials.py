"""How good the trials of an optimised study are, by the rows of their runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nhpocp.study.optimisation import Objective
from nhpocp.study.store import Store
from nhpocp.study.study import Study


@dataclass(frozen=True)
class Trial:
    """A design that was run to all its goals.

    number: from 1. point: its values by the paths of the keys that are optimised over. runs: their numbers.
    failed: how many are not solved and verified, or do not tell an objective. values: of the objectives, () where any
    failed.
    """

    number: int
    point: Mapping[str, Any]
    runs: range
    failed: int
    values: tuple[float, ...]

    def merits(self, objectives: Sequence[Objective]) -> list[float]:
        """The smaller, the better."""
        return [each.merit(value) for each, value in zip(objectives, self.values, strict=True)]


def evaluated(study: Study, store: Store, number: int) -> Trial:
    """A trial whose runs are stored."""
    runs = study.runs_of_trial(number)
    rows = list(store.rows("run BETWEEN ? AND ?", (runs[0], runs[-1])))
    columns = [[quantity.of_run(row) for row in rows if row["converged"]] for quantity in study.measured]
    told = [[value for value in column if value is not None] for column in columns]
    failed = len(rows) - min(map(len, told))
    values = [each.of_goals(column) for each, column in zip(study.measured, told, strict=True) if not failed]
    parameters = json.loads(rows[0]["parameters"])
    point = {path: parameters[path] for path in study.design.factors[0].paths}
    return Trial(number, point, runs, failed, tuple(values))


def front(trials: Iterable[Trial], objectives: Sequence[Objective]) -> list[Trial]:
    """The feasible trials than which no other is as good by every objective; the best by the first of them first."""
    feasible = [(trial.merits(objectives), trial.number, trial) for trial in trials if not trial.failed]
    best: list[tuple[list[float], Trial]] = []
    for mine, _, trial in sorted(feasible, key=lambda each: each[:2]):
        if not any(all(a <= b for a, b in zip(other, mine, strict=True)) for other, _ in best):
            best.append((mine, trial))
    return [trial for _, trial in best]
