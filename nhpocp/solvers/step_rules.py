"""How far to go along the full step of the continuation, (16): Euler's fixed share, a trust region, an ODE in θ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.evaluation import Evaluation

Evaluate = Callable[[Array, float], Evaluation]  # (coefficients, γ that led there) ↦ the evaluation, recorded


class StepRule(Protocol):
    """The updates of one continuation."""

    kind: ClassVar[str]

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        """Yields every control that becomes the current one; may evaluate others between. Ends if it is at a loss."""
        ...

    def settings(self) -> dict[str, Any]:
        """The rule's own settings under the problem file's names."""
        ...


def full_step(here: Evaluation) -> Array:
    """δΛ with J δλ = -e, inputs × size; zero where there is no direction."""
    if here.direction is None:
        return np.zeros_like(here.coefficients)
    return here.direction.step.reshape(here.coefficients.shape)


def promised_merit(here: Evaluation, gamma: float) -> float:
    """|e + γ J δλ|, the linear model of the error after a share of the full step."""
    if here.direction is None or here.vector is None:
        return here.merit
    return float(np.linalg.norm(here.vector + gamma * here.direction.image))


@dataclass(frozen=True)
class Euler:
    """Λ ← Λ - γ J^# e, [Paper] eq. (17). The paper names no γ; 0.1 is ours."""

    gamma: float = 0.1
    kind: ClassVar[str] = "euler"

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        while True:
            here = evaluate(here.coefficients + self.gamma * full_step(here), self.gamma)
            yield here

    def settings(self) -> dict[str, Any]:
        return {"gamma": self.gamma}


@dataclass(frozen=True)
class Adaptive:
    """Steps γ J^# e, γ ≤ 1, inside a trust region |ΔΛ| ≤ Δ. [Nocedal, Wright, Numerical Optimization, ch. 4]

    The linear model promises the error |e + γ J δλ|, (1 - γ) |e| for a full inverse; the share of that promise which is
    kept widens or narrows Δ. A trial whose path is not finite, or jumps across a surface that the equations cannot
    cross, is refused like one that promises too much. Near the solution γ = 1 is Newton's method. The size of a step is
    that of its coefficients.
    """

    first_radius: float = 4.0
    kind: ClassVar[str] = "adaptive"

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        radius = self.first_radius * (1.0 + float(np.linalg.norm(here.coefficients)))
        smallest = 1e-10 * radius
        while radius > smallest:
            step = full_step(here)
            length = float(np.linalg.norm(step))
            gamma = min(1.0, radius / length) if length > 0 else 1.0
            trial = evaluate(here.coefficients + gamma * step, gamma)
            if trial.failure or trial.crossing:
                radius = 0.25 * gamma * length
                continue
            kept = (here.merit - trial.merit) / (here.merit - promised_merit(here, gamma))
            if kept < 0.25:
                radius = (0.5 if kept > 0 else 0.25) * gamma * length
            elif kept > 0.75:
                radius = max(radius, 2.5 * gamma * length)
            if kept > 0.05:
                here = trial
                yield here

    def settings(self) -> dict[str, Any]:
        return {}


@dataclass(frozen=True)
class Ode:
    """(16) itself, dΛ/dθ = -γ J^# e, integrated in θ by an adaptive Runge–Kutta scheme.

    Then e(θ) = e^{-γθ} e(0) to the integration's tolerance, [Paper] eq. (9); an update's γ is γ Δθ. By SciPy's DOP853
    rather than SUNDIALS: the right-hand side is an SVD of numbers, which CasADi could only see as a callback.
    """

    gamma: float = 0.1
    tolerance: float = 1e-9
    kind: ClassVar[str] = "ode"

    def updates(self, here: Evaluation, evaluate: Evaluate) -> Iterator[Evaluation]:
        from scipy.integrate import DOP853

        shape = here.coefficients.shape

        def rate(theta: float, coefficients: Array) -> Array:
            tried = evaluate(coefficients.reshape(shape), self.gamma)
            return self.gamma * full_step(tried).ravel()

        accuracy = {"rtol": self.tolerance, "atol": self.tolerance}
        solver = DOP853(rate, 0.0, here.coefficients.ravel(), np.inf, **accuracy)
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                return
            yield evaluate(solver.y.reshape(shape), float(solver.t - solver.t_old) * self.gamma)

    def settings(self) -> dict[str, Any]:
        return {"gamma": self.gamma}
