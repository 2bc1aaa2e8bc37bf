"""Chebyshev polynomials on the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.polynomials import Polynomials
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Chebyshev(Polynomials):
    """φ = (T_0, …, T_degree)(2t/T - 1), T_k(cos θ) = cos kθ: smooth, within ±1, and least in the greatest error."""

    kind: ClassVar[str] = "chebyshev"
    letter: ClassVar[str] = "T"
    meaning: ClassVar[str] = "Chebyshev polynomials"
    nested: ClassVar[bool] = True

    def _following(self, x: Array, last: Array, before: Array, k: int) -> Array:
        return 2.0 * x * last - before

    def _slopes(self) -> Array:
        slopes = np.zeros((self.size, self.size))  # T_k' = 2k (T_{k-1} + T_{k-3} + …), T_0 counting half
        for k in range(1, self.size):
            slopes[np.arange(k - 1, -1, -2), k] = 2.0 * k
        slopes[0] *= 0.5
        return slopes

    def gram(self, horizon: float) -> Gram:
        i, j = np.indices((self.size, self.size))
        even = (i + j) % 2 == 0  # ∫ T_i T_j = ½ ∫ (T_{i+j} + T_{i-j}), and ∫ T_m over [-1, 1] is 2 / (1 - m²)
        masses = [np.divide(1.0, 1.0 - m**2, where=even, out=np.zeros(m.shape)) for m in (i + j, i - j)]
        return Gram.of(0.5 * horizon * (masses[0] + masses[1]))
