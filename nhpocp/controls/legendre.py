"""Legendre polynomials on the horizon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Legendre(ControlBasis):
    """φ = (P_0, …, P_degree)(2t/T - 1): orthogonal, smooth, and not periodic as the Fourier series is."""

    degree: int = 4
    kind: ClassVar[str] = "legendre"

    @property
    def size(self) -> int:
        return self.degree + 1

    @property
    def labels(self) -> list[str]:
        return [f"P{k}" for k in range(self.size)]

    def _polynomials(self, time: Array, horizon: float) -> list[Array]:
        x = 2.0 * time / horizon - 1.0
        found = [0.0 * x + 1.0, x]
        for k in range(1, self.degree):  # [Bonnet]
            found.append(((2 * k + 1) * x * found[k] - k * found[k - 1]) / (k + 1))
        return found[: self.size]

    def values(self, time: Array, horizon: float) -> Array:
        return namespace(time).vector(self._polynomials(time, horizon))

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return np.stack(self._polynomials(np.asarray(times, dtype=float), horizon), axis=-1)

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        slopes = np.zeros((self.size, self.size))  # P_k' = (2k - 1) P_{k-1} + (2k - 5) P_{k-3} + …
        for k in range(1, self.size):
            lower = np.arange(k - 1, -1, -2)
            slopes[lower, k] = 2 * lower + 1
        return 2.0 / horizon * self.table(times, horizon) @ slopes

    def integral_table(self, times: Array, horizon: float) -> Array:
        parts = np.zeros((self.size + 1, self.size))  # ∫ P_k = (P_{k+1} - P_{k-1}) / (2k + 1)
        parts[[0, 1], 0] = 1.0
        for k in range(1, self.size):
            parts[[k - 1, k + 1], k] = np.array([-1.0, 1.0]) / (2 * k + 1)
        return 0.5 * horizon * Legendre(self.degree + 1).table(times, horizon) @ parts

    def gram(self, horizon: float) -> Gram:
        return Gram(horizon / (2.0 * np.arange(self.size)[None] + 1.0))

    @property
    def oscillations(self) -> float:
        return 0.5 * self.degree

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)

    def parameters(self) -> dict[str, Any]:
        return {"degree": self.degree}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        coefficients = np.asarray(data["coefficients"], dtype=float)
        if not len(coefficients):  # no inputs
            return cls(int(data["degree"])), coefficients.reshape(0, int(data["degree"]) + 1)
        return cls(coefficients.shape[1] - 1), coefficients

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        return {
            "basis": self.kind,
            "horizon": horizon,
            "degree": self.degree,
            "coefficients": np.asarray(coefficients).tolist(),
        }
