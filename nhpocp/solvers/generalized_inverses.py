"""Ways to solve J δλ = -e for the change of the control: generalized inverses and the metrics they measure δλ in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis


class Metric(Protocol):
    """An inner product on the coefficients λ."""

    kind: ClassVar[str]

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        """L (size·inputs, square) with ⟨λ, λ⟩ = |Lᵀ λ|²."""
        ...


@dataclass(frozen=True)
class CoefficientMetric:
    """|λ|²: the pseudo-inverse of the matrix itself, [Paper] eq. (16)."""

    kind: ClassVar[str] = "coefficients"

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        return np.eye(inputs * basis.size)


@dataclass(frozen=True)
class L2Metric:
    """∫ |u|² dt: what the functional flow, [Paper] eq. (14), becomes over a finite basis. The Fourier basis (15) is not
    orthonormal (∫ 1 = T, ∫ sin² = T/2), so this differs from `CoefficientMetric`."""

    kind: ClassVar[str] = "l2"

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        return np.kron(np.eye(inputs), np.linalg.cholesky(basis.gram(horizon)))


@dataclass(frozen=True)
class Direction:
    """The full step δλ and what was seen of the Jacobian on the way."""

    step: Array
    rank: int
    singular_values: Array


class GeneralizedInverse(Protocol):
    """J, e ↦ δλ with J δλ ≈ -e."""

    kind: ClassVar[str]

    def __call__(self, jacobian: Array, error: Array, factor: Array) -> Direction: ...


@dataclass(frozen=True)
class MoorePenrose:
    """The shortest δλ (in the metric) that solves J δλ = -e, by the SVD; [Paper] eq. (16).

    Singular values below ``rank_tolerance`` times the largest count as zero: 1e-8 is above the noise of a Jacobian from
    cvodes at 1e-10 and far below the ratio 3e-3 of the paper's start.
    """

    rank_tolerance: float = 1e-8
    kind: ClassVar[str] = "moore_penrose"

    def __call__(self, jacobian: Array, error: Array, factor: Array) -> Direction:
        scaled = np.linalg.solve(factor, jacobian.T).T  # J L⁻ᵀ
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        rank = int(np.sum(values > self.rank_tolerance * values[0])) if values.size and values[0] > 0 else 0
        inner = -right[:rank].T @ ((left[:, :rank].T @ error) / values[:rank])
        return Direction(np.linalg.solve(factor.T, inner), rank, values)
