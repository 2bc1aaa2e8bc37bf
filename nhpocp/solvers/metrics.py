"""How the size of a control's coefficients is measured, and the coordinates in which that is the plain length."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.table import Gram
from nhpocp.errors import InvalidProblemError


class Metric(Constructed):
    """An inner product on the coefficients λ."""

    kind: ClassVar[str]

    @abstractmethod
    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        """L (size·inputs, square) with ⟨λ, λ⟩ = |Lᵀ λ|²."""

    @abstractmethod
    def root(self, basis: ControlBasis, inputs: int, horizon: float) -> tuple[Array, Gram | None]:
        """A (inputs, square) and a matrix with L = A ⊗ its lower root; None: the identity."""

    @abstractmethod
    def unit(self, inputs: Array, horizon: float) -> Array:
        """√⟨λ, λ⟩ of a natural control, whose inputs are of these sizes: one, or one for each input."""


@dataclass(frozen=True)
class CoefficientMetric(Metric):
    """|λ|²: the pseudo-inverse of the matrix itself, [Paper] eq. (16), where all inputs have the same unit."""

    kind: ClassVar[str] = "coefficients"

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        return np.eye(inputs * basis.size)

    def root(self, basis: ControlBasis, inputs: int, horizon: float) -> tuple[Array, Gram | None]:
        return np.eye(inputs), None

    def unit(self, inputs: Array, horizon: float) -> Array:
        return inputs


@dataclass(frozen=True)
class L2Metric(Metric):
    """∫ |u|² dt: what the functional flow, [Paper] eq. (14), becomes over a finite basis. The Fourier basis (15) is not
    orthonormal (∫ 1 = T, ∫ sin² = T/2), so this differs from `CoefficientMetric`."""

    kind: ClassVar[str] = "l2"

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        return np.kron(np.eye(inputs), np.linalg.cholesky(np.asarray(basis.gram(horizon))))

    def root(self, basis: ControlBasis, inputs: int, horizon: float) -> tuple[Array, Gram | None]:
        return np.eye(inputs), Gram.of(basis.gram(horizon))

    def unit(self, inputs: Array, horizon: float) -> Array:
        return np.sqrt(horizon) * np.max(inputs, keepdims=True)


@dataclass(frozen=True)
class WeightedMetric(Metric):
    """∫ uᵀ R u dt. weights: R, or its diagonal, one weight per input."""

    weights: Any
    kind: ClassVar[str] = "weighted"

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        root = weight_root(self.weights, inputs, definite=True).T
        return np.kron(root, np.linalg.cholesky(np.asarray(basis.gram(horizon))))

    def root(self, basis: ControlBasis, inputs: int, horizon: float) -> tuple[Array, Gram | None]:
        return weight_root(self.weights, inputs, definite=True).T, Gram.of(basis.gram(horizon))

    def unit(self, inputs: Array, horizon: float) -> Array:
        root = weight_root(self.weights, len(inputs), definite=True)
        return np.sqrt(horizon) * np.max(inputs * np.linalg.norm(root, axis=0), keepdims=True)


class Coordinates:
    """z = Lᵀ λ, in which a metric is the plain length: ⟨λ, λ⟩ = |z|²."""

    def __init__(self, factor: Array) -> None:
        self.factor = factor
        self.back = np.linalg.inv(factor.T)

    @staticmethod
    def natural(metric: Metric, basis: ControlBasis, inputs: Array, horizon: float) -> Coordinates:
        """A metric's, dimensionless: in units of a natural control, whose inputs are of these sizes."""
        mixing, gram = metric.root(basis, len(inputs), horizon)
        units = np.broadcast_to(metric.unit(inputs, horizon), len(inputs))
        return ProductCoordinates(mixing / units[:, None], gram)

    def jacobian(self, by_coefficients: Array) -> Array:
        """J over z, from J over λ, (…, size·inputs)."""
        return by_coefficients @ self.back

    def coefficients(self, z: Array) -> Array:
        """λ of z, (size·inputs, …)."""
        return self.back @ z

    def of(self, coefficients: Array) -> Array:
        """z of λ, (size·inputs, …)."""
        return np.asarray(self.factor.T @ coefficients)

    def length(self, coefficients: Array) -> float:
        """√⟨λ, λ⟩."""
        return float(norm(self.of(coefficients)))


class ProductCoordinates(Coordinates):
    """z = Lᵀ λ with L = A ⊗ G, G the lower root of a Gram matrix or the identity, and no matrix of λ's size."""

    def __init__(self, mixing: Array, gram: Gram | None) -> None:
        self._mixing, self._unmixing, self._gram = mixing, np.linalg.inv(mixing), gram

    def jacobian(self, by_coefficients: Array) -> Array:
        if not by_coefficients.size:
            return by_coefficients
        inputs = len(self._mixing)
        rows = by_coefficients.reshape(-1, inputs, by_coefficients.shape[-1] // inputs)
        if self._gram is not None:
            columns = rows.reshape(len(rows) * inputs, rows.shape[2]).T
            rows = self._gram.solve_root(columns).T.reshape(rows.shape)
        return np.asarray((self._unmixing @ rows).reshape(by_coefficients.shape))

    def coefficients(self, z: Array) -> Array:
        return self._by_input(self._unmixing.T, self._gram.solve_root_transposed if self._gram else None, z)

    def of(self, coefficients: Array) -> Array:
        return self._by_input(
            self._mixing.T, self._gram.root_transposed if self._gram else None, coefficients
        )

    def _by_input(self, mixing: Array, done: Callable[[Array], Array] | None, vectors: Array) -> Array:
        """Done to the functions of each input in vectors (size·inputs, …), and the inputs mixed."""
        if not vectors.size:
            return vectors
        mixed = (mixing @ vectors.reshape(len(mixing), -1)).reshape(
            len(mixing), len(vectors) // len(mixing), -1
        )
        if done is not None:
            columns = mixed.swapaxes(0, 1).reshape(mixed.shape[1], -1)
            mixed = done(columns).reshape(mixed.shape[1], mixed.shape[0], -1).swapaxes(0, 1)
        return np.ascontiguousarray(mixed).reshape(vectors.shape)


def weight_root(weights: Any, size: int, *, definite: bool) -> Array:
    """A matrix C with CᵀC = W, for W given as a number, as a diagonal or as itself.

    Errors: `InvalidProblemError` where W is of another shape, or is not positive (semi)definite.
    """
    W = np.asarray(weights, dtype=float)
    if W.ndim < 2 and W.size in (1, size):
        W = np.diag(np.broadcast_to(W, (size,)))
    if W.shape != (size, size) or not np.allclose(W, W.T):
        raise InvalidProblemError(
            f"weights of shape {W.shape}; expected a number, {size} numbers, or a symmetric {size} × {size} matrix"
        )
    values, vectors = np.linalg.eigh(W)
    if not values[0] >= 0 or (definite and values[0] == 0):
        kind = "definite" if definite else "semidefinite"
        raise InvalidProblemError(
            f"weights with the eigenvalue {values[0]:g}; expected a positive {kind} matrix"
        )
    return np.sqrt(values)[:, None] * vectors.T
