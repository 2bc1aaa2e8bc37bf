"""Chebyshev polynomials on the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.table import Gram


@dataclass(frozen=True)
class Chebyshev(ControlBasis):
    """φ = (T_0, …, T_degree)(2t/T - 1), T_k(cos θ) = cos kθ: smooth, within ±1, and least in the greatest error."""

    degree: int = declared.degree(4, "degree + 1 functions per input")
    kind: ClassVar[str] = "chebyshev"
    meaning: ClassVar[str] = "Chebyshev polynomials"
    nested: ClassVar[bool] = True

    @property
    def size(self) -> int:
        return self.degree + 1

    @property
    def labels(self) -> list[str]:
        return [f"T{k}" for k in range(self.size)]

    def _polynomials(self, time: Array, horizon: float) -> list[Array]:
        x = 2.0 * time / horizon - 1.0
        polynomials = [0.0 * x + 1.0, x]
        for _ in range(1, self.degree):
            polynomials.append(2.0 * x * polynomials[-1] - polynomials[-2])
        return polynomials[: self.size]

    def values(self, time: Array, horizon: float) -> Array:
        return namespace(time).vector(self._polynomials(time, horizon))

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return np.stack(self._polynomials(np.asarray(times, dtype=float), horizon), axis=-1)

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        slopes = np.zeros((self.size, self.size))  # T_k' = 2k (T_{k-1} + T_{k-3} + …), T_0 counting half
        for k in range(1, self.size):
            slopes[np.arange(k - 1, -1, -2), k] = 2.0 * k
        slopes[0] *= 0.5
        return 2.0 / horizon * self.table(times, horizon) @ slopes

    def gram(self, horizon: float) -> Gram:
        i, j = np.indices((self.size, self.size))
        even = (i + j) % 2 == 0  # ∫ T_i T_j = ½ ∫ (T_{i+j} + T_{i-j}), and ∫ T_m over [-1, 1] is 2 / (1 - m²)
        masses = [np.divide(1.0, 1.0 - m**2, where=even, out=np.zeros(m.shape)) for m in (i + j, i - j)]
        return Gram.of(0.5 * horizon * (masses[0] + masses[1]))

    @property
    def oscillations(self) -> float:
        return 0.5 * self.degree

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)
