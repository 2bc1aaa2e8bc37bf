"""The region around a control in which the linear model of e is trusted, and what is made of a step inside it.

The formulas are the same for one search and for many: a number is then an array (k,), a vector (k, n), a matrix
(k, r, n). [Nocedal, Wright, Numerical Optimization, ch. 4 and 10]
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from nhpocp.arrays import Array

LEAST_GAIN = 0.05  # gain ratio above which a trial is accepted
LEAST_PREDICTED = 1e-9  # fraction of |e| that a step must be predicted to remove
SMALLEST = 1e-7  # of the first radius: no shorter steps are tried
NEGLIGIBLE = 1e-14  # σ/σ₁ up to which a singular value is rounding
POOR, GOOD = 0.25, 0.75  # gain ratios below which the region narrows, above which it may widen
NARROWER, NARROWEST = 0.5, 0.25  # times the step: where it gained a little, where it gained nothing
WIDER = 2.5  # times the step
DAMPINGS = 30  # of Newton's method on 1/length, at most
LONG = 1e-3  # of the radius, by which a step may be longer

Number = Any  # a float for one search, an array (k,) for many


class Model(Protocol):
    """The linear model e + J δλ of one search or of many."""

    def within(self, radius: Number) -> tuple[Array, Array]:
        """The step that reduces |e + J δλ| most of all no longer than the radius, and its image J δλ."""
        ...

    def length(self, change: Array) -> Number:
        """Of a change of λ, in the metric."""
        ...


class Tried(Protocol):
    """Where a step led."""

    @property
    def merit(self) -> Number: ...

    @property
    def usable(self) -> Number: ...


class Step(NamedTuple):
    """A step inside the trust region."""

    change: Array  # δλ
    size: Number  # its length in the metric
    merit: Number  # |e| at its start
    predicted_reduction: Number  # of |e|, by the linear model

    @property
    def worthwhile(self) -> Number:
        return self.predicted_reduction > LEAST_PREDICTED * self.merit

    @property
    def fraction(self) -> Number:
        """Of |e| that the step is predicted to remove."""
        return self.predicted_reduction / self.merit

    def of(self, mask: Array) -> Self:
        """Those of some of many searches."""
        return type(self)(*(part[mask] for part in self))


class TrustRegion(NamedTuple):
    """|ΔΛ| ≤ radius, in the metric."""

    radius: Number
    smallest: Number

    @classmethod
    def first(cls, radius: Number) -> Self:
        return cls(radius, SMALLEST * radius)

    @property
    def open(self) -> Number:
        """Whether steps are still long enough to be tried."""
        return self.radius > self.smallest

    def of(self, mask: Array) -> Self:
        """Those of some of many searches."""
        return type(self)(*(part[mask] for part in self))

    def step(self, model: Model, residual: Array, merit: Number) -> Step:
        """The best that the model knows in the region, from a control with e and |e|."""
        change, image = model.within(self.radius)
        return Step(change, model.length(change), merit, merit - lengths(residual + image))

    def after(self, step: Step, gain: Number) -> Self:
        """The region after a trial: narrower where the model was wrong, wider where it was right and hemmed in."""
        return type(self)(next_radius(self.radius, step.size, gain), self.smallest)


def gain_ratio(trial: Tried, step: Step) -> Number:
    """Actual over predicted reduction; -inf for a trial whose path is not one to go on from."""
    return np.where(trial.usable, (step.merit - trial.merit) / step.predicted_reduction, -np.inf)


def next_radius(radius: Number, size: Number, gain: Number) -> Array:
    """The radius after a step of this size and gain ratio."""
    shorter = np.where(np.greater(gain, 0.0), NARROWER, NARROWEST) * np.minimum(radius, size)
    longer = np.where(np.greater(gain, GOOD), np.maximum(radius, np.multiply(WIDER, size)), radius)
    return np.where(np.less(gain, POOR), shorter, longer)


def within_radius(values: Array, residual: Array, radius: Number) -> Array:
    """σ e/(σ² + μ) with the μ that makes its length the radius, or 0 if it is shorter: (…, r) each, radii (…,).

    The trust-region subproblem of least squares over singular values σ, largest first, by Newton's method on 1/length
    [Moré, Sorensen 1983]; nothing is done along those that are negligible.
    """
    squares, product = values**2, values * residual
    if (values[..., -1] <= NEGLIGIBLE * values[..., 0]).any():
        negligible = values <= NEGLIGIBLE * values[..., :1]
        squares, product = np.where(negligible, 1.0, squares), np.where(negligible, 0.0, product)
    damping = np.zeros((*values.shape[:-1], 1))
    inner = product / squares
    for _ in range(DAMPINGS):
        squared = (inner * inner).sum(-1)
        excess = np.sqrt(squared) / radius - 1.0
        long = excess > LONG
        if not long.any():
            break
        slope = np.where(long, (inner * inner / (squares + damping)).sum(-1), 1.0)
        damping = damping + np.where(long, excess * squared / slope, 0.0)[..., None]
        inner = product / (squares + damping)
    return inner


def lengths(vectors: Array) -> Number:
    """Euclidean, of (…, n)."""
    return np.sqrt(np.add.reduce(vectors * vectors, axis=-1))
