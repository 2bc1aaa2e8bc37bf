"""Least cost among the controls that reach the goal: motion in the null space of the end-point Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nhpocp.arrays import Array

Constraint = Callable[[Array], tuple[Array, Array] | None]  # y ↦ (e, J), None where the path cannot be used
Cost = Callable[[Array], tuple[float, Array]]  # y ↦ (f, ∇f)


@dataclass(frozen=True)
class NullSpaceResult:
    """Where the search ended: y, its cost, the projected gradient's size, and what it took."""

    y: Array
    cost: float
    optimality: float  # |∇f + Jᵀμ| with the best μ
    infeasibility: float  # |e|
    converged: bool
    evaluations: int
    history: list[dict[str, Any]]


def minimise(
    constraint: Constraint,
    cost: Cost,
    y: Array,
    *,
    tolerance: float = 1e-8,
    goal: float = 1e-9,
    most: int = 200,
) -> NullSpaceResult:
    r"""min f(y) subject to e(y) = 0 from a point near e = 0, along the surface e = 0.

    Each step lies in the null space of J and minimises a BFGS model of the Lagrangian's Hessian there; Newton steps
    -J^# e bring it back to the surface, and f must fall (Armijo). A projected gradient that ends as SQP: near the
    optimum the corrections are of second order. [Nocedal, Wright, ch. 15 and 18]
    y are coordinates in which the metric is Euclidean, so that 2 I, with which the model begins, is the exact Hessian
    of the effort itself. ``tolerance`` is on the projected gradient relative to |∇f|, ``goal`` on |e|.
    """
    search = _Search(constraint, cost, goal)
    point = search.restored(y)
    if point is None:
        raise ValueError("the search must start near a usable control that reaches the goal")
    hessian, fresh = 2.0 * np.eye(len(y)), True
    history: list[dict[str, Any]] = []
    for k in range(most):
        history.append({"k": k, "cost": point.f, "optimality": float(np.linalg.norm(point.residual))})
        if history[-1]["optimality"] < tolerance * max(1.0, float(np.linalg.norm(point.gradient))):
            return search.result(point, True, history)
        there = search.along(point, _null_step(point, hessian))
        if there is None and fresh:
            break
        if there is None:
            hessian, fresh = (
                2.0 * np.eye(len(y)),
                True,
            )  # the model was at fault: begin again from its exact part
            continue
        change = (there.gradient + there.J.T @ there.mu) - (point.gradient + point.J.T @ there.mu)
        hessian, fresh = _bfgs(hessian, there.y - point.y, change), False
        point = there
    return search.result(point, False, history)


@dataclass(frozen=True)
class _Point:
    """A point of the surface, with the multipliers that fit the gradient best."""

    y: Array
    e: Array
    J: Array
    f: float
    gradient: Array

    @cached_property
    def mu(self) -> Array:
        return -np.linalg.lstsq(self.J.T, self.gradient, rcond=None)[0]

    @cached_property
    def residual(self) -> Array:
        """∇f + Jᵀμ, the part of the gradient in the null space."""
        return self.gradient + self.J.T @ self.mu


class _Search:
    """Evaluations on and near the surface e = 0."""

    def __init__(self, constraint: Constraint, cost: Cost, goal: float) -> None:
        self.constraint, self.cost, self.goal, self.evaluations = constraint, cost, goal, 0

    def restored(self, y: Array, tries: int = 6) -> _Point | None:
        """The point of the surface that Newton's method finds from y; None if it does not come nearer."""
        last = np.inf
        for _ in range(tries):
            self.evaluations += 1
            evaluated = self.constraint(y)
            if evaluated is None:
                return None
            e, J = evaluated
            size = float(np.linalg.norm(e))
            if size < self.goal:
                return _Point(y, e, J, *self.cost(y))
            if size > 0.5 * last:
                return None
            last = size
            y = y - np.linalg.lstsq(J, e, rcond=None)[0]
        return None

    def along(self, point: _Point, step: Array) -> _Point | None:
        """The first of 1, ½, ¼, … of a step that, brought back to the surface, lowers the cost enough."""
        slope, share = float(point.gradient @ step), 1.0
        for _ in range(25):
            there = self.restored(point.y + share * step)
            if there is not None and there.f <= point.f + 1e-4 * share * slope + 1e-13 * abs(point.f):
                return there
            share *= 0.5
        return None

    def result(self, point: _Point, converged: bool, history: list[dict[str, Any]]) -> NullSpaceResult:
        sizes = float(np.linalg.norm(point.residual)), float(np.linalg.norm(point.e))
        return NullSpaceResult(point.y, point.f, *sizes, converged, self.evaluations, history)


def _null_step(point: _Point, hessian: Array) -> Array:
    """The minimiser of the quadratic model in the null space of J."""
    _, values, right = np.linalg.svd(point.J)
    null = right[int(np.sum(values > 1e-10 * values[0])) :].T
    return -null @ np.linalg.solve(null.T @ hessian @ null, null.T @ point.gradient)


def _bfgs(hessian: Array, step: Array, change: Array) -> Array:
    """Powell's damped update: stays positive definite."""
    image = hessian @ step
    curvature, along = float(step @ image), float(step @ change)
    if curvature <= 0:
        return hessian
    theta = 1.0 if along >= 0.2 * curvature else 0.8 * curvature / (curvature - along)
    mixed = theta * change + (1 - theta) * image
    return hessian - np.outer(image, image) / curvature + np.outer(mixed, mixed) / float(step @ mixed)
