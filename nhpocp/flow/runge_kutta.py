"""One sweep over the steps of an explicit Runge–Kutta scheme: the path, and its exact derivative, pulled back.

A step y ↦ y⁺ of ẏ = f(y, u) sees the control at a few of its times only (`Tableau`), so that no basis enters a step:
rows of the end's derivative are pulled back through the steps, and what they gather is summed against φ at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import accumulated, call, lent, side_by_side
from nhpocp.controls.samples import Samples
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.tableau import CLASSICAL, Tableau
from nhpocp.kept import kept

SLICE = 4096  # steps that CasADi evaluates at once: its memory for them grows with their number
APART = 1 / 64  # of a control and as much besides: between those that a kernel is tried on


@dataclass(frozen=True, eq=False)
class Grid:
    """The steps of a flow, and where they see its control. The arrays are contiguous."""

    h: Array  # step lengths (steps,)
    nodes: Array  # where what each step sees stands among the samples, (steps, seen)
    samples: Samples  # φ

    @cached_property
    def basis(self) -> Array:
        """φ where each step sees the control, (steps, seen, size)."""
        return self.samples.dense()[self.nodes]

    def first(self, steps: int) -> Grid:
        """The first steps alone."""
        return Grid(self.h[:steps], self.nodes[:steps], self.samples)

    def by_coefficients(self, gathered: Array) -> Array:
        """Derivatives by λ, (rows, m·size), from those by the controls at the samples, (samples, rows, m)."""
        count, rows, inputs = gathered.shape
        return self.samples.transposed(gathered.reshape(count, rows * inputs)).T.reshape(rows, -1)


class Sweep(NamedTuple):
    """What a sweep is asked for: the path, and at stops the derivatives of the wanted rows by λ."""

    start: Array  # y(0), (n,)
    grid: Grid
    coefficients: Array  # Λ, (m, size)
    stops: tuple[int, ...]  # numbers of steps

    @property
    def h(self) -> Array:
        return self.grid.h

    def controls(self) -> Array:
        """u where each step sees it, (steps, seen, m)."""
        return self.grid.samples.controls(self.coefficients)[self.grid.nodes]


class Swept(NamedTuple):
    """What a sweep gives."""

    path: Array  # y, (steps + 1, n)
    derivatives: Array  # of the observed rows at the stops, (stops, rows, m·size)
    watched: Array  # numbers at every point of the path, (steps + 1, k); none without stops, (0, k)


class Bundle(NamedTuple):
    """What is asked for of many paths at once: from one start, under many controls on one grid."""

    start: Array  # y(0), (n,)
    grid: Grid
    coefficients: Array  # Λ, (k, m, size)
    differentiated: bool  # whether the derivatives of the ends are wanted

    @property
    def stops(self) -> tuple[int, ...]:
        return (len(self.grid.h),) if self.differentiated else ()

    @classmethod
    def trial(cls, start: Array, grid: Grid, coefficients: Array, number: int) -> Bundle:
        """So many paths under controls near a given one, which may be nothing, and no two alike."""
        fractions = APART * (1.0 + np.arange(number)[:, None, None])
        return cls(start, grid, (1.0 + fractions) * coefficients + fractions, True)


class Ends(NamedTuple):
    """Where the paths of a bundle lead."""

    states: Array  # y(T), (k, n); finite where the whole path is
    derivatives: Array  # of the observed rows there, (k, rows, m·size), or (0, …)
    watched: Array  # along the paths, (k, steps + 1, …), or (0, …)


class Scheme:
    """CasADi functions of one step, for f: n numbers, m inputs. Matrices are passed by columns."""

    def __init__(self, dynamics: Dynamics, tableau: Tableau) -> None:
        self.functions, self.tableau = dynamics.functions, tableau
        self.rate = rate = dynamics.rate
        linearised, observed, watched = dynamics.linearised, dynamics.observed, dynamics.watched
        self.size, self.inputs = rate.size1_in(0), rate.size1_in(1)
        self._y, self._u = ca.SX.sym("y", self.size), ca.SX.sym("u", self.inputs)
        self._observed = ca.SX(ca.DM.eye(self.size) if observed is None else observed(self._y))
        self._watched = ca.SX(0, 1) if watched is None else watched(self._y)
        self.rows, self.watches = self._observed.size1(), self._watched.size1()
        self._slopes = _Packed(
            differentiated(rate, self._y, self._u)
            if linearised is None
            else ca.SX(linearised(self._y, self._u))
        )

    @cached_property
    def entries(self) -> int:
        """Numbers that `slopes` gives."""
        return int(self._slopes.numbers.numel())

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
        """(y, h, u where the step sees it, m × seen) ↦ (y⁺, points n × stages)."""
        y, h, u = self._y, ca.SX.sym("h"), ca.SX.sym("u", self.inputs, self.tableau.seen)
        following, points = self.tableau.step(lambda point, place: self.rate(point, u[:, place]), y, h)
        return ca.Function("step", [y, h, u], [ca.densify(following), ca.densify(ca.horzcat(*points))])

    @cached_property
    def slopes(self) -> ca.Function:
        """(y, u) ↦ the entries of [F, B]."""
        return ca.Function("slopes", [self._y, self._u], [self._slopes.numbers])

    @cached_property
    def pulled_row(self) -> ca.Function:
        """(one row c as a column, slopes, h) ↦ (c before the step, its derivatives by the controls, m × seen)."""
        row, h = ca.SX.sym("c", self.size), ca.SX.sym("h")
        tape, slopes = self._slopes.of(self.tableau.stages)
        before, gradients = self.tableau.pulled_back(row.T, slopes, h)
        outputs = [ca.densify(before.T), ca.densify(ca.horzcat(*(g.T for g in gradients)))]
        return ca.Function("pulled_row", [row, tape, h], ca.cse(outputs))

    @cached_property
    def blocks(self) -> ca.Function:
        """(slopes, h) ↦ a step's derivatives by its first state, n × n, and its controls, n × seen m; transposed."""
        h, (tape, slopes) = ca.SX.sym("h"), self._slopes.of(self.tableau.stages)
        by_state, by_controls = self.tableau.pulled_back(ca.SX.eye(self.size), slopes, h)
        outputs = [ca.densify(by_state.T), ca.densify(ca.horzcat(*by_controls).T)]
        return ca.Function("blocks", [tape, h], ca.cse(outputs))

    def bundled(self, bundle: Bundle) -> Ends:
        """By CasADi's own evaluation, one path after another."""
        start, grid, coefficients, _ = bundle
        return ends_of([self.swept(Sweep(start, grid, each, bundle.stops)) for each in coefficients])

    def linearised_along(self, sweep: Sweep) -> Linearised:
        """The path, and what every step makes of changes of its state and controls; by CasADi's own evaluation.

        Good until the thread asks again for as many steps.
        """
        h, controls = sweep.h, sweep.controls()
        if len(h) <= SLICE:
            return self._linearised(sweep.start, h, controls)
        start, parts = sweep.start, []
        for first in range(0, len(h), SLICE):
            steps = slice(first, first + SLICE)
            parts.append(self._linearised(start, h[steps], controls[steps]).copy())
            start = parts[-1].path[-1]
        path = np.concatenate([sweep.start[None], *(part.path[1:] for part in parts)])
        return Linearised(
            path,
            np.concatenate([part.by_state for part in parts]),
            np.concatenate([part.by_controls for part in parts]),
        )

    def _linearised(self, start: Array, h: Array, controls: Array) -> Linearised:
        """`linearised_along` for no more than `SLICE` steps after one another."""
        n = self.size
        reached, points = lent(accumulated(self.step, len(h)), start, h, controls)
        path = np.concatenate([start[None], reached])
        at_stages = controls.take(self.tableau.places, axis=1)
        (slopes,) = lent(side_by_side(self.slopes, len(points)), points, at_stages)
        by_state, by_controls = lent(side_by_side(self.blocks, len(h)), slopes, h)
        return Linearised(path, by_state.reshape(-1, n, n), by_controls.reshape(len(h), n, -1))

    def watched_along(self, path: Array) -> Array:
        """What is watched at every point of a path, (k, …)."""
        if not self.watches:
            return np.empty((len(path), 0))
        slices = (path[first : first + SLICE] for first in range(0, len(path), SLICE))
        return np.concatenate([call(side_by_side(self.watched, len(part)), part)[0] for part in slices])

    def swept(self, sweep: Sweep) -> Swept:
        """By CasADi's own evaluation."""
        derivatives = np.zeros((len(sweep.stops), self.rows, sweep.coefficients.size))
        if not len(sweep.stops):
            return Swept(walked(self.rate, self.tableau, sweep), derivatives, np.empty((0, self.watches)))
        steps = self.linearised_along(sweep)
        for derivative, stop in zip(derivatives, sweep.stops, strict=True):
            if stop:  # y(0) is given
                (matrix,) = call(self.observed, steps.path[stop])
                rows, grid = matrix.reshape(self.size, self.rows).T, sweep.grid
                gathered = steps.pulled_back(rows, grid.nodes[:stop], len(grid.samples))
                with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
                    derivative[:] = grid.by_coefficients(gathered)
        return Swept(steps.path, derivatives, self.watched_along(steps.path))


def ends_of(sweeps: Sequence[Swept]) -> Ends:
    """The ends of sweeps that all stop there, or nowhere."""
    path, derivatives, watched = (np.stack(parts) for parts in zip(*sweeps, strict=True))
    if derivatives.shape[1]:
        return Ends(path[:, -1], derivatives[:, -1], watched)
    return Ends(path[:, -1], np.empty((0, *derivatives.shape[2:])), np.empty((0, *watched.shape[1:])))


@dataclass(frozen=True)
class Linearised:
    """Every step linearised about a path: dy_{k+1} = Φ_k dy_k + Γ_k du_k, u_k the controls that it sees."""

    path: Array  # y, (steps + 1, n)
    by_state: Array  # Φ, (steps, n, n)
    by_controls: Array  # Γ, (steps, n, seen m)

    def copy(self) -> Linearised:
        """One that lasts."""
        return Linearised(self.path, self.by_state.copy(), self.by_controls.copy())

    def pulled_back(self, rows: Array, nodes: Array, samples: int) -> Array:
        """Rows (r, n) of dy after as many steps as ``nodes`` has, by the controls at the samples, (samples, r, m)."""
        steps = len(nodes)
        back = np.empty((steps + 1, *rows.shape))
        back[steps] = rows
        with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
            for k in reversed(range(steps)):
                back[k + 1].dot(self.by_state[k], back[k])
            by_controls = back[1:] @ self.by_controls[:steps]
            by_controls = by_controls.reshape(steps, len(rows), nodes.shape[1], -1)
            gathered = np.zeros((samples, len(rows), by_controls.shape[3]))
            # no two steps have a start in common, nor an end, nor what lies between
            for place, column in enumerate(nodes.T):
                gathered[column] += by_controls[:, :, place]
            return gathered

    def pushed_on(self, basis: Array) -> Array:
        """dy by λ at every point of the path, (steps + 1, n, m·size)."""
        steps, n = self.by_controls.shape[:2]
        by_controls = self.by_controls.reshape(steps, n, basis.shape[1], -1)
        along = np.zeros((steps + 1, n, by_controls.shape[3] * basis.shape[2]))
        with np.errstate(all="ignore"):
            driven = np.einsum("knjm,kjf->knmf", by_controls, basis).reshape(steps, n, -1)
            for k in range(steps):
                along[k + 1] = self.by_state[k] @ along[k] + driven[k]
        return along


@kept(most=64)
def runge_kutta_step(rate: ca.Function, tableau: Tableau = CLASSICAL) -> ca.Function:
    """(y, h, u where the step sees it, m × seen) ↦ y after the step."""
    y, h = ca.SX.sym("y", rate.size1_in(0)), ca.SX.sym("h")
    u = ca.SX.sym("u", rate.size1_in(1), tableau.seen)
    following, _ = tableau.step(lambda point, place: rate(point, u[:, place]), y, h)
    return ca.Function("step", [y, h, u], [ca.densify(following)], ["y", "h", "u"], ["next"])


def walked(rate: ca.Function, tableau: Tableau, sweep: Sweep) -> Array:
    """The path alone, (steps + 1, n), by CasADi's own evaluation."""
    h, controls, path = sweep.h, sweep.controls(), [sweep.start[None]]
    for first in range(0, len(h), SLICE):
        steps = slice(first, first + SLICE)
        step = accumulated(runge_kutta_step(rate, tableau), len(h[steps]))
        path += call(step, path[-1][-1], h[steps], controls[steps])
    return np.concatenate(path)


@kept(most=16)
def scheme(dynamics: Dynamics, tableau: Tableau) -> Scheme:
    """The `Scheme` of a right-hand side, made once."""
    return Scheme(dynamics, tableau)


def differentiated(rate: ca.Function, y: ca.SX, u: ca.SX) -> ca.SX:
    """[∂rate/∂y, ∂rate/∂u] by CasADi's AD."""
    return ca.densify(ca.jacobian(rate(y, u), ca.vertcat(y, u)))


class _Packed:
    """A sparse matrix as a column of numbers: without constants, and without what is there but for its sign."""

    def __init__(self, matrix: ca.SX) -> None:
        matrix = ca.cse(ca.sparsify(matrix))
        self._pattern = matrix.sparsity()
        self._constants = ca.DM.zeros(matrix.nnz())
        self._rows, self._places, self._signs = list[int](), list[int](), list[float]()  # of other entries
        seen: dict[int, tuple[int, Any]] = {}
        entry: Any
        for row, entry in enumerate(matrix.nonzeros()):
            if entry.is_constant():
                self._constants[row] = float(entry)
                continue
            negative = entry.is_op(ca.OP_NEG)
            entry = entry.dep(0) if negative else entry
            place, _ = seen.setdefault(entry.element_hash(), (len(seen), entry))
            self._rows.append(row)
            self._places.append(place)
            self._signs.append(-1.0 if negative else 1.0)
        self.numbers = ca.vertcat(ca.SX(0, 1), *[entry for _, entry in seen.values()])

    def of(self, stages: int) -> tuple[ca.SX, list[ca.SX]]:
        """Symbols for the numbers of a step's stages, a column each, and the matrix of each."""
        tape = ca.SX.sym("tape", self.numbers.numel(), stages)
        return tape, [self._unpacked(tape[:, stage]) for stage in range(stages)]

    def _unpacked(self, numbers: ca.SX) -> ca.SX:
        entries = ca.SX(self._constants)
        if self._rows:
            entries[self._rows] = ca.DM(self._signs) * numbers[self._places]
        return ca.SX(self._pattern, entries)
