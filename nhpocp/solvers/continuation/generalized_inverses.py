"""Ways to solve J δλ = -e for the change of the control: generalized inverses, each in a metric's coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.solvers.metrics import Coordinates, WeightedMetric, weight_root

NEGLIGIBLE = 1e-14  # σ/σ₁ under which a singular value is rounding


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
