"""How far to go along the full step of the continuation, (16): Euler's fixed fraction, a trust region, an ODE in θ."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf, log, log1p
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.declared import check, positive
from nhpocp.solvers.continuation.ending import NO_EVALUATION_LEFT
from nhpocp.solvers.continuation.evaluation import Evaluation
from nhpocp.solvers.continuation.trust_region import LEAST_GAIN, Number, TrustRegion, gain_ratio

# (coefficients, γ that led there) ↦ the evaluation, recorded; a failed one where no evaluation is left
Evaluate = Callable[[Array, float], Evaluation]


class StepRule(Constructed):
    """The updates of one continuation."""

    kind: ClassVar[str]
    evaluations: ClassVar[int] = 1  # that an update takes; trials that are refused count besides

    def __post_init__(self) -> None:
        check(self)

    @abstractmethod
    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        """Yields every control that becomes the current one; may evaluate others between. Ends if it is at a loss."""

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """The rule's own settings under the problem file's names."""

    def updates_left(self, error: float, tolerance: float) -> float | None:
        """How many updates the theory foretells until the error is below the tolerance; None where it is silent."""
        return None


def full_step(here: Evaluation) -> Array:
    """The full step δΛ with J δλ = -e, inputs × size, of which a rule takes a part; zero where there is no direction.

    here: the `Evaluation` of the current control, as `StepRule.updates` is given it. Raises nothing.
    """
    if here.direction is None:
        return np.zeros_like(here.coefficients)
    return here.direction.step.reshape(here.coefficients.shape)


@dataclass(frozen=True)
class Euler(StepRule):
    """Λ ← Λ - γ J^# e, [Paper] eq. (17). The paper names no γ; 0.1 is ours."""

    gamma: float = positive(0.1, "γ of (17), the share of the error that a step should remove")
    kind: ClassVar[str] = "euler"

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        while True:
            here = evaluate(here.coefficients + self.gamma * full_step(here), self.gamma)
            yield here

    def settings(self) -> dict[str, Any]:
        return {"gamma": self.gamma}

    def updates_left(self, error: float, tolerance: float) -> float | None:
        """To first order an update leaves 1 - γ of e, as (9) with dθ = 1; nothing is foretold near γ = 1."""
        if not 0.0 < self.gamma < 0.9 or not tolerance < error < inf:
            return None
        return log(tolerance / error) / log1p(-self.gamma)


@dataclass(frozen=True)
class Adaptive(StepRule):
    """Steps inside a trust region |ΔΛ| ≤ Δ. [Nocedal, Wright, Numerical Optimization, ch. 4 and 10]

    Of all steps so short the one is taken that reduces the linear model |e + J δλ| most (`Direction.within`); the gain
    ratio, actual over predicted reduction, widens or narrows Δ. A trial whose path is not finite, or jumps across a
    surface that the equations cannot cross, is refused like one that gains too little. Near the solution the step is
    (16)'s with γ = 1, Newton's method; γ of the records is the fraction of the error that is predicted to go.
    ``first_radius`` is in units of 1 + |Λ₀|; lengths are those of the metric, in which a natural control has 1.
    """

    first_radius: float = positive(0.5, "of the trust region, in units of 1 + |Λ₀|")
    kind: ClassVar[str] = "adaptive"

    def region(self, length: Number) -> TrustRegion:
        """Around a first control of this length."""
        return TrustRegion.first(self.first_radius * (1.0 + length))

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        if here.direction is None:
            return
        region = self.region(here.direction.length(here.coefficients.ravel()))
        while region.open and here.direction is not None and here.residual is not None:
            step = region.step(here.direction, here.residual, here.merit)
            if not step.worthwhile:
                return
            trial = evaluate(here.coefficients + step.change.reshape(here.coefficients.shape), step.fraction)
            if trial.failure == NO_EVALUATION_LEFT:
                return
            gain = gain_ratio(trial, step)
            region = region.after(step, gain)
            if gain > LEAST_GAIN:
                here = trial
                yield here

    def settings(self) -> dict[str, Any]:
        return {}


@dataclass(frozen=True)
class Ode(StepRule):
    """(16) itself, dΛ/dθ = -γ J^# e, integrated in θ by an adaptive Runge–Kutta scheme.

    Then e(θ) = e^{-γθ} e(0) to the integration's tolerance, [Paper] eq. (9); an update's γ is γ Δθ. By SciPy's DOP853
    rather than SUNDIALS: the right-hand side is an SVD of numbers, which CasADi could only see as a callback.
    """

    gamma: float = positive(0.1, "γ of (16)")
    tolerance: float = positive(1e-9, "relative and absolute, of the integration in θ")
    kind: ClassVar[str] = "ode"
    evaluations: ClassVar[int] = 13  # DOP853's stages, and the end of the step for the record

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        from scipy.integrate import DOP853

        shape, coordinates = here.coefficients.shape, here.direction.coordinates if here.direction else None
        if coordinates is None:
            return

        def control(z: Array) -> Array:
            return coordinates.coefficients(z).reshape(shape)

        def rate(theta: float, z: Array) -> Array:
            return self.gamma * coordinates.of(full_step(evaluate(control(z), self.gamma)).ravel())

        accuracy = {"rtol": self.tolerance, "atol": self.tolerance}
        solver = DOP853(rate, 0.0, coordinates.of(here.coefficients.ravel()), np.inf, **accuracy)
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                return
            yield evaluate(control(solver.y), float(solver.t - solver.t_old) * self.gamma)

    def settings(self) -> dict[str, Any]:
        return {"gamma": self.gamma}
