"""Legendre polynomials on the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.polynomials import Polynomials
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Legendre(Polynomials):
    """φ = (P_0, …, P_degree)(2t/T - 1): orthogonal, smooth, and not periodic as the Fourier series is."""

    kind: ClassVar[str] = "legendre"
    letter: ClassVar[str] = "P"
    meaning: ClassVar[str] = "Legendre polynomials"
    nested: ClassVar[bool] = True

    def _following(self, x: Array, last: Array, before: Array, k: int) -> Array:
        return ((2 * k + 1) * x * last - k * before) / (k + 1)  # [Bonnet]

    def _slopes(self) -> Array:
        slopes = np.zeros((self.size, self.size))  # P_k' = (2k - 1) P_{k-1} + (2k - 5) P_{k-3} + …
        for k in range(1, self.size):
            lower = np.arange(k - 1, -1, -2)
            slopes[lower, k] = 2 * lower + 1
        return slopes

    def gram(self, horizon: float) -> Gram:
        return Gram(horizon / (2.0 * np.arange(self.size)[None] + 1.0))
