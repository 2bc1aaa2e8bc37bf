"""The truncated Fourier series of the paper, [Paper] eq. (15)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side


@dataclass(frozen=True)
class Fourier(ControlBasis):
    """φ = (1, sin ωt, cos ωt, …, sin hωt, cos hωt), ω = 2π/T: 2h + 1 functions."""

    harmonics: int = 2
    kind: ClassVar[str] = "fourier"

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
        phases = 2 * np.pi / horizon * np.multiply.outer(times, np.arange(1, self.harmonics + 1))
        table = np.ones((len(times), self.size))
        table[:, 1::2], table[:, 2::2] = np.sin(phases), np.cos(phases)
        return table

    def gram(self, horizon: float) -> Array:
        return np.diag([horizon] + [0.5 * horizon] * (2 * self.harmonics))

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)

    def parameters(self) -> dict[str, Any]:
        return {"harmonics": self.harmonics}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        coefficients = np.asarray(data["coefficients"], dtype=float)
        return cls((coefficients.shape[1] - 1) // 2), coefficients

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        return {"basis": self.kind, "horizon": horizon, "coefficients": np.asarray(coefficients).tolist()}
