"""Polynomials on the horizon, by the recurrence that a family of them is known for."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side


@dataclass(frozen=True)
class Polynomials(ControlBasis):
    """φ = (p_0, …, p_degree)(2t/T - 1), p_0 = 1 and p_1(x) = x. ``letter``: how the family's polynomials are called."""

    degree: int = declared.degree(4, "degree + 1 functions per input")
    letter: ClassVar[str]

    @abstractmethod
    def _following(self, x: Array, last: Array, before: Array, k: int) -> Array:
        """p_{k+1}(x) of p_k(x) and p_{k-1}(x)."""

    @abstractmethod
    def _slopes(self) -> Array:
        """p_k' in the family itself, column k; (size, size)."""

    @property
    def size(self) -> int:
        return self.degree + 1

    @property
    def labels(self) -> list[str]:
        return [f"{self.letter}{k}" for k in range(self.size)]

    def _polynomials(self, time: Array, horizon: float) -> list[Array]:
        x = 2.0 * time / horizon - 1.0
        polynomials = [0.0 * x + 1.0, x]
        for k in range(1, self.degree):
            polynomials.append(self._following(x, polynomials[k], polynomials[k - 1], k))
        return polynomials[: self.size]

    def values(self, time: Array, horizon: float) -> Array:
        return namespace(time).vector(self._polynomials(time, horizon))

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return np.stack(self._polynomials(np.asarray(times, dtype=float), horizon), axis=-1)

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return 2.0 / horizon * self.table(times, horizon) @ self._slopes()

    @property
    def oscillations(self) -> float:
        return 0.5 * self.degree

    def breakpoints(self, horizon: float) -> Array:
        return np.empty(0)
