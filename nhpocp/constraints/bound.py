"""What a plan must respect, said once for every solver: bounds on named quantities along the path.

A quantity is any entry of a trajectory: a state block, an input, an output, or a margin (sigma_s, sigma_w).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.errors import describe
from nhpocp.frozen import ByValue, Frozen
from nhpocp.objectives.quantity import quantity
from nhpocp.scales import side_size
from nhpocp.systems.margins import Margin, margin
from nhpocp.systems.system import System

RELATIVE = 1e-3  # of its size, by which a limit may be passed
ROUNDING = 1e-12  # of a limit's size


@dataclass(frozen=True, eq=False)
class Bound(ByValue, Frozen):
    """A bound lower ≤ quantity ≤ upper at every time, componentwise.

    label: as a problem file calls it, such as "leg_length" or "state.position"; reports show it. quantity: a name of
    the trajectory, such as "leg_lengths" or "u". lower, upper: numbers in the quantity's unit ([length], [rad], a rate
    per [time]), or arrays (components,); infinite where a side is open. scale, coordinate: filled in by a problem.
    degrees: whether messages give its numbers, angles in [rad], in degrees. entries: what messages call its components,
    filled in by a problem.
    Errors: `InvalidProblemError`, by the problem, for a quantity that it does not have, or limits of another shape.
    """

    # as the problem file calls it: leg_length, leg_speed, control, clearance.sigma_s, state.position
    label: str
    quantity: str  # the trajectory's name for it: leg_lengths, u, v, sigma_s, position
    lower: Any = -np.inf
    upper: Any = np.inf
    # a problem fills these in: the quantity's scale, and whether it is part of the state, whose zero lies anywhere
    scale: float = field(default=1.0, compare=False)
    coordinate: bool = field(default=False, compare=False)
    degrees: bool = field(default=False, compare=False)
    entries: tuple[str, ...] = field(default=(), compare=False)

    def named(self, component: tuple[int, ...]) -> str:
        """The label with a component, as in leg_length[1] or distance[leg 1, leg 2]."""
        if self.entries:
            return f"{self.label}[{self.entries[component[0] if component else 0]}]"
        return self.label + "".join(f"[{i}]" for i in component)

    def figure(self, value: float, form: str = "g") -> str:
        """A number of the quantity in words."""
        return f"{np.degrees(value):{form}} deg" if self.degrees else f"{value:{form}}"

    @property
    def margin(self) -> Margin | None:
        """The margin that is bounded, if it is one."""
        return margin(self.quantity)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why this cannot be a bound on a quantity of a shape, in words; empty where it can."""
        try:
            sides = [np.asarray(side, dtype=float) for side in (self.lower, self.upper)]
        except (TypeError, ValueError):
            return (
                f"expected numbers as lower and upper, got {describe(self.lower)} and {describe(self.upper)}"
            )
        for side in sides:
            if not shape and side.size > 1:
                return "lists of bounds; expected [lo, hi], for this is one number"
            if shape and side.shape != shape[len(shape) - side.ndim :]:
                return f"{len(side)} bounds a side; expected {shape[-1]}"
        lower, upper = np.broadcast_arrays(*sides)
        crossed = np.argwhere(lower > upper)
        if not len(crossed):
            return ""
        place = tuple(crossed[0])
        component = f" in component {', '.join(str(i + 1) for i in place)}" if place else ""
        low, high = self.figure(lower[place]), self.figure(upper[place])
        return f"lower bound {low} is above upper bound {high}{component}"

    def excess(self, values: Array) -> Array:
        """How far values (k, …) stand outside, same shape; 0 inside."""
        return np.maximum(0.0, np.maximum(np.asarray(self.lower) - values, values - np.asarray(self.upper)))

    def relative_excess(self, values: Array) -> Array:
        """The excess in units of the size of the limit that is passed, each side and component by its own."""
        return np.maximum(0.0, self.nearness(values))

    def nearness(self, values: Array) -> Array:
        """The relative excess; negative inside, where it says how far the nearer limit is."""
        lower, upper = np.asarray(self.lower, dtype=float), np.asarray(self.upper, dtype=float)
        sizes = self.sizes
        with np.errstate(invalid="ignore"):  # an infinite limit is never passed
            below = np.where(np.isfinite(lower), (lower - values) / sizes[0], -np.inf)
            above = np.where(np.isfinite(upper), (values - upper) / sizes[1], -np.inf)
        return np.maximum(below, above)

    @cached_property
    def sizes(self) -> tuple[Array, Array]:
        """What tolerances of the lower and of the upper side are fractions of (`side_size`), componentwise."""
        size = np.vectorize(side_size, otypes=[float])
        lower, upper = np.broadcast_arrays(
            np.asarray(self.lower, dtype=float), np.asarray(self.upper, dtype=float)
        )
        rest = self.scale, self.coordinate
        return size(lower, upper, *rest), size(upper, lower, *rest)

    def size(self, component: tuple[int, ...], value: float) -> float:
        """Of the side that a value of one component passes, or is bounded by."""
        (low, high), (below, above) = self.limits(component), self.sizes
        passed = value > high or not np.isfinite(low)
        return _entry(above if passed else below, component)

    def limits(self, component: tuple[int, ...]) -> tuple[float, float]:
        """(lower, upper) of one component of the quantity."""
        return _entry(self.lower, component), _entry(self.upper, component)

    def passed(self, values: Array, tolerance: float) -> tuple[Array, Array]:
        """By how much values (k, …) pass either limit at most, by component; 0 within ``tolerance`` of the limit."""
        lower, upper = np.asarray(self.lower, dtype=float), np.asarray(self.upper, dtype=float)
        below, above = (lower - values).max(axis=0), (values - upper).max(axis=0)
        sizes = self.sizes
        return (
            np.where(below > tolerance * sizes[0], below, 0.0),
            np.where(above > tolerance * sizes[1], above, 0.0),
        )

    def tightened(self, below: Array, above: Array) -> Bound | None:
        """Moved inwards, each side and component by its own amount; None where nothing would be left inside."""
        lower, upper = np.asarray(self.lower) + below, np.asarray(self.upper) - above
        return replace(self, lower=lower, upper=upper) if (lower <= upper).all() else None


def _entry(side: Any, component: tuple[int, ...]) -> float:
    """What broadcasting gives a component of one side."""
    table = np.asarray(side, dtype=float)
    own = component[len(component) - table.ndim :]
    return float(table[tuple(i if size > 1 else 0 for i, size in zip(own, table.shape, strict=True))])


def in_shape(side: Any, shape: tuple[int, ...]) -> Array:
    """A side of a bound for every component of a quantity; CasADi takes a vector of one number for a scalar."""
    numbers = np.asarray(side, dtype=float)
    return np.broadcast_to(numbers if shape else numbers.reshape(()), shape)


def bound_rows(
    bound: Bound,
    system: System,
    state: Array,
    control: Array,
    length_scale: float,
    control_rate: Array | None = None,
) -> list[tuple[str, Any, float, float]]:
    """A bound as scalar expressions: (name, expression, lower, upper) for every component that has a finite side.

    σ_min(M) ≥ c is stated as M Mᵀ - c² I positive definite: its leading minors, smooth where σ_min is not.
    """
    if bound.margin:
        name = bound.margin.matrix
        matrix = system.regularity(state)[name]
        scales = system.column_scales(name, length_scale)
        scaled = namespace(state).block([[matrix[:, i] / scales[i] for i in range(len(scales))]])
        clearance = float(np.max(bound.lower))
        if not np.isfinite(clearance):
            return []
        return [
            (bound.label, minor, 0.0, np.inf) for minor in _leading_minors(scaled @ scaled.T, clearance**2)
        ]
    value = quantity(system, bound.quantity, state, control, control_rate)
    shape = (
        np.shape(value) if isinstance(value, np.ndarray | float) else tuple(s for s in value.shape if s != 1)
    )
    lower, upper = in_shape(bound.lower, shape), in_shape(bound.upper, shape)
    rows = []
    for index in np.ndindex(*shape):
        entry = value[index] if shape else value
        if np.isfinite(lower[index]) or np.isfinite(upper[index]):
            rows.append((bound.named(index), entry, float(lower[index]), float(upper[index])))
    return rows


def _leading_minors(matrix: Array, shift: float) -> list[Array]:
    """Leading principal minors of ``matrix - shift I``, polynomials, positive exactly where it is positive definite.

    Row by row, the determinants of the first k rows over every choice of k columns (Laplace).
    """
    size = matrix.shape[0]
    entry = [[matrix[i, j] - (shift if i == j else 0.0) for j in range(size)] for i in range(size)]
    minors: dict[tuple[int, ...], Array] = {(): 1.0}
    for k in range(size):
        minors = {
            columns: sum(
                (-1) ** (k + place) * entry[k][column] * minors[columns[:place] + columns[place + 1 :]]
                for place, column in enumerate(columns)
            )
            for columns in combinations(range(size), k + 1)
        } | minors
    return [minors[tuple(range(k + 1))] for k in range(size)]


@dataclass(frozen=True)
class BoundReport:
    """The worst place of one bound along a path."""

    bound: Bound
    worst: float  # excess in the quantity's own unit; 0 where the bound holds
    time: float
    component: tuple[int, ...]
    ok: bool
    value: float = np.nan  # of the quantity there
    allowed: float = np.nan  # excess, in the same unit

    @property
    def name(self) -> str:
        """The bound and its component, as in leg_length[1]."""
        return self.bound.named(self.component)

    def __repr__(self) -> str:
        place = f"nearest {self.value:.4g} at t = {self.time:.4g}"
        return (
            f"<BoundReport {self.name} is kept, {place}>" if self.ok else f"<BoundReport {self.describe()}>"
        )

    def describe(self) -> str:
        return f"{self.name} is {self.value_words()} at t={self.time:.4g}, {self.limit_words()}"

    def broken_words(self) -> str:
        return f"{self.describe()} by {self.bound.figure(self.worst, '.3g')}"

    def value_words(self) -> str:
        """The value in words; what is rounding beside its limit is 0."""
        rounding = abs(self.value) < ROUNDING * self.bound.size(self.component, self.value)
        return self.bound.figure(0.0 if rounding else self.value, ".4g")

    def limit_words(self) -> str:
        """Which limits the value should have kept: "outside [20, 60]", "below 0.05"."""
        limits = self.bound.limits(self.component)
        low, high = (self.bound.figure(limit) for limit in limits)
        if np.isfinite(limits).all():
            return f"outside [{low}, {high}]"
        return f"below {low}" if np.isfinite(limits[0]) else f"above {high}"


def check_bounds(
    bounds: Sequence[Bound],
    times: Array,
    trajectory: Mapping[str, Array],
    relative_tolerance: float = RELATIVE,
) -> list[BoundReport]:
    """Every bound on every sample; a bound holds if no excess is above ``relative_tolerance`` of `Bound.sizes`."""
    reports = []
    for bound in bounds:
        values = np.asarray(trajectory[bound.quantity])
        relative = np.where(np.isnan(values), np.inf, bound.nearness(values))
        place = np.unravel_index(int(np.argmax(relative)), relative.shape)
        worst = float(np.where(np.isnan(values), np.inf, bound.excess(values))[place])
        component = tuple(int(i) for i in place[1:])
        holds, time, value = (
            bool(relative[place] <= relative_tolerance),
            float(times[place[0]]),
            values[place],
        )
        allowed = relative_tolerance * bound.size(component, value)
        reports.append(BoundReport(bound, worst, time, component, holds, float(value), allowed))
    return reports
