"""Least cost on the surface e = 0 within inequalities g ≥ 0 along a path, by SciPy's SLSQP [Kraft 1988].

min f(y) + W s subject to e(y) = 0, g(y) + s ≥ 0, s ≥ 0: an exact penalty, which keeps the linearised rows compatible
and ends near the least violation where no y has none. [Nocedal, Wright, ch. 17.2 and 18.5] Divelbiss and Wen (1997)
have an exterior one in the null space of J, which stops outside of the bounds.
SLSQP begins with I for the Hessian of the Lagrangian; y = y₀ + A z with A Aᵀ = H⁻¹ makes that I in z a model H in y,
the one that the search without bounds has learnt, and it takes a few steps instead of tens.
Rows stand at samples: by what the path is lower between them, the next round asks for more.

End-point evaluations, those of the search without bounds included, November 2026; all keep every bound, but for one:

| cases | this | method of multipliers | plain SLSQP | IPOPT, L-BFGS |
|---|---|---|---|---|
| 7 kinds of bounds, 2 presets, effort or none: 28 | 1025 | 1120 | | |
| 13 of them | 511 | 473 | 550, 1 not ended | 564 |
| 3 kinds, 3 presets, leg effort or path length: 13 | 812 | 671 | | |
| jumps, form (6), a way round det W = 0, lo = hi, 21 functions: 5 | 249 | 351 | 312 | 787 |

The one: bounds that hold nowhere near, missed by 2.6 % here and by 5.7 % with multipliers. Costs differ by 2e-4;
where none is asked for, the control is up to 9 % nearer. Without s the linearised rows may exclude each other at the
first step (1500 evaluations, no end). An accuracy of 1e-8 takes 861 instead of 1025, and ends 3e-5 apart
in other units; at 1e-12 SLSQP no longer ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.null_space import NoSurfaceError

ROUNDS = 8
STEPS = 100  # at most, of SLSQP in one round
ACCURACY = 1e-10  # of the cost in units of the first one, of e and of g
FIRST_WEIGHT, MOST_WEIGHT = 10.0, 1e4  # of the violation, times the first cost
UNUSABLE = 1e6  # times the first cost: what a path that cannot be used counts as
ROOM = 1e-6  # of a limit: what a row that presses may leave
# of a violation: the least that ten times the weight takes off where it goes on to fall; from 10 to 100 it is 0.9 % for
# a quadratic cost that the greatest weight outweighs
STALLED = 0.005


@dataclass(frozen=True)
class Point:
    """What one y leads to."""

    error: Array  # e
    jacobian: Array  # ∂e/∂y
    cost: float  # f
    gradient: Array  # ∇f
    rows: Array  # g at the samples


@dataclass(frozen=True)
class BoundedProblem:
    """f, e and g as functions of y."""

    evaluate: Callable[[Array], Point | None]  # None where the path cannot be used
    row_slopes: Callable[[Array], Array]  # ∂g/∂y
    between: Callable[[Array], Array]  # the least g in the neighbourhood of every sample: what has to be ≥ 0


@dataclass(frozen=True)
class Round:
    """Where one run of SLSQP ended."""

    y: Array
    cost: float
    least: float  # g between the samples too; negative: the violation
    stationarity: float  # |∇f + Jᵀμ - ∂gᵀκ| with the best μ, and κ ≥ 0 of the rows that press
    infeasibility: float  # |e|
    weight: float
    steps: int
    converged: bool
    stalled: bool  # the violation is the least near here: ten times the weight did not lessen it


def rounds(
    problem: BoundedProblem, y: Array, hessian: Array, *, slack: float, budget: Budget
) -> Iterator[Round]:
    """One control after another, each nearer to the least cost with every g ≥ -slack; ends when that is reached.

    ``hessian``: of the Lagrangian about y, positive definite. ``budget``: that of ``evaluate``.
    Errors: `NoSurfaceError`.
    """
    programme = _Programme(problem, y, hessian, budget)
    z, more, last = np.zeros(len(y)), np.zeros(len(programme.shift)), np.inf
    for _ in range(ROUNDS):
        try:
            z, violation, steps, converged = programme.solve(z)
        except _BudgetSpentError:
            return
        here, y = programme.at(z), programme.y(z)
        if here is None:
            return
        between = problem.between(y)
        least = float(np.min(between)) if np.isfinite(between).all() else -np.inf
        sizes = programme.stationarity(z), float(norm(here.error))
        rests = converged or steps < STEPS  # no step, however short, that the penalty would be less after
        stalled = rests and violation > max(slack, (1.0 - STALLED) * last)
        yield Round(
            y, here.cost, least, *sizes, programme.weight * programme.scale, steps, converged, stalled
        )
        if least >= -slack or not np.isfinite(least) or stalled:
            return
        last = violation if rests and violation > slack else np.inf
        if violation <= slack:
            if programme.shift.any():  # and rows that it did not lift enough by what they still lack
                more = more + np.where(between < -slack, -between, 0.0)
            programme.shift = here.rows - between + more
        elif not converged or programme.weight == MOST_WEIGHT:
            return
        if violation > ROOM:
            programme.weight = min(10.0 * programme.weight, MOST_WEIGHT)


class _BudgetSpentError(Exception):
    """The way out of SciPy's loop."""


class _Programme:
    """What SLSQP asks for function by function, of one evaluation at each z."""

    def __init__(self, problem: BoundedProblem, origin: Array, hessian: Array, budget: Budget) -> None:
        first = problem.evaluate(origin)
        if first is None:
            raise NoSurfaceError("the search must start with a usable control")
        self.problem, self.origin, self.first, self.budget = problem, origin, first, budget
        self.scale = abs(first.cost) or float(origin @ origin) or 1.0
        self.unit = np.linalg.inv(np.linalg.cholesky(hessian / self.scale)).T
        self.shift: Array = np.zeros(len(first.rows))
        self.weight = FIRST_WEIGHT
        self._z: Array = np.zeros(len(origin))
        self._here: Point | None = first
        self._slopes: Array | None = None  # ∂g/∂z there

    def y(self, z: Array) -> Array:
        return np.asarray(self.origin + self.unit @ z)

    def at(self, z: Array) -> Point | None:
        if not np.array_equal(z, self._z):
            self._here, self._slopes = self.problem.evaluate(self.y(z)), None
            self._z = np.array(z)
            if self.budget.refused:
                raise _BudgetSpentError
        return self._here

    def usable(self, z: Array) -> Point:
        """At z; where that cannot be used, what is known of the origin: the cost alone leads away from it."""
        return self.at(z) or self.first

    def row_slopes(self, z: Array) -> Array:
        if self.at(z) is None:
            return np.zeros((len(self.shift), len(z)))
        if self._slopes is None:
            self._slopes = self.problem.row_slopes(self.y(z)) @ self.unit
        return self._slopes

    def solve(self, z: Array) -> tuple[Array, float, int, bool]:
        """Where SLSQP ends from z, with what violation s, after how many steps, and whether at a minimum."""
        from scipy.optimize import minimize  # a third of a second, which most solves can do without

        n, weight = len(z), self.weight

        def cost(x: Array) -> float:
            here = self.at(x[:n])
            return (here.cost / self.scale if here else UNUSABLE) + weight * float(x[n])

        def gradient(x: Array) -> Array:
            return np.append(self.usable(x[:n]).gradient @ self.unit / self.scale, weight)

        def jacobian(x: Array) -> Array:
            return np.pad(self.usable(x[:n]).jacobian @ self.unit, [(0, 0), (0, 1)])

        def rows(x: Array) -> Array:
            return np.append(self.usable(x[:n]).rows - self.shift + x[n], x[n])

        def row_slopes(x: Array) -> Array:
            slopes = np.pad(self.row_slopes(x[:n]), [(0, 1), (0, 1)])
            slopes[:, n] = 1.0
            return slopes

        result = minimize(
            cost,
            np.append(z, max(0.0, float(np.max(self.shift - self.usable(z).rows)))),
            jac=gradient,
            constraints=[
                {"type": "eq", "fun": lambda x: self.usable(x[:n]).error, "jac": jacobian},
                {"type": "ineq", "fun": rows, "jac": row_slopes},
            ],
            method="SLSQP",
            options={"ftol": ACCURACY, "maxiter": STEPS},
        )
        return result.x[:n], float(result.x[n]), int(result.nit), bool(result.success)

    def stationarity(self, z: Array) -> float:
        from scipy.optimize import nnls

        here, y = self.usable(z), self.y(z)
        slopes = self.problem.row_slopes(y)[here.rows - self.shift < ROOM]
        along = np.linalg.pinv(here.jacobian) @ here.jacobian  # what is left is in the null space of J
        gradient, slopes = here.gradient - along @ here.gradient, slopes - slopes @ along
        return float(nnls(slopes.T, gradient)[1]) if len(slopes) else float(norm(gradient))
