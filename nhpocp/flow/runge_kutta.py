r"""The classical Runge–Kutta step and its exact derivative, transposed: what one sweep over the steps is made of.

A step y ↦ y⁺ of ẏ = f(y, u) sees the control at its start, middle and end. With F_i = ∂f/∂y and B_i = ∂f/∂u at the
points Y_i of its four stages, rows c of the end's derivative are pulled back through a step from the last stage on,
    κ_i = h w_i/6 c + h a_{i+1} κ_{i+1} F_{i+1},      c ↦ c + Σ κ_i F_i,      ∂/∂u_i = κ_i B_i,
which is the transpose of the scheme itself: exact to rounding, and of a cost that no basis of controls enters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import accumulated, call, mapped
from nhpocp.flow.dynamics import Dynamics

# a_i, which of the three controls, w_i
TABLEAU = ((0.0, 0, 1.0), (0.5, 1, 2.0), (0.5, 1, 2.0), (1.0, 2, 1.0))


@dataclass(frozen=True, eq=False)
class Grid:
    """The steps of a flow, and where they see its control. The arrays are contiguous."""

    h: Array  # step lengths (steps,)
    nodes: Array  # where φ at the start, middle and end of each step stands in the table, (steps, 3)
    table: Array  # (nodes, size)


class Sweep(NamedTuple):
    """What a sweep is asked for: the path, and at stops the derivatives of the wanted rows by λ."""

    start: Array  # y(0), (n,)
    grid: Grid
    coefficients: Array  # Λ, (m, size)
    stops: tuple[int, ...]  # numbers of steps

    @property
    def h(self) -> Array:
        return self.grid.h

    @property
    def nodes(self) -> Array:
        return self.grid.nodes

    @property
    def table(self) -> Array:
        return self.grid.table

    def first(self, steps: int) -> Sweep:
        """A shorter one, with one stop at its end."""
        grid = Grid(self.h[:steps], self.nodes[:steps], self.table)
        return self._replace(grid=grid, stops=(len(grid.h),))

    def controls(self) -> Array:
        """u at the start, middle and end of each step, (steps, 3, m)."""
        return (self.table @ self.coefficients.T)[self.nodes]


class Swept(NamedTuple):
    """What a sweep gives."""

    path: Array  # y, (steps + 1, n)
    derivatives: Array  # of the observed rows at the stops, (stops, rows, m·size)
    watched: Array  # numbers at every point of the path, (steps + 1, k)


class Scheme:
    """CasADi functions of one step, for f: n numbers, m inputs. Matrices are passed by columns."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.functions = dynamics.functions
        self.rate = rate = dynamics.rate
        linearised, observed, watched = dynamics.linearised, dynamics.observed, dynamics.watched
        self.size, self.inputs = rate.size1_in(0), rate.size1_in(1)
        self._y, self._u = ca.SX.sym("y", self.size), ca.SX.sym("u", self.inputs)
        whole = ca.DM.eye(self.size)
        self._observed = ca.sparsify(ca.SX(whole if observed is None else observed(self._y)))
        self._watched = ca.SX(0, 1) if watched is None else watched(self._y)
        self.rows, self.watches = self._observed.size1(), self._watched.size1()
        self._slopes = (
            [differentiated(rate, self._y, self._u)]
            if linearised is None
            else [ca.SX(part) for part in linearised(self._y, self._u)]
        )
        self._factors = _Packed(self._slopes)

    @cached_property
    def _product(self) -> _Packed:
        return _Packed([_multiplied(self._slopes)])

    @cached_property
    def entries(self) -> int:
        """Numbers that `slopes` gives."""
        return int(self._product.numbers.numel())

    @cached_property
    def observed(self) -> ca.Function:
        """y ↦ the matrix of the wanted rows, dense."""
        return ca.Function("observed", [self._y], [ca.densify(self._observed)])

    @cached_property
    def watched(self) -> ca.Function:
        """y ↦ the numbers that are wanted along the path."""
        return ca.Function("watched", [self._y], [self._watched])

    @cached_property
    def step(self) -> ca.Function:
        """(y, h, [u at start, middle, end]) ↦ (y⁺, points n × 4)."""
        y, h, u = self._step_symbols()
        following, points = _stages(self.rate, y, h, u)
        return ca.Function("step", [y, h, u], [ca.densify(following), ca.densify(ca.horzcat(*points))])

    @cached_property
    def slopes(self) -> ca.Function:
        """(y, u) ↦ the entries of [F, B], for many lanes at once."""
        return ca.Function("slopes", [self._y, self._u], [self._product.numbers])

    @cached_property
    def factors(self) -> ca.Function:
        """(y, u) ↦ what [F, B] is made of: fewer operations, where they are done one by one."""
        return ca.Function("factors", [self._y, self._u], [self._factors.numbers])

    @cached_property
    def taped(self) -> ca.Function:
        """(y, h, u) ↦ (y⁺, the `factors` at the four points, `watched` at y): what is common is worked out once."""
        y, h, u = self._step_symbols()
        following, points = _stages(self.rate, y, h, u)
        slopes = [self.factors(Y, u[:, place]) for Y, (_, place, _) in zip(points, TABLEAU, strict=True)]
        outputs = [ca.densify(following), ca.horzcat(*slopes), ca.densify(self.watched(y))]
        return ca.Function("taped", [y, h, u], ca.cse(outputs))

    @cached_property
    def pulled_row(self) -> ca.Function:
        """(one row c as a column, slopes, h) ↦ (c before the step, its derivatives by the three controls, m × 3)."""
        row, h = ca.SX.sym("c", self.size), ca.SX.sym("h")
        tape, stages = self._product.stages()
        before, gradients = _pulled(row.T, stages, h)
        outputs = [ca.densify(before.T), ca.densify(ca.horzcat(*(g.T for g in gradients)))]
        return ca.Function("pulled_row", [row, tape, h], ca.cse(outputs))

    @cached_property
    def costates(self) -> ca.Sparsity:
        """Where the wanted rows, pulled back through any number of steps, can have entries."""
        h, (_, stages) = ca.SX.sym("h"), self._factors.stages()
        pattern = self._observed.sparsity()
        while True:
            before, _ = _pulled(ca.SX.sym("c", pattern), stages, h)
            wider = pattern + before.sparsity()
            if wider == pattern:
                return pattern
            pattern = wider

    @cached_property
    def pulled(self) -> ca.Function:
        """(entries of `costates`, factors, h) ↦ (the same before the step, derivatives by the controls, 3 m × rows)."""
        h, (tape, stages) = ca.SX.sym("h"), self._factors.stages()
        entries = ca.SX.sym("c", self.costates.nnz())
        before, gradients = _pulled(ca.SX(self.costates, entries), stages, h)
        outputs = [_entries(before, self.costates), ca.densify(ca.horzcat(*gradients).T)]
        return ca.Function("pulled", [entries, tape, h], ca.cse(outputs))

    @cached_property
    def blocks(self) -> ca.Function:
        """(factors, h) ↦ the derivatives of a step by its first state, n × n, and its controls, n × 3 m; transposed."""
        h, (tape, stages) = ca.SX.sym("h"), self._factors.stages()
        by_state, by_controls = _pulled(ca.SX.eye(self.size), stages, h)
        outputs = [ca.densify(by_state.T), ca.densify(ca.horzcat(*by_controls).T)]
        return ca.Function("blocks", [tape, h], ca.cse(outputs))

    def taped_path(self, sweep: Sweep) -> tuple[Array, Array, Array]:
        """The path (steps + 1, n), the factors at all stages (4 steps, …), and what is watched (steps + 1, …)."""
        steps = accumulated(self.taped, len(sweep.h))
        found, tape, watched = call(steps, sweep.start, sweep.h, sweep.controls())
        return np.vstack([sweep.start, found]), tape, np.vstack([watched, self.watched_along(found[-1:])])

    def watched_along(self, path: Array) -> Array:
        """What is watched at every point of a path, (k, …)."""
        return call(mapped(self.watched, len(path)), path)[0] if self.watches else np.empty((len(path), 0))

    def swept(self, sweep: Sweep) -> Swept:
        """By CasADi's own evaluation."""
        if not len(sweep.stops):
            path = walked(self.rate, sweep)
            derivatives = np.empty((0, self.rows, sweep.coefficients.size))
            return Swept(path, derivatives, self.watched_along(path))
        path, tape, watched = self.taped_path(sweep)
        tape = tape.reshape(len(sweep.h), 4, -1)
        gradients = np.zeros((len(sweep.stops), self.rows, self.inputs, len(sweep.table)))
        places = self.costates.get_triplet()
        for found, stop in zip(gradients, sweep.stops, strict=True):
            if not stop:
                continue  # y(0) is given
            (matrix,) = call(self.observed, path[stop])
            rows = matrix.reshape(self.size, self.rows).T[tuple(places)]
            back = accumulated(self.pulled, stop)
            _, by_controls = call(back, rows, tape[:stop][::-1], sweep.h[:stop][::-1])
            by_controls = by_controls.reshape(stop, self.rows, 3, self.inputs)[::-1].transpose(2, 1, 3, 0)
            with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
                for column, values in zip(sweep.nodes[:stop].T, by_controls, strict=True):
                    found[:, :, column] += values
        with np.errstate(all="ignore"):
            derivatives = gradients.reshape(-1, len(sweep.table)) @ sweep.table
        derivatives = derivatives.reshape(len(sweep.stops), self.rows, -1)
        return Swept(path, derivatives, watched)

    def _step_symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return self._y, ca.SX.sym("h"), ca.SX.sym("u", self.inputs, 3)


@lru_cache(maxsize=64)
def runge_kutta_step(rate: ca.Function) -> ca.Function:
    """(y, h, [u(t), u(t + h/2), u(t + h)]) ↦ y(t + h), the last argument m × 3."""
    y, h = ca.SX.sym("y", rate.size1_in(0)), ca.SX.sym("h")
    u = ca.SX.sym("u", rate.size1_in(1), 3)
    following, _ = _stages(rate, y, h, u)
    return ca.Function("step", [y, h, u], [ca.densify(following)], ["y", "h", "u"], ["next"])


def walked(rate: ca.Function, sweep: Sweep) -> Array:
    """The path alone, (steps + 1, n), by CasADi's own evaluation."""
    step = accumulated(runge_kutta_step(rate), len(sweep.h))
    return np.vstack([sweep.start, *call(step, sweep.start, sweep.h, sweep.controls())])


@lru_cache(maxsize=64)
def scheme(dynamics: Dynamics) -> Scheme:
    """The `Scheme` of a right-hand side, made once."""
    return Scheme(dynamics)


def differentiated(rate: ca.Function, y: ca.SX, u: ca.SX) -> ca.SX:
    """[∂rate/∂y, ∂rate/∂u] by CasADi's AD."""
    return ca.densify(ca.jacobian(rate(y, u), ca.vertcat(y, u)))


def _stages(rate: ca.Function, y: ca.SX, h: ca.SX, u: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """y⁺ and the points Y_i."""
    points, total, slope = [], ca.SX.zeros(y.size1()), ca.SX.zeros(y.size1())
    for offset, place, weight in TABLEAU:
        points.append(y + offset * h * slope if offset else y)
        slope = rate(points[-1], u[:, place])
        total += weight * slope
    return y + h / 6 * total, points


def _pulled(c: ca.SX, slopes: Sequence[Sequence[ca.SX]], h: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """The rows c before the step, and their derivatives by the controls at start, middle and end."""
    n, before, gradients, later = c.size2(), c, [ca.SX(0)] * 3, None
    for stage, (offset, place, weight) in reversed(list(zip(slopes, TABLEAU, strict=True))):
        share = (weight / 6 * h) * c
        kappa = share if later is None else share + later
        through = through_slopes(kappa, stage)
        gradients[place] = gradients[place] + through[:, n:]
        before = before + through[:, :n]
        later = (offset * h) * through[:, :n]
    return before, gradients


def through_slopes(rows: ca.SX, slopes: Sequence[ca.SX]) -> ca.SX:
    """rows @ [F, B], which is given whole, or as D, A, C with [F, B] = D + A C."""
    if len(slopes) == 1:
        return rows @ slopes[0]
    D, A, C = slopes
    return rows @ D + (rows @ A) @ C


def _multiplied(slopes: Sequence[ca.SX]) -> ca.SX:
    """[F, B] as one matrix."""
    return through_slopes(ca.SX.eye(slopes[0].size1()), slopes)


class _Packed:
    """Sparse matrices as one column of numbers: without constants, and without what is there but for its sign."""

    def __init__(self, matrices: Sequence[ca.SX]) -> None:
        matrices = ca.cse([ca.sparsify(matrix) for matrix in matrices])
        self._patterns = [matrix.sparsity() for matrix in matrices]
        self._entries: list[tuple[int | None, float]] = []  # place and sign, or no place and the constant
        found: dict[int, tuple[int, Any]] = {}
        entry: Any
        for entry in (entry for matrix in matrices for entry in matrix.nonzeros()):
            if entry.is_constant():
                self._entries.append((None, float(entry)))
                continue
            negative = entry.is_op(ca.OP_NEG)
            entry = entry.dep(0) if negative else entry
            place, _ = found.setdefault(entry.element_hash(), (len(found), entry))
            self._entries.append((place, -1.0 if negative else 1.0))
        self.numbers = ca.vertcat(ca.SX(0, 1), *[entry for _, entry in found.values()])

    def stages(self) -> tuple[ca.SX, list[list[ca.SX]]]:
        """Symbols for the numbers of a step's four stages, a column each, and the matrices of each."""
        tape = ca.SX.sym("tape", self.numbers.numel(), len(TABLEAU))
        return tape, [self.unpacked(tape[:, stage]) for stage in range(len(TABLEAU))]

    def unpacked(self, numbers: ca.SX) -> list[ca.SX]:
        """The matrices of a column."""
        every = iter(self._entries)
        return [
            ca.SX(
                pattern,
                ca.vertcat(ca.SX(0, 1), *[self._entry(numbers, *next(every)) for _ in range(pattern.nnz())]),
            )
            for pattern in self._patterns
        ]

    def _entry(self, numbers: ca.SX, place: int | None, factor: float) -> ca.SX:
        return ca.SX(factor) if place is None else factor * numbers[place]


def _entries(matrix: ca.SX, pattern: ca.Sparsity) -> ca.SX:
    """The entries of a matrix at the places of a pattern, a column."""
    rows, columns = pattern.get_triplet()
    return ca.vertcat(*[matrix[i, j] for i, j in zip(rows, columns, strict=True)])
