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
    image: Array  # J δλ, what the step promises to add to e
    rank: int
    singular_values: Array
    blocked: bool = (
        False  # the error cannot be reduced from here in every direction, and the inverse needs that
    )


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
        left, values, right = scaled_svd(jacobian, factor)
        rank = rank_of(values, self.rank_tolerance)
        inner = -right[:rank].T @ ((left[:, :rank].T @ error) / values[:rank])
        step = np.linalg.solve(factor.T, inner)
        return Direction(step, jacobian @ step, rank, values, blocked=rank < len(error))


@dataclass(frozen=True)
class Damped:
    """δλ = -Jᵀ (J Jᵀ + μ² I)⁻¹ e, singularity-robust: μ = ``most`` (1 - σ_min/threshold) below the threshold, else 0.

    [Nakamura, Hanafusa 1986]. The threshold is a share of the largest singular value.
    """

    share: float = 0.02
    most: float = 0.02
    kind: ClassVar[str] = "damped"

    def __call__(self, jacobian: Array, error: Array, factor: Array) -> Direction:
        left, values, right = scaled_svd(jacobian, factor)
        threshold = self.share * values[0]
        least = values[-1] if len(values) == len(error) else 0.0
        damping = self.most * values[0] * max(0.0, 1.0 - least / threshold) if threshold > 0 else 1.0
        inner = -right.T @ (values / (values**2 + damping**2) * (left.T @ error))
        step = np.linalg.solve(factor.T, inner)
        return Direction(step, jacobian @ step, rank_of(values, 1e-8), values)


@dataclass(frozen=True)
class Transpose:
    """δλ = -α Jᵀ e, with the α that reduces |e + J δλ| most: steepest descent, no inverse at all."""

    kind: ClassVar[str] = "transpose"

    def __call__(self, jacobian: Array, error: Array, factor: Array) -> Direction:
        _, values, _ = scaled_svd(jacobian, factor)
        gradient = np.linalg.solve(factor.T, np.linalg.solve(factor, jacobian.T @ error))
        image = jacobian @ gradient
        squared = float(image @ image)
        alpha = float(error @ image) / squared if squared > 0 else 0.0
        return Direction(-alpha * gradient, -alpha * image, rank_of(values, 1e-8), values)


def scaled_svd(jacobian: Array, factor: Array) -> tuple[Array, Array, Array]:
    """Singular value decomposition of J L⁻ᵀ: J between the metric's orthonormal coordinates and the error."""
    left, values, right = np.linalg.svd(np.linalg.solve(factor, jacobian.T).T, full_matrices=False)
    return left, values, right


def rank_of(values: Array, tolerance: float) -> int:
    """Singular values above ``tolerance`` times the largest."""
    return int(np.sum(values > tolerance * values[0])) if values.size and values[0] > 0 else 0
