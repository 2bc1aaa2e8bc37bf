"""The truncated Fourier series of the paper, [Paper] eq. (15)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Fourier(ControlBasis):
    """φ = (1, sin ωt, cos ωt, …, sin hωt, cos hωt), ω = 2π/T: 2h + 1 functions."""

    harmonics: int = declared.degree(2, "2·harmonics + 1 functions per input")
    kind: ClassVar[str] = "fourier"
    meaning: ClassVar[str] = "truncated Fourier series"
    nested: ClassVar[bool] = True

    @property
    def size(self) -> int:
        return 2 * self.harmonics + 1

    @property
    def labels(self) -> list[str]:
        return ["const"] + [f"{name}{k}" for k in range(1, self.harmonics + 1) for name in ("sin", "cos")]

    def values(self, time: Array, horizon: float) -> Array:
        xp = namespace(time)
        phases = [2 * pi * k / horizon * time for k in range(1, self.harmonics + 1)]
        return xp.vector([1.0, *(f(phase) for phase in phases for f in (xp.sin, xp.cos))])

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        times = np.asarray(times, dtype=float)
        phases = np.multiply.outer(times, self._rates(horizon))
        table = np.ones((len(times), self.size))
        table[:, 1::2], table[:, 2::2] = np.sin(phases), np.cos(phases)
        return table

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        table, rates = self.table(times, horizon), self._rates(horizon)
        slopes = np.zeros_like(table)
        slopes[:, 1::2], slopes[:, 2::2] = rates * table[:, 2::2], -rates * table[:, 1::2]
        return slopes

    def _rates(self, horizon: float) -> Array:
        return 2 * np.pi / horizon * np.arange(1, self.harmonics + 1)

    def gram(self, horizon: float) -> Gram:
        return Gram(np.array([[horizon] + [0.5 * horizon] * (2 * self.harmonics)]))

    @property
    def oscillations(self) -> float:
        return float(self.harmonics)

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        coefficients = np.asarray(data["coefficients"], dtype=float)
        if not len(coefficients):  # no inputs: a list of no rows does not say how long they are
            return cls(0), coefficients.reshape(0, 1)
        return cls((coefficients.shape[1] - 1) // 2), coefficients

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        return {"basis": self.kind, "horizon": horizon, "coefficients": np.asarray(coefficients).tolist()}
