"""Controls that jump between the intervals of a uniform grid: B-splines of degree 0, the usual choice of an NLP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.table import Gram, Table
from nhpocp.errors import InvalidProblemError


@dataclass(frozen=True)
class PiecewiseConstant(ControlBasis):
    """φ_k = 1 on the k-th of ``intervals`` equal parts of [0, T], 0 elsewhere."""

    intervals: int = declared.count(50, "equal intervals of the horizon")
    kind: ClassVar[str] = "piecewise_constant"
    meaning: ClassVar[str] = "one value per interval"

    @property
    def size(self) -> int:
        return self.intervals

    @property
    def labels(self) -> list[str]:
        return [f"interval{k}" for k in range(1, self.intervals + 1)]

    def values(self, time: Array, horizon: float) -> Array:
        xp, position = namespace(time), time * self.intervals / horizon
        ahead = [xp.where(position >= k, 1.0, 0.0) for k in range(1, self.intervals)]
        return xp.vector([a - b for a, b in zip([1.0, *ahead], [*ahead, 0.0], strict=True)])

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return self.local_table(times, horizon, side).dense()

    def local_table(self, times: Array, horizon: float, side: Side = "right") -> Table:
        position = np.asarray(times, dtype=float) * self.intervals / horizon
        nearest = np.rint(position)
        # a breakpoint up to rounding
        position = np.where(np.abs(position - nearest) < 1e-9, nearest, position)
        place = np.floor(position) if side == "right" else np.ceil(position) - 1
        place = np.clip(place, 0, self.intervals - 1).astype(int)
        return Table(np.ones((len(position), 1)), self.intervals, place)

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return np.zeros((len(times), self.intervals))

    def gram(self, horizon: float) -> Gram:
        return Gram(np.full((1, self.intervals), horizon / self.intervals))

    def breakpoints(self, horizon: float) -> Array:
        return np.linspace(0.0, horizon, self.intervals + 1)[1:-1]

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        values, grid = np.asarray(data["values"], dtype=float), np.asarray(data["grid"], dtype=float)
        uniform = np.linspace(0.0, data["horizon"], len(values) + 1)
        if grid.shape != uniform.shape or np.abs(grid - uniform).max() > 1e-9 * data["horizon"]:
            raise InvalidProblemError(
                "a grid that is not uniform; only equal intervals are supported", path="control.grid"
            )
        return cls(len(values)), values.T

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        grid = np.linspace(0.0, horizon, self.intervals + 1)
        return {
            "basis": self.kind,
            "horizon": horizon,
            "grid": grid.tolist(),
            "values": np.asarray(coefficients).T.tolist(),
        }
