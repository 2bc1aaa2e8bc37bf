"""Least cost among the controls that reach the goal: motion in the null space of J.

Why not a library: end-point evaluations on the same callbacks from the same controls, November 2026. Three objectives
over Fourier controls of 3 and 5 functions on four presets, of 21 on two; the same scaling for all, 600 at most.

| functions: cases | this | SLSQP | IPOPT, L-BFGS |
|---|---|---|---|
| 3: 12 | 175 | 206 | 260 |
| 5: 12 | 386 | 2559 | 693 |
| 21: 6 | 709 | 2025, 2 not ended | 1536, 2 not ended |

The costs agree where all end, but for IPOPT, whose first steps lead to other minima: lower in three cases, higher in
one. SciPy's trust-constr took 50 to 600 where this took 12 to 27. Through the valley of `path_length` over 21 functions
(329 here) the others lose their way. Thousands of functions are out of reach of SLSQP's dense matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.singular_values import svd
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.curvature import Curvature

Surface = Callable[[Array], tuple[Array, Array] | None]  # y ↦ (e, J), None where the path cannot be used
Cost = Callable[[Array], tuple[float, Array]]  # y ↦ (f, ∇f), f infinite where the path cannot be used

HALVINGS = 16  # of a step, before the model counts as wrong
REACH = 3.0  # times the last step that was taken
FIRST_REACH = 0.5  # times the size of y
BESIDE = 0.1  # of a step and of its predicted reduction: how far it may end beside the surface, and the cost of that
FAR = 1.0  # of e, dimensionless: where the model of the surface is no guide back to it
CORRECTIONS = 6  # steps of Newton's method back to the surface
NOTHING = 1e-14  # of the cost: a predicted reduction not worth a step
NOISE = 1e-13  # of the cost: what rounding may add to it
PATIENCE = 10  # steps in a row that reduce it by no more than that
SLIGHT, HELD = (
    1e-4,
    4,
)  # of the cost, and so many steps in a row that gain less and were cut short by unusable controls


@dataclass(frozen=True)
class NullSpaceResult:
    """Where the search ended: y, its cost, the projected gradient's size, and what it took."""

    y: Array
    cost: float
    stationarity: float  # |∇f + Jᵀμ| with the best μ
    infeasibility: float  # |e|
    converged: bool
    history: list[dict[str, Any]]
    hessian: Curvature = field(repr=False)  # of the Lagrangian, as far as the steps told


class NoSurfaceError(ValueError):
    """No usable control that reaches the goal near the one that the search was to begin with."""


def minimise(
    surface: Surface,
    cost: Cost,
    y: Array,
    *,
    curvature: float = 2.0,
    tolerance: float = 1e-8,
    goal: float = 1e-9,
    most: int = 400,
    budget: Budget | None = None,
) -> NullSpaceResult:
    r"""min f(y) subject to e(y) = 0 from a point near e = 0, along the surface e = 0.

    Each step minimises a BFGS model of the Lagrangian's Hessian in the null space of J, on top of Newton's step -J^# e
    back to the surface; further Newton steps follow only where it ends too far beside the surface for the reduction it
    predicts, and the cost must fall (Armijo), with e at the multipliers' price. A projected gradient that ends as SQP.
    [Nocedal, Wright, ch. 15 and 18]
    The model begins with ``curvature`` I: where y are coordinates in which the effort is |y|², 2 I is exact for it.
    ``tolerance`` is on the projected gradient relative to |∇f|, ``goal`` on |e|.
    Where the ``budget`` refuses ``surface`` another evaluation, the search ends with what it has.
    Errors: `NoSurfaceError`.
    """
    budget = budget or Budget()
    search = _Search(surface, cost, y, goal)
    point = search.best
    first = model = Curvature.first(curvature, len(y))
    history: list[dict[str, Any]] = []
    fresh, stationary, idle, held = True, False, 0, 0
    for k in range(most):
        history.append({"k": k, "cost": point.f, "optimality": float(norm(point.residual))})
        step = point.step(model)
        small = history[-1]["optimality"] < tolerance * max(1.0, float(norm(point.slope)))
        stationary = bool(small or step.predicted <= NOTHING * abs(point.f))
        if stationary:
            break
        there = search.along(point, step)
        back = None if there else search.back(point)
        if budget.refused:
            break
        if there is None:
            if back is None and fresh and not search.stranded(point):
                break
            if back is None:  # the model was at fault: begin again from its exact part
                back, model, fresh = search.best if fresh else point, first, True
            point = back
            continue
        change = there.lagrangian_slope(there.mu) - point.lagrangian_slope(there.mu)
        model, fresh = model.updated(there.y - point.y, change), False
        gain = search.reduction(point, there) / (abs(point.f) or 1.0)
        idle = idle + 1 if gain < NOISE else 0
        held = held + 1 if search.blocked and gain < SLIGHT else 0
        point = there
        if idle == PATIENCE or held == HELD:  # by the controls that may not be used
            break
    search.settle(point)
    converged = stationary and not budget.refused
    best = search.best
    sizes = float(norm(best.residual)), float(norm(best.e))
    return NullSpaceResult(best.y, best.f, *sizes, converged, history, model)


class _Step(NamedTuple):
    """A step of the model, and the reduction of the cost that it predicts."""

    normal: Array  # -J^# e
    along: Array  # in the null space of J
    predicted: float
    hessian: Curvature


@dataclass(frozen=True)
class _Point:
    """A point of the surface, with the multipliers that fit the gradient best."""

    y: Array
    e: Array
    J: Array
    f: float
    slope: Array  # ∇f

    @cached_property
    def mu(self) -> Array:
        return -np.linalg.lstsq(self.J.T, self.slope, rcond=None)[0]

    @cached_property
    def residual(self) -> Array:
        """∇f + Jᵀμ, the part of the gradient in the null space."""
        return self.lagrangian_slope(self.mu)

    def lagrangian_slope(self, mu: Array) -> Array:
        """∇f + Jᵀμ here, with the multipliers of any point."""
        return self.slope + self.J.T @ mu

    def step(self, model: Curvature) -> _Step:
        """To the minimiser of the model on the linearised surface."""
        model = model.over(self.J.T, self.slope)  # among these it lies
        seen, hessian = model.seen, model.inner
        left, values, right = svd(self.J @ seen)
        rank = int(np.sum(values > 1e-10 * values[0]))
        normal, null = -right[:rank].T @ ((left.T @ self.e)[:rank] / values[:rank]), right[rank:].T
        slope = null.T @ (seen.T @ self.slope + hessian @ normal)
        z = -np.linalg.solve(null.T @ hessian @ null, slope)
        return _Step(seen @ normal, seen @ (null @ z), -0.5 * float(slope @ z), model)


class _Search:
    """Evaluations on and near the surface e = 0."""

    def __init__(self, surface: Surface, cost: Cost, y: Array, goal: float) -> None:
        self.surface, self.cost, self.goal = surface, cost, goal
        self.reach: float | None = None  # the longest step that is tried, from what the last one told
        self.blocked = False  # whether the last step met a control that cannot be used
        self.beside = True  # whether steps may end beside the surface
        first = self.restored(y, far=np.inf)
        if first is None:
            raise NoSurfaceError("the search must start near a usable control that reaches the goal")
        self.best = first  # on the surface

    def settle(self, point: _Point) -> None:
        """Takes a point, brought all the way to the surface, for the best, unless that fails or it costs more."""
        settled = point if self.on_surface(point) else self.back(point)
        if settled and self.reduction(self.best, settled) >= -NOISE * abs(settled.f):
            self.best = settled

    def back(self, point: _Point) -> _Point | None:
        """A point beside the surface brought to it, from where steps that have become short may succeed; else None."""
        return None if self.on_surface(point) else self.restored(point.y, seen=point)

    def stranded(self, point: _Point) -> bool:
        """Whether no way leads back to the surface from a point; then no step after that may end beside it."""
        found = self.beside and not self.on_surface(point)
        if found:
            self.beside, self.reach = False, None
        return found

    def restored(
        self,
        y: Array,
        far: float = FAR,
        near: Callable[[Array], bool] | None = None,
        seen: _Point | None = None,
    ) -> _Point | None:
        """The point of the surface that Newton's method comes to from y; None if it is too far or does not come nearer.

        ``near``: whether Newton's next step is one that need not be taken. ``seen``: what is known of y.
        """
        last = np.inf
        for _ in range(CORRECTIONS):
            evaluated, seen = (seen.e, seen.J) if seen else self.surface(y), None
            if evaluated is None:
                self.blocked = True
                return None
            e, J = evaluated
            size, back = norm(e), np.linalg.lstsq(J, e, rcond=None)[0]
            if size < self.goal or (near and size < far and near(back)):
                point = _Point(y, e, J, *self.cost(y))
                self.blocked |= not np.isfinite(point.f)
                return point if np.isfinite(point.f) else None
            if size > min(0.5 * last, far):
                return None
            last = size
            y = y - back
        return None

    def along(self, point: _Point, step: _Step) -> _Point | None:
        """The first of 1, ½, ¼, … of a step that, brought back to the surface, lowers the cost enough.

        On a strongly curved surface the model predicts reductions that are none; no step is tried that is more than
        ``REACH`` times as long as the last that was taken.
        """
        size = norm(step.along)
        reach = self.reach or FIRST_REACH * (1.0 + norm(point.y))
        fraction = min(1.0, reach / size) if size > 0 else 1.0
        self.blocked = False
        for _ in range(HALVINGS):
            least = 1e-4 * fraction * step.predicted - NOISE * abs(point.f)
            y = point.y + step.normal + fraction * step.along
            near = partial(_near_enough, step, fraction) if self.beside else None
            there = self.restored(y, near=near)
            if there and self.reduction(point, there) < least and not self.on_surface(there):
                there = self.restored(there.y, seen=there)  # the price may have been wrong
            if there and self.reduction(point, there) >= least:
                self.reach = REACH * fraction * size
                if self.on_surface(there):
                    self.best = there
                return there
            fraction *= 0.5
        return None

    def reduction(self, point: _Point, there: _Point) -> float:
        """How much less there costs, with what is left of e at the multipliers' price."""
        return point.f - there.f + float(point.mu @ (point.e - there.e))

    def on_surface(self, point: _Point) -> bool:
        return bool(norm(point.e) < self.goal)


def _near_enough(step: _Step, fraction: float, back: Array) -> bool:
    """Whether a step may end beside the surface, Newton's way back left to the next one."""
    short = bool(norm(back) < BESIDE * fraction * norm(step.along))
    return short and 0.5 * float(back @ (step.hessian @ back)) < BESIDE * fraction * step.predicted
