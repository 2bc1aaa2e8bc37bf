"""Ways to solve J δλ = -e for the change of the control: generalized inverses and the metrics they measure δλ in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.table import Gram
from nhpocp.errors import InvalidProblemError

NEGLIGIBLE = 1e-14  # σ/σ₁ under which a singular value is rounding


class Metric(Protocol):
    """An inner product on the coefficients λ."""

    kind: ClassVar[str]

    def factor(self, basis: ControlBasis, inputs: int, horizon: float) -> Array:
        """L (size·inputs, square) with ⟨λ, λ⟩ = |Lᵀ λ|²."""
        ...

    def root(self, basis: ControlBasis, inputs: int, horizon: float) -> tuple[Array, Gram | None]:
        """A (inputs, square) and a matrix with L = A ⊗ its lower root; None: the identity."""
        ...

    def unit(self, inputs: Array, horizon: float) -> Array:
        """√⟨λ, λ⟩ of a natural control, whose inputs are of these sizes: one, or one for each input."""
        ...


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


@dataclass(frozen=True)
class LinearisedPath:
    """The system linearised along one path: ξ(t) = M(t) δλ, w(t) = P(t) δλ."""

    times: Array
    variations: Array  # M at the times, (k, dimension, inputs · size), over the natural sizes of the states
    basis: ControlBasis
    inputs: Array  # their natural sizes


@dataclass(frozen=True)
class Spectrum:
    """The singular value decomposition of J over the metric's `Coordinates`, and e in its basis."""

    left: Array
    values: Array
    right: Array
    coordinates: Coordinates
    error: Array

    def within(self, radius: float) -> tuple[Array, Array]:
        """-J^T (J J^T + μ)⁻¹ e and its image, with the μ that makes its length in the metric the radius, or 0."""
        values = self.values
        used = len(values) if values[-1] > NEGLIGIBLE * values[0] else rank_of(values, NEGLIGIBLE)
        inner = within_radius(values[:used], self.error[:used], radius)
        step = self.coordinates.coefficients(-self.right[:used].T @ inner)
        return step, -self.left[:, :used] @ (values[:used] * inner)


def within_radius(values: Array, error: Array, radius: Array | float) -> Array:
    """σ e/(σ² + μ) with the μ that makes its length the radius, or 0 if it is shorter: (…, r) each, radii (…,).

    The trust-region subproblem of least squares, solved by Newton's method on 1/length [Moré, Sorensen 1983].
    """
    squares, product = values**2, values * error
    damping = np.zeros((*values.shape[:-1], 1))
    inner = product / squares
    for _ in range(30):
        squared = (inner * inner).sum(-1)
        excess = np.sqrt(squared) / radius - 1.0
        long = excess > 1e-3
        if not long.any():
            break
        slope = np.where(long, (inner * inner / (squares + damping)).sum(-1), 1.0)
        damping = damping + np.where(long, excess * squared / slope, 0.0)[..., None]
        inner = product / (squares + damping)
    return inner


@dataclass(frozen=True)
class Direction:
    """The full step δλ, worked out when it is asked for, and what was seen of the Jacobian on the way."""

    solve: Callable[[], Array]
    jacobian: Array
    rank: int
    singular_values: Array
    # whether the error cannot be reduced from here in every direction, and the inverse needs that
    blocked: bool = False
    spectrum: Spectrum | None = None
    coordinates: Coordinates | None = None  # of the metric; None: λ itself

    @cached_property
    def step(self) -> Array:
        return self.solve()

    @property
    def image(self) -> Array:
        """J δλ, what the step promises to add to e."""
        return self.jacobian @ self.step

    def length(self, change: Array) -> float:
        """Size of a change of λ in the metric that this direction was found in."""
        return self.coordinates.length(change) if self.coordinates else float(np.linalg.norm(change))

    def within(self, radius: float) -> tuple[Array, Array]:
        """A step no longer than the radius, and its image: of all such the one that reduces |e + J δλ| most.

        Without a spectrum the full step is shortened, which an ill-conditioned Jacobian turns into next to nothing.
        """
        if self.spectrum is not None:
            return self.spectrum.within(radius)
        share = min(1.0, radius / max(self.length(self.step), 1e-300))
        return share * self.step, share * self.image


class GeneralizedInverse(Protocol):
    """J, e ↦ δλ with J δλ ≈ -e. Subclass it: most inverses take the metric that is given."""

    kind: ClassVar[str]
    looks_along: ClassVar[bool] = False  # whether `metric` is asked

    def metric(self, path: LinearisedPath) -> Array | None:
        """The factor, as of a `Metric`, of an inverse that measures δλ by what it does to the whole path; else None."""
        return None

    def __call__(self, jacobian: Array, error: Array, coordinates: Coordinates) -> Direction: ...


@dataclass(frozen=True)
class MoorePenrose(GeneralizedInverse):
    """The shortest δλ (in the metric) that solves J δλ = -e, by the SVD; [Paper] eq. (16).

    Singular values below ``rank_tolerance`` times the largest count as zero: 1e-8 is above the noise of a Jacobian from
    cvodes at 1e-10 and far below the ratio 3e-3 of the paper's start.
    """

    rank_tolerance: float = 1e-8
    kind: ClassVar[str] = "moore_penrose"

    def __call__(self, jacobian: Array, error: Array, coordinates: Coordinates) -> Direction:
        left, values, right = scaled_svd(jacobian, coordinates)
        rank = rank_of(values, self.rank_tolerance)
        spectrum = Spectrum(left, values, right, coordinates, left.T @ error)

        def solve() -> Array:
            return coordinates.coefficients(-right[:rank].T @ (spectrum.error[:rank] / values[:rank]))

        return Direction(solve, jacobian, rank, values, rank < len(error), spectrum, coordinates)


@dataclass(frozen=True)
class Damped(GeneralizedInverse):
    """δλ = -Jᵀ (J Jᵀ + μ² I)⁻¹ e, singularity-robust: μ = ``most`` (1 - σ_min/threshold) below the threshold, else 0.

    [Nakamura, Hanafusa 1986]. The threshold is a share of the largest singular value.
    """

    share: float = 0.02
    most: float = 0.02
    kind: ClassVar[str] = "damped"

    def __call__(self, jacobian: Array, error: Array, coordinates: Coordinates) -> Direction:
        left, values, right = scaled_svd(jacobian, coordinates)
        threshold = self.share * values[0]
        least = values[-1] if len(values) == len(error) else 0.0
        damping = self.most * values[0] * max(0.0, 1.0 - least / threshold) if threshold > 0 else 1.0
        inner = -right.T @ (values / (values**2 + damping**2) * (left.T @ error))
        step = coordinates.coefficients(inner)
        return Direction(lambda: step, jacobian, rank_of(values, 1e-8), values, coordinates=coordinates)


@dataclass(frozen=True)
class Transpose(GeneralizedInverse):
    """δλ = -α Jᵀ e, with the α that reduces |e + J δλ| most: steepest descent, no inverse at all."""

    kind: ClassVar[str] = "transpose"

    def __call__(self, jacobian: Array, error: Array, coordinates: Coordinates) -> Direction:
        _, values, _ = scaled_svd(jacobian, coordinates)
        gradient = coordinates.coefficients(coordinates.jacobian(jacobian).T @ error)
        image = jacobian @ gradient
        squared = float(image @ image)
        alpha = float(error @ image) / squared if squared > 0 else 0.0
        rank = rank_of(values, 1e-8)
        return Direction(lambda: -alpha * gradient, jacobian, rank, values, coordinates=coordinates)


@dataclass(frozen=True)
class Lagrangian(GeneralizedInverse):
    r"""The δλ that solves J δλ = -e and changes path and control least: of all such the minimiser of

        1/T ∫₀ᵀ ξᵀ Q ξ + wᵀ R w dt,    ξ̇ = A ξ + B w,  ξ(0) = 0,

    a Lagrange problem for the linearised system, [Tchoń, Ratajczak, Góral 2015]. Over a finite basis ξ = M(t) δλ by
    (11)-(12) and w = P(t) δλ, so that it is the pseudo-inverse in the metric ∫ Mᵀ Q M + Pᵀ R P dt, which moves along
    with the path; the solver's own metric does not enter. Q = 0 leaves the L² metric weighted by R.

    state_weight: Q over the tangent numbers, control_weight: R over the inputs; ξ and w are in units of their natural
    sizes (`Scales`). A number, a diagonal or a matrix each.
    """

    state_weight: Any = 1.0
    control_weight: Any = 1.0
    rank_tolerance: float = 1e-8
    kind: ClassVar[str] = "lagrangian"
    looks_along: ClassVar[bool] = True

    def metric(self, path: LinearisedPath) -> Array:
        M, horizon = path.variations, float(path.times[-1])
        steps = np.diff(path.times) / horizon
        shares = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))  # trapezoidal
        of_states = weight_root(self.state_weight, M.shape[1], definite=False) @ M
        of_states = (np.sqrt(shares)[:, None, None] * of_states).reshape(-1, M.shape[2])
        of_controls = WeightedMetric(self.control_weight).factor(path.basis, len(path.inputs), horizon).T
        of_controls = of_controls / np.repeat(np.sqrt(horizon) * path.inputs, path.basis.size)
        # the sum of squares as one triangle, never squared: M may be large beside P
        return np.asarray(np.linalg.qr(np.vstack([of_states, of_controls]), mode="r")).T

    def __call__(self, jacobian: Array, error: Array, coordinates: Coordinates) -> Direction:
        return MoorePenrose(self.rank_tolerance)(jacobian, error, coordinates)


def scaled_svd(jacobian: Array, coordinates: Coordinates) -> tuple[Array, Array, Array]:
    """Singular value decomposition of J between the metric's orthonormal coordinates and the error."""
    left, values, right = np.linalg.svd(coordinates.jacobian(jacobian), full_matrices=False)
    return left, values, right


def rank_of(values: Array, tolerance: float) -> int:
    """Singular values above ``tolerance`` times the largest."""
    return int(np.count_nonzero(values > tolerance * values[0])) if values.size and values[0] > 0 else 0
