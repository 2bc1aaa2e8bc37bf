"""The part of a stored trajectory that a picture can show: up to where it is finite."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solution import Solution

LARGEST = 1e9  # what is larger has left every picture: the path is cut there as if it were not finite


@dataclass(frozen=True)
class FinitePath:
    """The part of a trajectory that can be drawn: its first ``samples`` samples, at ``times``."""

    times: Array
    samples: int
    stored: int
    horizon: float
    time_unit: str | None = None  # as the problem calls it

    @property
    def end(self) -> float:
        """The time up to which there is a path."""
        return float(self.times[-1]) if self.samples else 0.0

    @property
    def cut(self) -> bool:
        return self.samples < self.stored or self.samples == 0

    @property
    def words(self) -> str | None:
        """What the reader has to know of a path that was cut."""
        if not self.samples:
            return "No finite sample: there is no path to draw."
        if self.cut:
            return f"The path is not finite after t = {self.end:.4g}; it is cut there."
        if self.end < self.horizon * (1 - 1e-9):
            return f"The path ends at t = {self.end:.4g}, before T = {self.horizon:.4g}."
        return None


def path_of(solution: Solution) -> FinitePath:
    """Up to where time and state of a solution are finite."""
    times = np.ravel(np.asarray(solution.trajectory.get("t", ()), dtype=float))
    good = np.isfinite(times)
    for name in solution.problem.system.state_space.names:
        values = np.asarray(solution.trajectory.get(name, np.full(times.shape, np.nan)), dtype=float)
        flat = values.reshape(len(times), -1)
        good &= (np.nan_to_num(np.abs(flat), nan=np.inf) < LARGEST).all(axis=1)
    samples = len(times) if good.all() else int(np.argmin(good))
    horizon, unit = float(solution.control.horizon), solution.problem.units.time
    return FinitePath(times[:samples], samples, len(times), horizon, unit)


def quantity(solution: Solution, name: str, path: FinitePath) -> Array:
    """A trajectory's array up to the cut, (samples, components); what is too large for a picture is NaN.

    What a trajectory does not have has no components.
    """
    if name not in solution.trajectory:
        return np.empty((path.samples, 0))
    values = np.asarray(solution.trajectory[name], dtype=float)
    values = values[: path.samples].reshape(path.samples, int(np.prod(values.shape[1:])))
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < LARGEST, values, np.nan)


def thinned(count: int, most: int) -> Array:
    """Indices of ``count`` samples: all of them, or ``most`` at equal distances with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
