"""In which order, and how many together, the runs of a study are performed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from nhpocp.study.study import Study

TOGETHER = 32  # runs of a job: they are planned and verified in company, and stored together


@dataclass(frozen=True)
class Piece:
    """Runs of one solver that differ in their goals alone; before: the run whose plan the first begins with."""

    runs: tuple[int, ...]
    before: int | None = None


def pieces(study: Study, done: set[int], points: range | None = None) -> Iterator[Piece]:
    """Every run that is not done, once; ``points``: of these design points alone, all goals of each."""
    points = range(len(study.design)) if points is None else points
    many, goals = len(study.solvers), study.design.goals
    places = _nearest(study) if study.order == "nearest" else range(goals)
    for group in range(points.start // goals, points.stop // goals):
        for solver in range(many):
            numbers = ((group * goals + place) * many + solver + 1 for place in places)
            while part := list(islice(numbers, TOGETHER)):
                yield from _missing(part, done, chained=study.order == "nearest")


def _missing(part: Sequence[int], done: set[int], chained: bool) -> Iterator[Piece]:
    """What is left of runs in a row; chained: each begins with the plan to the one before it."""
    if not chained:
        if left := tuple(run for run in part if run not in done):
            yield Piece(left)
        return
    left_here: list[int] = []
    before: int | None = None
    for run in part:
        if run not in done:
            left_here.append(run)
            continue
        if left_here:
            yield Piece(tuple(left_here), before)
            left_here = []
        before = run
    if left_here:
        yield Piece(tuple(left_here), before)


def one_by_one(piece: Piece, chained: bool) -> Iterator[Piece]:
    """Its runs, each a piece of its own."""
    before = piece.before
    for run in piece.runs:
        yield Piece((run,), before)
        before = run if chained else None


def _nearest(study: Study) -> list[int]:
    """The places of the goals so that each is the nearest of those left to the one before it; the first is the first.

    Distances are of levels: an axis counts its values by their range, what is no number by its place.
    """
    columns = [
        _scaled([study.design.point(place)[path] for place in range(study.design.goals)])
        for path in sorted(study.goal_axes)
    ]
    if not columns:
        return [0]
    points = np.stack(columns, axis=1)
    left, order = np.ones(len(points), dtype=bool), [0]
    left[0] = False
    for _ in range(len(points) - 1):
        distances = np.sum((points - points[order[-1]]) ** 2, axis=1)
        order.append(int(np.argmin(np.where(left, distances, np.inf))))
        left[order[-1]] = False
    return order


def _scaled(values: Sequence[Any]) -> Any:
    numeric = all(isinstance(value, int | float) for value in values)
    if not numeric:
        names = [json.dumps(value, default=str) for value in values]
        places = {name: place for place, name in enumerate(dict.fromkeys(names))}
        values = [places[name] for name in names]
    column = np.asarray(values, dtype=float)
    return (column - column.min()) / (np.ptp(column) or 1.0)
