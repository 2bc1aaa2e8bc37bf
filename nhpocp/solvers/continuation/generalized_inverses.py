"""Ways to solve J δλ = -e for the change of the control: generalized inverses, each in a metric's coordinates."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis
from nhpocp.declared import check, positive
from nhpocp.singular_values import svd
from nhpocp.solvers.continuation.trust_region import Number, lengths, within_radius
from nhpocp.solvers.metrics import Coordinates, WeightedMetric, weight_root


@dataclass(frozen=True)
class LinearisedPath:
    """The system linearised along one path: ξ(t) = M(t) δλ, w(t) = P(t) δλ."""

    times: Array
    variations: Array  # M at the times, (k, dimension, inputs · size), over the natural sizes of the states
    basis: ControlBasis
    inputs: Array  # their natural sizes


@dataclass(frozen=True)
class Decomposition:
    """The singular value decomposition of J over the metric's `Coordinates`, and e in its basis."""

    left: Array
    values: Array
    right: Array
    coordinates: Coordinates
    residual: Array

    def within(self, radius: Number) -> tuple[Array, Array]:
        """-J^T (J J^T + μ)⁻¹ e and its image, with the μ that makes its length in the metric the radius, or 0."""
        inner = within_radius(self.values, self.residual, radius)
        step = self.coordinates.coefficients(-times(transposed(self.right), inner))
        return step, -times(self.left, self.values * inner)


@dataclass(frozen=True)
class Direction:
    """The full step δλ, worked out when it is asked for, and what was seen of the Jacobian on the way.

    Of `MoorePenrose` also for many Jacobians at once: every number is an array (k,), every vector (k, n) then.
    """

    solve: Callable[[], Array]
    jacobian: Array
    singular_values: Array
    # σ/σ₁ up to which they count as zero
    rank_tolerance: float = 1e-8
    # whether the error cannot be reduced from here in every direction, and the inverse needs that
    blocked: Number = False
    decomposition: Decomposition | None = None
    coordinates: Coordinates | None = None  # of the metric; None: λ itself

    @property
    def rank(self) -> int:
        return rank_of(self.singular_values, self.rank_tolerance)

    @cached_property
    def step(self) -> Array:
        return self.solve()

    @property
    def image(self) -> Array:
        """J δλ, what the linear model adds to e."""
        return self.jacobian @ self.step

    def length(self, change: Array) -> Number:
        """Size of a change of λ in the metric that this direction was found in."""
        return lengths(self.coordinates.of(change) if self.coordinates else change)

    def within(self, radius: Number) -> tuple[Array, Array]:
        """A step no longer than the radius, and its image: of all such the one that reduces |e + J δλ| most.

        Without a decomposition the full step is shortened, which an ill-conditioned J turns into next to nothing.
        """
        if self.decomposition is not None:
            return self.decomposition.within(radius)
        fraction = min(1.0, radius / max(self.length(self.step), 1e-300))
        return fraction * self.step, fraction * self.image


class GeneralizedInverse(Constructed):
    """J, e ↦ δλ with J δλ ≈ -e; most inverses take the metric that is given."""

    kind: ClassVar[str]
    looks_along: ClassVar[bool] = False  # whether `metric` is asked

    def __post_init__(self) -> None:
        check(self)

    def metric(self, path: LinearisedPath) -> Array | None:
        """The factor, as of a `Metric`, of an inverse that measures δλ by what it does to the whole path; else None."""
        return None

    @abstractmethod
    def __call__(self, jacobian: Array, residual: Array, coordinates: Coordinates) -> Direction: ...


@dataclass(frozen=True)
class MoorePenrose(GeneralizedInverse):
    """The shortest δλ (in the metric) that solves J δλ = -e, by the SVD; [Paper] eq. (16).

    Singular values below ``rank_tolerance`` times the largest count as zero: 1e-8 is above the noise of a Jacobian from
    cvodes at 1e-10 and far below the ratio 3e-3 of the paper's start.
    """

    rank_tolerance: float = positive(1e-8, "of singular values that count as zero, over the largest")
    kind: ClassVar[str] = "moore_penrose"

    def __call__(self, jacobian: Array, residual: Array, coordinates: Coordinates) -> Direction:
        left, values, right = scaled_svd(jacobian, coordinates)
        along = times(transposed(left), residual)

        def solve() -> Array:
            rank = rank_of(values, self.rank_tolerance)
            return coordinates.coefficients(-right[:rank].T @ (along[:rank] / values[:rank]))

        decomposition = Decomposition(left, values, right, coordinates, along)
        blocked = rank_deficient(values, residual.shape[-1], self.rank_tolerance)
        return Direction(solve, jacobian, values, self.rank_tolerance, blocked, decomposition, coordinates)


@dataclass(frozen=True)
class Damped(GeneralizedInverse):
    """δλ = -Jᵀ (J Jᵀ + μ² I)⁻¹ e, singularity-robust: μ = ``most`` (1 - σ_min/threshold) below the threshold, else 0.

    [Nakamura, Hanafusa 1986]. The threshold is that ``fraction`` of the largest singular value.
    """

    fraction: float = positive(0.02, "of the largest singular value: the threshold")
    most: float = positive(0.02, "the greatest μ")
    kind: ClassVar[str] = "damped"

    def __call__(self, jacobian: Array, residual: Array, coordinates: Coordinates) -> Direction:
        left, values, right = scaled_svd(jacobian, coordinates)
        threshold = self.fraction * values[0]
        least = values[-1] if len(values) == len(residual) else 0.0
        damping = self.most * values[0] * max(0.0, 1.0 - least / threshold) if threshold > 0 else 1.0
        inner = -right.T @ (values / (values**2 + damping**2) * (left.T @ residual))
        step = coordinates.coefficients(inner)
        return Direction(lambda: step, jacobian, values, coordinates=coordinates)


@dataclass(frozen=True)
class Transpose(GeneralizedInverse):
    """δλ = -α Jᵀ e, with the α that reduces |e + J δλ| most: steepest descent, no inverse at all."""

    kind: ClassVar[str] = "transpose"

    def __call__(self, jacobian: Array, residual: Array, coordinates: Coordinates) -> Direction:
        _, values, _ = scaled_svd(jacobian, coordinates)
        gradient = coordinates.coefficients(coordinates.jacobian(jacobian).T @ residual)
        image = jacobian @ gradient
        squared = float(image @ image)
        alpha = float(residual @ image) / squared if squared > 0 else 0.0
        return Direction(lambda: -alpha * gradient, jacobian, values, coordinates=coordinates)


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
    rank_tolerance: float = positive(1e-8, "of singular values that count as zero, over the largest")
    kind: ClassVar[str] = "lagrangian"
    looks_along: ClassVar[bool] = True

    def metric(self, path: LinearisedPath) -> Array:
        M, horizon = path.variations, float(path.times[-1])
        steps = np.diff(path.times) / horizon
        weights = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))  # trapezoidal
        of_states = weight_root(self.state_weight, M.shape[1], definite=False) @ M
        of_states = (np.sqrt(weights)[:, None, None] * of_states).reshape(-1, M.shape[2])
        of_controls = WeightedMetric(self.control_weight).factor(path.basis, len(path.inputs), horizon).T
        of_controls = of_controls / np.repeat(np.sqrt(horizon) * path.inputs, path.basis.size)
        # the sum of squares as one triangle, never squared: M may be large beside P
        return np.asarray(np.linalg.qr(np.vstack([of_states, of_controls]), mode="r")).T

    def __call__(self, jacobian: Array, residual: Array, coordinates: Coordinates) -> Direction:
        return MoorePenrose(self.rank_tolerance)(jacobian, residual, coordinates)


def scaled_svd(jacobian: Array, coordinates: Coordinates) -> tuple[Array, Array, Array]:
    """Singular value decomposition of J between the metric's orthonormal coordinates and the error."""
    left, values, right = svd(coordinates.jacobian(jacobian), full_matrices=False)
    return left, values, right


def rank_of(values: Array, tolerance: float) -> int:
    """Singular values above ``tolerance`` times the largest."""
    return int(np.count_nonzero(values > tolerance * values[0])) if values.size else 0


def rank_deficient(values: Array, rows: int, tolerance: float) -> Number:
    """Whether fewer singular values (…, r), largest first, than ``rows`` are above ``tolerance`` times the largest."""
    if values.shape[-1] < rows:
        return np.ones(values.shape[:-1], dtype=bool)
    return np.logical_not(values[..., -1] > tolerance * values[..., 0])


def times(matrices: Array, vectors: Array) -> Array:
    """A matrix times a vector, or each of many times its own."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def transposed(matrices: Array) -> Array:
    return matrices.swapaxes(-1, -2)
