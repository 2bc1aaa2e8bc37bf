"""Where the runs of a study lie over its axes: in the cells of a map, or one by one where axes are drawn."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from math import prod
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.problem_file import document as documents
from nhpocp.study.design import Factor
from nhpocp.study.store import Store
from nhpocp.study.study import Study
from nhpocp.survey import Axis, Cells, Map, Points

CELLS = 60  # columns and rows of a map; more levels share them
PANELS = 4  # levels of the third axis that have a map each
POINTS = 1000  # runs of each solver that are drawn one by one
_ANGLE = re.compile(r"(.*\bpi\b.*|.* deg)")


def axes_of(study: Study) -> tuple[Axis, ...]:
    """The axes of a study as it writes them, those of the goal last."""
    block = documents.parse(study.text, None).data["study"]
    written = {**(block.get("axes") or {}), **(block.get("optimise") or {}).get("over", {})}
    return tuple(
        _axis(factor, place, written[path])
        for factor in study.design.factors
        for place, path in enumerate(factor.paths)
    )


def _axis(factor: Factor, place: int, written: Any) -> Axis:
    levels = tuple(level[place] for level in factor.levels)
    numeric = all(isinstance(level, int | float) and not isinstance(level, bool) for level in levels)
    logarithmic = isinstance(written, dict) and bool({"logspace", "loguniform"} & set(written))
    degrees = numeric and any(_ANGLE.fullmatch(word) for word in _words(written))
    return Axis(factor.paths[place], levels, factor.drawn, degrees, logarithmic)


def _words(written: Any) -> Iterator[str]:
    if isinstance(written, dict | list):
        for part in written.values() if isinstance(written, dict) else written:
            yield from _words(part)
    elif isinstance(written, str):
        yield written


class Charting:
    """Charts of the runs of a store over ``axes``; outcomes: the first is success."""

    def __init__(self, store: Store, study: Study, axes: tuple[Axis, ...], outcomes: tuple[str, ...]) -> None:
        self.store, self.study, self.axes = store, study, axes
        self.places = {outcome: place for place, outcome in enumerate(outcomes)}
        factors = study.design.factors
        # of each axis: how many points in a row have one level, and how many levels there are
        self.strides: dict[str, tuple[int, int]] = {}
        for k, factor in enumerate(factors):
            stride = prod(len(inner.levels) for inner in factors[k + 1 :])
            self.strides |= dict.fromkeys(factor.paths, (stride, len(factor.levels)))

    def chart(self, columns: Mapping[str, str], cost: str) -> Map | Points | None:
        """columns: what cells have the medians of, by quantity; cost: that of points. None without axes."""
        varied = [axis for axis in self.axes if len(axis.levels) > 1]
        if not varied:
            return None
        if any(axis.drawn for axis in varied):
            return self._points(tuple(sorted(varied, key=lambda axis: not axis.drawn)), cost)
        return self._map(varied, columns)

    def level(self, run: int, axis: Axis) -> int:
        """Which level of an axis a run has."""
        stride, count = self.strides[axis.path]
        return (run - 1) // len(self.study.solvers) // stride % count

    # --- maps -------------------------------------------------------------------------------------------------------

    def _map(self, varied: list[Axis], columns: Mapping[str, str]) -> Map:
        most = sorted(varied, key=lambda axis: -len(axis.levels))  # stable: of equals the first
        over = [axis for axis in varied if axis in most[:2]]
        panels = most[2] if len(most) > 2 and len(most[2].levels) <= PANELS else None
        beside = tuple(axis for axis in most[2:] if axis is not panels)
        group = [-(-len(axis.levels) // CELLS) for axis in over]
        rows = over[1] if len(over) > 1 else None
        chart = Map(over[0], rows, panels, beside, (group[0], group[1] if rows else 1), {})
        cells = {label: self._cells(chart, label, columns) for label in self.study.solvers}
        return Map(over[0], rows, panels, beside, chart.group, cells)

    def _cells(self, chart: Map, label: str, columns: Mapping[str, str]) -> Cells:
        shape = (
            len(chart.panels.levels) if chart.panels else 1,
            -(-len(chart.rows.levels) // chart.group[1]) if chart.rows else 1,
            -(-len(chart.columns.levels) // chart.group[0]),
        )
        counts = np.zeros((*shape, len(self.places)), dtype=int)
        query = "run, outcome FROM runs WHERE variant = ?"
        for run, outcome in self.store.select(query, [label]):
            counts[(*self._cell(chart, run), self.places[outcome])] += 1
        stored, failed = counts.sum(axis=-1), counts[..., 1:]
        outcome = np.where(stored > 0, 0, -1)
        if failed.size:
            outcome = np.where(failed.sum(axis=-1) > 0, 1 + failed.argmax(axis=-1), outcome)
        medians = {name: self._medians(chart, label, column, shape) for name, column in columns.items()}
        return Cells(stored, counts[..., 0], outcome, medians)

    def _cell(self, chart: Map, run: int) -> tuple[int, int, int]:
        return (
            self.level(run, chart.panels) if chart.panels else 0,
            self.level(run, chart.rows) // chart.group[1] if chart.rows else 0,
            self.level(run, chart.columns) // chart.group[0],
        )

    def _medians(self, chart: Map, label: str, column: str, shape: tuple[int, ...]) -> Array:
        """Of the solved runs of each cell: values come in order, and those in the middle of their cells are taken."""
        counts, seen = np.zeros(shape, dtype=int), np.zeros(shape, dtype=int)
        lower, upper = np.full(shape, np.nan), np.full(shape, np.nan)
        known = f"FROM runs WHERE variant = ? AND converged AND {column} IS NOT NULL"
        for (run,) in self.store.select(f"run {known}", [label]):
            counts[self._cell(chart, run)] += 1
        for run, value in self.store.select(f"run, {column} {known} ORDER BY {column}", [label]):
            cell = self._cell(chart, run)
            if seen[cell] == (counts[cell] - 1) // 2:
                lower[cell] = value
            if seen[cell] == counts[cell] // 2:
                upper[cell] = value
            seen[cell] += 1
        return np.asarray((lower + upper) / 2)

    # --- points -----------------------------------------------------------------------------------------------------

    def _points(self, axes: tuple[Axis, ...], cost: str) -> Points:
        spots = [axis.places() for axis in axes]
        places, outcomes, costs = {}, {}, {}
        # a part of them is taken all over the study, always the same
        query = (
            f"run, outcome, {cost} FROM runs WHERE variant = ? ORDER BY run * 2654435761 % 4294967296 LIMIT ?"
        )
        for label in self.study.solvers:
            runs = list(self.store.select(query, [label, POINTS]))
            places[label] = np.array(
                [
                    [spot[self.level(run, axis)] for spot, axis in zip(spots, axes, strict=True)]
                    for run, *_ in runs
                ],
                dtype=float,
            ).reshape(len(runs), len(axes))
            outcomes[label] = np.array([self.places[outcome] for _, outcome, _ in runs], dtype=int)
            costs[label] = np.array([np.nan if value is None else value for *_, value in runs], dtype=float)
        return Points(axes, places, outcomes, costs, sum(self.store.outcomes().values()))
