r"""Explicit Runge–Kutta schemes as data. Whatever takes a step, by CasADi or in C, is made from a `Tableau`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array


@dataclass(frozen=True)
class Tableau:
    r"""A step of ẏ = f(y, u) in s stages, [Hairer, Nørsett, Wanner] II.1:

        k_i = f(Y_i, u_i),    Y_i = y + h Σ_{j<i} a_ij k_j,    y⁺ = y + h Σ_i b_i k_i / Σ_i b_i.

    The control is seen at some fractions of a step only. A grid shares what two steps see at the time between them.
    """

    order: int  # of the error of a path in h
    fractions: tuple[float, ...]  # of a step where it sees the control: from 0, rising, to 1
    places: tuple[int, ...]  # (s,): which of them u_i is
    rows: tuple[tuple[float, ...], ...]  # a_ij: to each stage those of the stages before it
    weights: tuple[float, ...]  # (s,): b_i, up to a common factor

    @property
    def stages(self) -> int:
        return len(self.weights)

    @property
    def seen(self) -> int:
        """Controls that a step sees."""
        return len(self.fractions)

    def samples(self, steps: int) -> int:
        """Controls that steps after one another see, if none jumps."""
        return (self.seen - 1) * steps + 1

    def times(self, knots: Array) -> Array:
        """Where steps between rising knots see the control: (samples(steps),)."""
        seen = [(1.0 - fraction) * knots[:-1] + fraction * knots[1:] for fraction in self.fractions[:-1]]
        return np.append(np.ravel(seen, order="F"), knots[-1])

    def weight(self, stage: int) -> float:
        """b_i / Σ b."""
        return self.weights[stage] / sum(self.weights)

    def step(self, rate: Callable[[ca.SX, int], ca.SX], y: ca.SX, h: Any) -> tuple[ca.SX, list[ca.SX]]:
        """y⁺ and the points Y_i; ``rate`` of a point and of the place of its control."""
        points: list[ca.SX] = []
        slopes: list[ca.SX] = []
        total = ca.SX.zeros(y.size1())
        for row, place, weight in zip(self.rows, self.places, self.weights, strict=True):
            point = y
            for a, slope in zip(row, slopes, strict=True):
                point = point + a * h * slope if a else point
            points.append(point)
            slopes.append(rate(point, place))
            total += weight * slopes[-1]
        return y + h / sum(self.weights) * total, points

    def pulled_back(self, c: ca.SX, slopes: Sequence[ca.SX], h: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
        """The rows c before the step, and their derivatives by the controls that it sees.

        With ``slopes`` = [∂f/∂y, ∂f/∂u] at the points Y_i,
            κ_i = h (b_i c + Σ_{j>i} a_ji κ_j ∂f/∂y_j),    c ↦ c + Σ κ_i ∂f/∂y_i,    ∂/∂u_i = κ_i ∂f/∂u_i:
        the transpose of the scheme itself, exact to rounding, [Hager].
        """
        n, before, gradients = c.size2(), c, [ca.SX(0)] * self.seen
        through: list[ca.SX] = [ca.SX(0)] * self.stages
        for i in reversed(range(self.stages)):
            kappa = (self.weight(i) * h) * c
            for j in range(i + 1, self.stages):
                kappa = kappa + (self.rows[j][i] * h) * through[j] if self.rows[j][i] else kappa
            by_point, by_control = ca.horzsplit(kappa @ slopes[i], [0, n, slopes[i].size2()])
            through[i] = by_point
            before = before + by_point
            gradients[self.places[i]] = gradients[self.places[i]] + by_control
        return before, gradients


CLASSICAL = Tableau(
    order=4,
    fractions=(0.0, 0.5, 1.0),
    places=(0, 1, 1, 2),
    rows=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    weights=(1.0, 2.0, 2.0, 1.0),
)
