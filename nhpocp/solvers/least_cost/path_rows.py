"""The bounds of a problem along one path as rows g ≥ 0: values, derivatives, and how they fare between samples.

A row is one side of one component of a bounded quantity at one sample, in units of its size, so that -g is what
verification calls the relative excess, but for the fraction `INSIDE` by which a path is asked to stay within.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped, side_by_side
from nhpocp.constraints.bound import Bound, BoundReport, check_bounds, in_shape
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4, uniform_grid
from nhpocp.flow.step_error import FINER
from nhpocp.kept import kept
from nhpocp.objectives.quantity import quantity
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.solvers.least_cost.between_samples import SLIGHT, around, dips_of, lowest_between
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

INSIDE = 1e-5  # of a limit: how far inside it a path is asked to stay
FORGIVEN = 5e-4  # of a limit, half of what verification forgives: the play of a box with lo = hi
# at least, and `FINER` times the solver's own, of the simulation that looks between the samples
FINE_STEPS = 2000


class PathRows:
    """Rows g (samples × columns) of every bound along the path on one grid of times.

    Samples are the grid's times, a breakpoint of the control twice, with the control's limit from either side; a column
    is one side of one component of a quantity.
    """

    def __init__(self, problem: PlanningProblem, basis: ControlBasis, horizon: float, times: Array) -> None:
        numeric = numeric_system(problem.system)
        self.problem, self.basis, self.horizon, self.numeric = problem, basis, horizon, numeric
        # whatever integrates the paths: these derivatives only steer
        whole = Dynamics(numeric.rate_function, numeric.linearised_function)
        self._flow = RungeKutta4().flow(whole, basis, horizon, times)
        self._samples = _Samples(times, basis, horizon)
        self._families: list[_Family] = [_family(bound, problem) for bound in problem.bounds]
        steps = max(FINE_STEPS, FINER * (len(times) - 1))
        fine = uniform_grid(steps, basis.breakpoints(horizon), horizon)
        self._fine_flow = RungeKutta4().flow(Dynamics(numeric.rate_function), basis, horizon, fine)
        self._fine = _Samples(fine, basis, horizon)
        self._nearest = self._samples.nearest(self._fine)

    def values(self, path: Array, coefficients: Array) -> Array:
        """g along a path (len(times), n) under its control; NaN where a quantity is none."""
        return self._values(self._samples, path, coefficients)

    def _values(self, samples: _Samples, path: Array, coefficients: Array) -> Array:
        states, controls = path[samples.places], self._driven(samples, coefficients)
        return np.hstack([family.values(states, controls) for family in self._families])

    def _driven(self, samples: _Samples, coefficients: Array) -> Array:
        """What drives the quantities at samples: u, then du/dt where one of them takes it, side by side."""
        return np.hstack([table @ coefficients.T for table in self._tables(samples)])

    def _tables(self, samples: _Samples) -> list[Array]:
        """φ, then its derivative."""
        return [samples.table, samples.slopes] if self.problem.system.accelerated else [samples.table]

    def derivatives(self, coefficients: Array) -> Array:
        """∂g/∂λ, samples × columns × (inputs · size)."""
        path, sensitivities, _ = self._flow.sensitivity(
            self.problem.start_point, coefficients, range(len(self._flow.times))
        )
        samples = self._samples
        states, controls = path[samples.places], self._driven(samples, coefficients)
        pairs = [family.slopes(states, controls) for family in self._families]
        by_state, by_control = (np.concatenate(parts, axis=1) for parts in zip(*pairs, strict=True))
        through_state = by_state @ sensitivities[samples.places]
        tables = self._tables(samples)
        parts = np.split(by_control, len(tables), axis=2)
        direct = sum(
            part[..., None] * table[:, None, None, :] for part, table in zip(parts, tables, strict=True)
        )
        return through_state + np.reshape(direct, through_state.shape)

    def between(self, coefficients: Array) -> Array:
        """The least g (samples × columns) of the finely simulated motion in the neighbourhood of every sample."""
        path = self._fine_flow.states(self.problem.start_point, coefficients)
        if not np.isfinite(path).all():
            return np.full((len(self._samples.places), 1), np.nan)
        values = self._values(self._fine, path, coefficients)
        least = np.full((len(self._samples.places), values.shape[1]), np.inf)
        np.minimum.at(least, self._nearest, lowest_between(self._fine.times, values))
        dips = dips_of(self._fine.times, values)
        if len(dips):
            times, states = around(dips, self._fine.times, path[self._fine.places])
            tables = [self.basis.table(times, self.horizon)]
            if self.problem.system.accelerated:
                tables.append(self.basis.derivative_table(times, self.horizon, "right"))
            driven = np.hstack([table @ coefficients.T for table in tables])
            closer = np.hstack([family.values(states, driven) for family in self._families])
            lowest = closer.reshape(len(dips), -1, closer.shape[1]).min(axis=1)
            told = np.where(lowest < values[dips] - SLIGHT, lowest, np.inf)
            np.minimum.at(least, self._nearest[dips], told)
        return least

    def worst_words(self, rows: Array) -> str:
        """The bound that rows g (samples × columns) break most, and by what part of its limit; else that all hold."""
        least = rows.min(axis=0)
        place = int(np.argmin(least))
        if not least[place] < -INSIDE:
            return "kept" if np.isfinite(least).all() else "no number"
        widths = np.cumsum([family.width for family in self._families])
        bound = self.problem.bounds[int(np.searchsorted(widths, place, "right"))]
        return f"{bound.label} by {-least[place]:.2g} of its limit"

    def reports(self, control: Control) -> list[BoundReport]:
        """Every bound's worst place on the finely simulated motion."""
        path = self._fine_flow.states(self.problem.start_point, control.coefficients)
        states, driven = path[self._fine.places], self._driven(self._fine, control.coefficients)
        controls, rates = driven[:, : len(control.coefficients)], driven[:, len(control.coefficients) :]
        with np.errstate(all="ignore"):  # a path that runs away is reported, not warned of
            trajectory = self.numeric.trajectory(
                states, controls, self.problem.scale, rates if rates.size else None
            )
        return check_bounds(self.problem.bounds, self._fine.times, trajectory)


class _Samples:
    """Where rows stand: times, their places in a grid of times, and φ there, one-sided at breakpoints."""

    def __init__(self, grid: Array, basis: ControlBasis, horizon: float) -> None:
        breaks = basis.breakpoints(horizon)
        broken = [k for k in range(1, len(grid) - 1) if _close(grid[k], breaks, horizon)]
        left = np.array([*broken, len(grid) - 1])
        right = np.arange(len(grid) - 1)
        order = np.argsort(np.concatenate([left, right]), kind="stable")  # the limit from the left first
        self.places = np.concatenate([left, right])[order]
        self.times = grid[self.places]
        self.from_left = np.concatenate([np.ones(len(left), bool), np.zeros(len(right), bool)])[order]
        self._ends, self._order, self._basis, self._horizon = (grid[left], grid[right]), order, basis, horizon
        self.table = self._both_sides(basis.table)

    @cached_property
    def slopes(self) -> Array:
        """dφ/dt there."""
        return self._both_sides(self._basis.derivative_table)

    def _both_sides(self, table: Callable[..., Array]) -> Array:
        left, right = self._ends
        sides = table(left, self._horizon, "left"), table(right, self._horizon, "right")
        return np.concatenate(sides)[self._order]

    def nearest(self, fine: _Samples) -> Array:
        """For every sample of a finer grid the nearest of these on its own side of every breakpoint."""
        middles = 0.5 * (self.times[:-1] + self.times[1:])
        sides = [np.searchsorted(middles, fine.times, side) for side in ("left", "right")]
        return np.where(fine.from_left, *sides)


def _close(time: float, others: Array, horizon: float) -> bool:
    return bool(np.any(np.abs(others - time) < 1e-9 * horizon))


class _Family(ABC):
    """The columns of one bound."""

    _sides: _Sides

    @property
    def width(self) -> int:
        """How many they are."""
        return len(self._sides.places)

    @abstractmethod
    def values(self, states: Array, controls: Array) -> Array:
        """g at samples (k, n), (k, m), or (k, 2 m) with du/dt beside u → (k, columns)."""

    @abstractmethod
    def slopes(self, states: Array, controls: Array) -> tuple[Array, Array]:
        """∂g/∂x (k, columns, n) and ∂g/∂u (k, columns, m), by du/dt too where controls (k, 2 m) hold it."""


@dataclass(frozen=True)
class _Sides:
    """Finite sides of a bound on numbered components: g = sign (value - limit)/size."""

    places: Array  # component of every column
    signs: Array  # +1 for a lower limit, -1 for an upper one
    limits: Array
    sizes: Array

    def rows(self, values: Array) -> Array:
        """(k, components) → (k, columns)."""
        return self.signs * (values[:, self.places] - self.limits) / self.sizes

    def scaled(self, slopes: Array) -> Array:
        """∂value (k, components, n) → ∂g (k, columns, n)."""
        return (self.signs / self.sizes)[:, None] * slopes[:, self.places]


def _sides(bound: Bound, shape: tuple[int, ...]) -> _Sides:
    """The limits of a quantity of this shape moved inwards by `INSIDE`, those of an equation outwards by `FORGIVEN`."""
    columns, sides = [], (bound.lower, bound.upper, *bound.sizes)
    lower, upper, below, above = (in_shape(side, shape).ravel() for side in sides)
    for sign, limits, others, sizes in ((1.0, lower, upper, below), (-1.0, upper, lower, above)):
        for place in np.flatnonzero(np.isfinite(limits)):
            limit, width, size = limits[place], abs(others[place] - limits[place]), sizes[place]
            inwards = min(INSIDE * size, 0.25 * width) if width > 0 else -FORGIVEN * size
            columns.append((place, sign, limit + sign * inwards, size))
    places, signs, limits, sizes = np.array(columns).reshape(-1, 4).T
    return _Sides(places.astype(int), signs, limits, sizes)


def _family(bound: Bound, problem: PlanningProblem) -> _Family:
    if bound.margin:
        return _Clearance(bound, bound.margin.matrix, problem)
    return _Boxed(bound, problem.system)


class _Boxed(_Family):
    """Limits on the components of a state block, an input or an output."""

    def __init__(self, bound: Bound, system: System) -> None:
        self._value, self._slope, shape = _quantity_functions(system, bound.quantity)
        self._sides = _sides(bound, shape)

    def values(self, states: Array, controls: Array) -> Array:
        (values,) = call(side_by_side(self._value, len(states)), states, controls)
        return self._sides.rows(values.reshape(len(states), -1))

    def slopes(self, states: Array, controls: Array) -> tuple[Array, Array]:
        (slopes,) = call(side_by_side(self._slope, len(states)), states, controls)
        size, inputs = states.shape[1], controls.shape[1]
        scaled = self._sides.scaled(slopes.reshape(len(states), size + inputs, -1).swapaxes(1, 2))
        return scaled[:, :, :size], scaled[:, :, size:]


@kept(most=128)
def _quantity_functions(system: System, name: str) -> tuple[ca.Function, ca.Function, tuple[int, ...]]:
    """(x, u) ↦ a quantity's components row by row, (x, u) ↦ their derivative by (x, u), and the quantity's shape.

    Beside u stands du/dt where a quantity of the system takes it.
    """
    inputs = system.input_space.size
    x, u = ca.SX.sym("x", system.state_space.size), ca.SX.sym("u", (1 + system.accelerated) * inputs)
    value = ca.densify(ca.SX(quantity(system, name, x, u[:inputs], u[inputs:])))
    flat = ca.cse(ca.reshape(value.T, -1, 1))
    # rows of distances have little in common: one sweep backwards for each, not one through all of them for each state
    slope = ca.densify(ca.jacobian(flat, ca.vertcat(x, u), {"allow_forward": False}))
    shape = tuple(size for size in value.shape if size != 1)
    return ca.Function("quantity", [x, u], [flat]), ca.Function("slope", [x, u], [slope]), shape


class _Clearance(_Family):
    """Limits on the least singular value σ of a regularity matrix M, its rotation columns divided by a length.

    The least σ carries the sign that det M has relative to the start, which makes it smooth through det M = 0, with
    the start's side uphill; dσ = aᵀ dM b with the singular vectors a, b. The next larger σ has a row of its
    own: where the two meet, the least alone has a kink.
    """

    def __init__(self, bound: Bound, matrix: str, problem: PlanningProblem) -> None:
        self._name, self._numeric = matrix, numeric_system(problem.system)
        self._columns = np.asarray(problem.system.column_scales(self._name, problem.scale))
        self._orientation = np.sign(self._numeric.determinants(problem.start_point[None])[self._name][0])
        lower, upper = (float(np.asarray(side).ravel()[0]) for side in (bound.lower, bound.upper))
        pair = replace(bound, lower=np.array([lower, lower]), upper=np.array([upper, np.inf]))
        self._sides = _sides(pair, (2,))

    def _decomposed(self, states: Array) -> tuple[Array, Array, Array, Array]:
        """a (k, 2, rows), σ (k, 2), b (k, 2, columns) of the two least singular values, and the least one's sign."""
        matrices = self._numeric.regularity(states)[self._name] / self._columns
        left, values, right = svd(matrices)
        signs = np.ones((len(states), 2))
        signs[:, 0] = np.where(np.linalg.det(matrices) * self._orientation < 0, -1.0, 1.0)
        return left[:, :, :-3:-1].swapaxes(1, 2), values[:, :-3:-1], right[:, :-3:-1], signs

    def values(self, states: Array, controls: Array) -> Array:
        try:
            _, values, _, signs = self._decomposed(states)
        except np.linalg.LinAlgError:  # a matrix that is not finite
            return np.full((len(states), len(self._sides.places)), np.nan)
        return self._sides.rows(signs * values)

    def slopes(self, states: Array, controls: Array) -> tuple[Array, Array]:
        left, _, right, signs = self._decomposed(states)
        weights = signs[:, :, None, None] * left[..., :, None] * right[..., None, :] / self._columns
        turned = mapped(_weighted_matrix_slope(self._numeric.system, self._name), len(states))
        columns = [call(turned, states, weights[:, j].swapaxes(1, 2))[0] for j in range(2)]
        scaled = self._sides.scaled(np.stack(columns, axis=1))
        return scaled, np.zeros((*scaled.shape[:2], controls.shape[1]))


@kept(most=64)
def _weighted_matrix_slope(system: System, name: str) -> ca.Function:
    """(x, A) ↦ d/dx Σ A_ij M_ij(x) for a regularity matrix M."""
    x = ca.SX.sym("x", system.state_space.size)
    matrix = numeric_system(system).matrices(x)[name]
    weights = ca.SX.sym("A", *matrix.shape)
    slope = ca.gradient(ca.sum1(ca.sum2(weights * matrix)), x)
    return ca.Function("turned", [x, weights], [ca.densify(slope)])


def worst(reports: Sequence[BoundReport]) -> BoundReport:
    """The report that is worst relative to what is allowed."""
    return max(reports, key=lambda report: report.worst / report.allowed)
