"""The part of a stored trajectory that a picture can show: up to where it is finite."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solution import Solution

LARGEST = 1e9  # what is larger has left every picture: the path is cut there as if it were not finite


@dataclass(frozen=True)
class Path:
    """The part of a trajectory that can be drawn: its first ``samples`` samples, at ``times``."""

    times: Array
    samples: int
    stored: int
    horizon: float

    @property
    def cut(self) -> bool:
        return self.samples < self.stored or self.samples == 0

    @property
    def words(self) -> str | None:
        """What the reader has to know of a path that was cut."""
        if not self.samples:
            return "No finite sample: there is no path to draw."
        if self.cut:
            return f"The path is not finite after t = {self.times[-1]:.4g}; it is cut there."
        if self.times[-1] < self.horizon * (1 - 1e-9):
            return f"The path ends at t = {self.times[-1]:.4g}, before T = {self.horizon:.4g}."
        return None


def path_of(solution: Solution) -> Path:
    """Up to where time and state of a solution are finite."""
    times = np.ravel(np.asarray(solution.trajectory.get("t", ()), dtype=float))
    good = np.isfinite(times)
    for name in solution.problem.system.state_space.names:
        values = np.asarray(solution.trajectory.get(name, np.full(times.shape, np.nan)), dtype=float)
        flat = values.reshape(len(times), -1)
        good &= (np.nan_to_num(np.abs(flat), nan=np.inf) < LARGEST).all(axis=1)
    samples = len(times) if good.all() else int(np.argmin(good))
    return Path(times[:samples], samples, len(times), float(solution.control.horizon))


def quantity(solution: Solution, name: str, path: Path) -> Array:
    """A trajectory's array up to the cut, (samples, components); what is too large for a picture is NaN."""
    values = np.asarray(solution.trajectory.get(name, ()), dtype=float)[: path.samples]
    values = values.reshape(path.samples, -1) if values.size else np.empty((path.samples, 0))
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < LARGEST, values, np.nan) if values.size else values


def positive(values: Iterable[float | None]) -> Array:
    """Numbers for a log axis, NaN where there is none."""
    found = np.array([np.nan if value is None else float(value) for value in values])
    found[~(np.isfinite(found) & (found > 0))] = np.nan
    return found


def thinned(count: int, most: int) -> Array:
    """Indices of ``count`` samples: all of them, or ``most`` at equal distances with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
