"""Least cost among the controls that reach the goal, and keep to inequalities: motion in the null space of J."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.curvature import Curvature

Constraint = Callable[[Array], tuple[Array, Array] | None]  # y ↦ (e, J), None where the path cannot be used
Cost = Callable[[Array], tuple[float, Array]]  # y ↦ (f, ∇f)
RowValues = Callable[[Array], Array]  # y ↦ g, wanted ≥ 0
RowSlopes = Callable[[Array], Array]  # y ↦ ∂g/∂y


HALVINGS = 16  # of a step, before the model counts as wrong
REACH = 3.0  # times the last step that was kept
FIRST_REACH = 0.5  # times the size of y
BESIDE = 0.1  # of a step and of what it promises: how far it may end beside the surface, and the cost of that
FAR = 1.0  # of e, dimensionless: where the model of the surface is no guide back to it
NOTHING = 1e-14  # of the merit: a promise not worth a step
NOISE = 1e-13  # of the merit: what rounding may add to it
PATIENCE = 10  # steps in a row that gain no more than that


@dataclass(frozen=True)
class Penalty:
    """½ weight Σ max(0, shift - g(y))², the exterior penalty of rows g ≥ 0; shift: multipliers over the weight.

    ``values`` is asked at the y that `Constraint` has just seen, ``slopes`` only where a step is taken from.
    """

    values: RowValues
    slopes: RowSlopes
    shift: Array
    weight: float


@dataclass(frozen=True)
class NullSpaceResult:
    """Where the search ended: y, its cost, the projected gradient's size, and what it took."""

    y: Array
    cost: float
    optimality: float  # |∇f + Jᵀμ| with the best μ; with a penalty, ∇f includes its own
    infeasibility: float  # |e|
    converged: bool
    evaluations: int
    history: list[dict[str, Any]]
    hessian: Curvature = field(repr=False)
    rows: Array = field(repr=False)  # g there; empty without a penalty


class NoSurfaceError(ValueError):
    """No usable control that reaches the goal near the one that the search was to begin with."""


def minimise(
    constraint: Constraint,
    cost: Cost,
    y: Array,
    *,
    penalty: Penalty | None = None,
    curvature: float = 2.0,
    hessian: Curvature | None = None,
    tolerance: float = 1e-8,
    goal: float = 1e-9,
    most: int = 400,
    budget: Budget | None = None,
) -> NullSpaceResult:
    r"""min f(y) [+ penalty] subject to e(y) = 0 from a point near e = 0, along the surface e = 0.

    Each step minimises a BFGS model of the Lagrangian's Hessian in the null space of J, on top of Newton's step -J^# e
    back to the surface; further Newton steps follow only where it ends too far beside the surface for what it promises,
    and the cost must fall (Armijo), with e at the multipliers' price. A projected gradient that ends as SQP. [Nocedal,
    Wright, ch. 15 and 18]
    The model keeps the penalty as it is, over the linearised rows: its kinks and its weight cost no progress.
    The model begins with ``curvature`` I, or with the ``hessian`` of an earlier search: where y are coordinates in
    which the effort is |y|², 2 I is exact for it. ``tolerance`` is on the projected gradient relative to |∇f|,
    ``goal`` on |e|.
    Where the ``budget`` refuses ``constraint`` another evaluation, the search ends with what it has.
    Errors: `NoSurfaceError`.
    """
    budget = budget or Budget()
    search = _Search(constraint, cost, penalty, goal)
    point = search.restored(y, far=np.inf)
    if point is None:
        raise NoSurfaceError("the search must start near a usable control that reaches the goal")
    search.kept = point
    first = Curvature.first(curvature, len(y), full=penalty is not None)
    model, fresh = hessian or first, hessian is None
    if penalty and hessian:  # whose kinks lie in any direction
        model = hessian.full(curvature)
    history: list[dict[str, Any]] = []
    idle = 0
    for k in range(most):
        history.append({"k": k, "cost": point.f, "optimality": float(norm(point.residual))})
        step = point.step(model)
        slope = max(1.0, float(norm(point.gradient)))
        if history[-1]["optimality"] < tolerance * slope or step.promised <= NOTHING * abs(point.merit):
            search.settle(point)
            return search.result(not budget.refused, history, model)
        there = search.along(point, step)
        back = None if there else search.back(point)
        if budget.refused:  # what was found so far is kept
            return search.result(False, history, model)
        if there is None:
            if back is None and fresh:
                break
            if back is None:  # the model was at fault: begin again from its exact part
                model, fresh = first, True
            point = back or point
            continue
        change = there.lagrangian_slope(there) - point.lagrangian_slope(there)
        model, fresh = model.updated(there.y - point.y, change), False
        idle = idle + 1 if search.gain(point, there) < NOISE * abs(point.merit) else 0
        point = there
        if idle == PATIENCE:  # held by the controls that may not be used
            break
    search.settle(point)
    return search.result(False, history, model)


class _Step(NamedTuple):
    """A step of the model, and what it promises of the merit."""

    normal: Array  # -J^# e
    along: Array  # in the null space of J
    promised: float
    hessian: Curvature


@dataclass(frozen=True)
class _Point:
    """A point of the surface, with the multipliers that fit the gradient best."""

    y: Array
    e: Array
    J: Array
    f: float
    slope: Array  # ∇f
    penalty: Penalty | None = None
    excess: Array = field(default_factory=lambda: np.empty(0))  # shift - g

    @property
    def merit(self) -> float:
        """f and the penalty."""
        return self.f + 0.5 * self.weight * float(np.sum(np.maximum(0.0, self.excess) ** 2))

    @property
    def weight(self) -> float:
        return self.penalty.weight if self.penalty else 0.0

    @cached_property
    def row_slopes(self) -> Array:
        """∂g/∂y."""
        return self.penalty.slopes(self.y) if self.penalty else np.empty((0, len(self.y)))

    @property
    def kappa(self) -> Array:
        """Multipliers of the rows."""
        return self.weight * np.maximum(0.0, self.excess)

    @cached_property
    def gradient(self) -> Array:
        """Of the merit."""
        return self.slope - self.kappa @ self.row_slopes

    @cached_property
    def mu(self) -> Array:
        return -np.linalg.lstsq(self.J.T, self.gradient, rcond=None)[0]

    @cached_property
    def residual(self) -> Array:
        """∇merit + Jᵀμ, the part of the gradient in the null space."""
        return self.gradient + self.J.T @ self.mu

    def lagrangian_slope(self, other: _Point) -> Array:
        """∇f + Jᵀμ - ∂gᵀκ here with another point's multipliers."""
        return self.slope + self.J.T @ other.mu - other.kappa @ self.row_slopes

    def step(self, model: Curvature) -> _Step:
        """To the minimiser of the model on the linearised surface."""
        model = model.over(self.J.T, self.slope)  # among these it lies; where there is a penalty they are all
        seen, hessian, slope = model.seen, model.inner, model.seen.T @ self.slope
        left, values, right = np.linalg.svd(self.J @ seen)
        rank = int(np.sum(values > 1e-10 * values[0]))
        normal, null = -right[:rank].T @ ((left.T @ self.e)[:rank] / values[:rank]), right[rank:].T
        curvature, slope = null.T @ hessian @ null, null.T @ (slope + hessian @ normal)
        if self.penalty:
            rows = self.row_slopes @ seen
            excess = self.excess - rows @ normal
            z, promised = _least_of_pieces(curvature, slope, excess, rows @ null, self.weight)
        else:
            z = -np.linalg.solve(curvature, slope)
            promised = -0.5 * float(slope @ z)
        return _Step(seen @ normal, seen @ (null @ z), promised, model)


class _Search:
    """Evaluations on and near the surface e = 0."""

    def __init__(self, constraint: Constraint, cost: Cost, penalty: Penalty | None, goal: float) -> None:
        self.constraint, self.cost, self.penalty, self.goal = constraint, cost, penalty, goal
        self.evaluations = 0
        self.reach: float | None = None  # the longest step that is tried, from what the last one told
        self.kept: _Point | None = None  # the best on the surface

    def settle(self, point: _Point) -> None:
        """Keeps a point, brought all the way to the surface; what was kept before, if that fails or costs more."""
        found = point if self.on_surface(point) else self.back(point)
        if found and (self.kept is None or self.gain(self.kept, found) >= -NOISE * abs(found.merit)):
            self.kept = found

    def back(self, point: _Point) -> _Point | None:
        """A point beside the surface brought to it, from where steps that have become short may succeed; else None."""
        return None if self.on_surface(point) else self.restored(point.y, seen=point)

    def restored(
        self,
        y: Array,
        tries: int = 6,
        far: float = FAR,
        near: Callable[[Array], bool] | None = None,
        seen: _Point | None = None,
    ) -> _Point | None:
        """The point of the surface that Newton's method finds from y; None if it is too far or does not come nearer.

        ``near``: whether Newton's next step is one that need not be taken. ``seen``: what is known of y.
        """
        last = np.inf
        for _ in range(tries):
            if seen is None:
                self.evaluations += 1
                evaluated = self.constraint(y)
            else:
                evaluated, seen = (seen.e, seen.J), None
            if evaluated is None:
                return None
            e, J = evaluated
            size, back = norm(e), np.linalg.lstsq(J, e, rcond=None)[0]
            if size < self.goal or (near and size < far and near(back)):
                return self._point(y, e, J)
            if size > min(0.5 * last, far):
                return None
            last = size
            y = y - back
        return None

    def _point(self, y: Array, e: Array, J: Array) -> _Point | None:
        if not self.penalty:
            return _Point(y, e, J, *self.cost(y))
        excess = self.penalty.shift - self.penalty.values(y)
        return _Point(y, e, J, *self.cost(y), self.penalty, excess) if np.isfinite(excess).all() else None

    def along(self, point: _Point, step: _Step) -> _Point | None:
        """The first of 1, ½, ¼, … of a step that, brought back to the surface, lowers the merit enough.

        On a strongly curved surface the model promises steps that lead nowhere; none is tried that is more than
        ``REACH`` times as long as the last that was kept.
        """
        size = norm(step.along)
        reach = self.reach or FIRST_REACH * (1.0 + norm(point.y))
        share = min(1.0, reach / size) if size > 0 else 1.0
        for _ in range(HALVINGS):
            least = 1e-4 * share * step.promised - NOISE * abs(point.merit)
            y = point.y + step.normal + share * step.along
            there = self.restored(y, near=partial(_near_enough, step, share))
            if there and self.gain(point, there) < least and not self.on_surface(there):
                there = self.restored(there.y, seen=there)  # the price may have been wrong
            if there and self.gain(point, there) >= least:
                self.reach = REACH * share * size
                if self.on_surface(there):
                    self.kept = there
                return there
            share *= 0.5
        return None

    def gain(self, point: _Point, there: _Point) -> float:
        """How much less there costs, with what is left of e at the multipliers' price."""
        return point.merit - there.merit + float(point.mu @ (point.e - there.e))

    def on_surface(self, point: _Point) -> bool:
        return bool(norm(point.e) < self.goal)

    def result(self, converged: bool, history: list[dict[str, Any]], hessian: Curvature) -> NullSpaceResult:
        """What was kept."""
        point = self.kept
        if point is None:
            raise RuntimeError("a search that has not begun")
        rows = self.penalty.shift - point.excess if self.penalty else point.excess
        sizes = float(norm(point.residual)), float(norm(point.e))
        return NullSpaceResult(point.y, point.f, *sizes, converged, self.evaluations, history, hessian, rows)


def _near_enough(step: _Step, share: float, back: Array) -> bool:
    """Whether a step may end beside the surface, Newton's way back left to the next one."""
    short = bool(norm(back) < BESIDE * share * norm(step.along))
    return short and 0.5 * float(back @ (step.hessian @ back)) < BESIDE * share * step.promised


def _least_of_pieces(
    hessian: Array, slope: Array, excess: Array, rows: Array, weight: float
) -> tuple[Array, float]:
    """The minimiser z of ½ zᵀHz + slope·z + ½ weight Σ max(0, excess - rows z)², and how far it lies below z = 0.

    Convex and quadratic in pieces: Newton's method from piece to piece, with the exact minimum along each step, ends
    after finitely many. [J. Sun, On piecewise quadratic Newton and trust region problems, Math. Programming 76, 1997]
    """

    def derivative(z: Array) -> tuple[Array, Array]:
        left = np.maximum(0.0, excess - rows @ z)
        return hessian @ z + slope - weight * (left @ rows), left

    def value(z: Array) -> float:
        left = np.maximum(0.0, excess - rows @ z)
        return float(0.5 * z @ hessian @ z + slope @ z + 0.5 * weight * (left @ left))

    z = np.zeros(len(slope))
    first = least = value(z)
    for _ in range(50):
        gradient, left = derivative(z)
        active = rows[left > 0]
        newton = -np.linalg.solve(hessian + weight * (active.T @ active), gradient)
        if -float(newton @ gradient) <= 1e-10 * (first - least):
            break
        low, high = 0.0, 1.0
        if float(newton @ derivative(z + newton)[0]) > 0:  # the minimum along the step lies before its end
            for _ in range(20):
                middle = 0.5 * (low + high)
                rising = float(newton @ derivative(z + middle * newton)[0]) > 0
                low, high = (low, middle) if rising else (middle, high)
        z = z + high * newton
        least = value(z)
    return z, first - least
