"""Legendre polynomials on the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Legendre(ControlBasis):
    """φ = (P_0, …, P_degree)(2t/T - 1): orthogonal, smooth, and not periodic as the Fourier series is."""

    degree: int = declared.degree(4, "degree + 1 functions per input")
    kind: ClassVar[str] = "legendre"
    meaning: ClassVar[str] = "Legendre polynomials"
    nested: ClassVar[bool] = True

    @property
    def size(self) -> int:
        return self.degree + 1

    @property
    def labels(self) -> list[str]:
        return [f"P{k}" for k in range(self.size)]

    def _polynomials(self, time: Array, horizon: float) -> list[Array]:
        x = 2.0 * time / horizon - 1.0
        polynomials = [0.0 * x + 1.0, x]
        for k in range(1, self.degree):  # [Bonnet]
            polynomials.append(((2 * k + 1) * x * polynomials[k] - k * polynomials[k - 1]) / (k + 1))
        return polynomials[: self.size]

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

    def gram(self, horizon: float) -> Gram:
        return Gram(horizon / (2.0 * np.arange(self.size)[None] + 1.0))

    @property
    def oscillations(self) -> float:
        return 0.5 * self.degree

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)
