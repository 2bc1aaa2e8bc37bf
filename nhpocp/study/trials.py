"""How good the trials of an optimised study are, by the rows of their runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nhpocp.study.optimisation import Level, Objective
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


def known(study: Study, store: Store) -> Study:
    """An optimised study with the trials of which its store has a run; of one between that it has not, None."""
    points: dict[int, Level] = {}
    for row in store.rows():
        parameters = json.loads(row["parameters"])
        trial = (row["run"] - 1) // len(study.runs_of_trial(1))
        points.setdefault(trial, tuple(parameters[path] for path in study.design.factors[0].paths))
    nothing = (None,) * len(study.design.factors[0].paths)
    return study.proposed([points.get(trial, nothing) for trial in range(max(points, default=-1) + 1)])


def front(trials: Iterable[Trial], objectives: Sequence[Objective]) -> list[Trial]:
    """The feasible trials than which no other is as good by every objective; the best by the first of them first."""
    feasible = [(trial.merits(objectives), trial.number, trial) for trial in trials if not trial.failed]
    best: list[tuple[list[float], Trial]] = []
    for mine, _, trial in sorted(feasible, key=lambda each: each[:2]):
        if not any(all(a <= b for a, b in zip(other, mine, strict=True)) for other, _ in best):
            best.append((mine, trial))
    return [trial for _, trial in best]
