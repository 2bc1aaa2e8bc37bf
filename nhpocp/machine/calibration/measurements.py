"""What is measured of one run of a machine: times, poses, and the lengths of the legs that have a motor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError, suggestion
from nhpocp.systems.parallel_robot import ParallelRobot

LEAST = 3  # samples of a run
MOST = 2000  # samples of a run that are used
OFF_GROUP = 0.05  # how far the numbers of a measured rotation may be from one


@dataclass(frozen=True)
class Measurements:
    """One run. name: of its file, or its number. times: (k,), rising [time].

    points: packed states (k, size), NaN in rows where no pose was measured; lengths: (k, motors) [length]. every: of
    what was measured, each so many-th sample is there.
    """

    name: str
    times: Array
    points: Array
    lengths: Array
    every: int = 1

    @property
    def posed(self) -> Array:
        """Where a pose was measured, (k,)."""
        return np.isfinite(self.points).all(axis=1)


def motors_of(system: ParallelRobot) -> list[int]:
    """Which of the numbers of ``leg_lengths`` have a motor, from 0."""
    free = [leg for leg in system.legs if not leg.pinned]
    return [i for i, leg in enumerate(free) if leg.actuated]


def measured(run: Mapping[str, Any] | Measurements, system: ParallelRobot, name: str) -> Measurements:
    """A run from arrays by the names of a solution's trajectory, samples first: "t", the state's blocks, "leg_lengths".

    Rows of poses that are not finite count as not measured. Of a very long run every so many-th sample is taken.
    Errors: `InvalidProblemError` for what is missing, of another shape, not finite or not rising.
    """
    if isinstance(run, Measurements):
        return run
    space, motors = system.state_space, motors_of(system)
    wanted = ["t", *space.names, "leg_lengths"]
    if lacking := [each for each in wanted if each not in run]:
        near = suggestion(lacking[0], list(run), none=f"expected {', '.join(wanted)}")
        raise InvalidProblemError(f"no {lacking[0]!r} among what was measured; {near}", path=name)
    times = np.asarray(run["t"], dtype=float).ravel()
    count = len(times)
    lengths = _table(run["leg_lengths"], count, f"{name}.leg_lengths")
    if lengths.shape[1] != len(motors):
        lengths = lengths[:, motors] if lengths.shape[1] > max(motors) else lengths[:, :0]
    if lengths.shape[1] != len(motors):
        words = f"expected {len(motors)} numbers a sample, one a leg with a motor"
        raise InvalidProblemError(words, path=f"{name}.leg_lengths")
    if count < LEAST:
        raise InvalidProblemError(f"{count} samples; expected at least {LEAST}", path=name)
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise InvalidProblemError("expected finite times that rise from sample to sample", path=f"{name}.t")
    if not np.isfinite(lengths).all():
        row = int(np.argmin(np.isfinite(lengths).all(axis=1)))
        words = f"sample {row} is not finite; only poses may be missing"
        raise InvalidProblemError(words, path=f"{name}.leg_lengths")
    points = _points(run, system, count, name)
    every = -(-count // MOST)
    chosen = np.unique(np.append(np.arange(0, count, every), count - 1))
    return Measurements(name, times[chosen], points[chosen], lengths[chosen], every)


def _points(run: Mapping[str, Any], system: ParallelRobot, count: int, name: str) -> Array:
    parts = []
    for block in system.state_space.blocks:
        table = _table(run[block.name], count, f"{name}.{block.name}")
        if table.shape[1] != block.size:
            words = f"expected {block.size} numbers a sample, got {table.shape[1]}"
            raise InvalidProblemError(words, path=f"{name}.{block.name}")
        parts.append(_on_group(table, f"{name}.{block.name}") if block.kind == "rotation" else table)
    points = np.concatenate(parts, axis=1)
    points[~np.isfinite(points).all(axis=1)] = np.nan
    if not np.isfinite(points[0]).all():
        raise InvalidProblemError("the first sample has no pose; a run begins at a known one", path=name)
    return points


def _on_group(table: Array, path: str) -> Array:
    """Measured rotations (k, 9) made exact. Errors: `InvalidProblemError` for a sample that is none."""
    exact, there = np.full(table.shape, np.nan), np.isfinite(table).all(axis=1)
    matrices = table[there].reshape(-1, 3, 3)
    nearest = so3.nearest(matrices)
    off = np.abs(matrices - nearest).max(axis=(1, 2), initial=0.0)
    if (off > OFF_GROUP).any():
        worst = int(np.flatnonzero(there)[np.argmax(off)])
        words = f"sample {worst} is no rotation: it is off one by {off.max():.2g}; expected its rows"
        raise InvalidProblemError(words, path=path)
    exact[there] = nearest.reshape(-1, 9)
    return exact


def _table(values: Any, count: int, path: str) -> Array:
    try:
        table = np.array(values, dtype=float).reshape(count, -1)
    except (TypeError, ValueError):
        raise InvalidProblemError(f"expected numbers, {count} samples of them", path=path) from None
    return table
