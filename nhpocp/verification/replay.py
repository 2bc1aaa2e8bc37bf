"""Integration of a system's equations under a stored control, by SciPy's DOP853. [Hairer, Nørsett, Wanner I]

A path is integrated piece by piece between the control's breakpoints with one-sided control values, so that no step
straddles a discontinuity. The rotation is integrated as nine plain numbers and never projected: its drift off SO(3)
is one of the things that verification looks at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from math import acos, isqrt
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.integrate import DOP853, OdeSolution
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.state_space import StateSpace
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System

RTOL = ATOL = 1e-12  # the latter in units of the state's scales
METHOD = (
    f"SciPy DOP853, rtol {RTOL:g}, atol {ATOL:g} of the state's scales, between the control's breakpoints"
)
MOST_STEPS = 5_000  # of a smooth piece; one takes 20 to 500
STEPS_PER_FUNCTION = 20  # more, for a basis whose functions oscillate: a harmonic takes up to 10
FIRST_STEP = (
    0.02  # of the horizon, at most a smooth piece: SciPy's own first step is absolute at a state of zeros
)
SHORTEST_STEP = 1e-9  # share of a smooth piece; a path that needs such steps ends there

# On a smooth piece, mapped to [-1, 1]: basis functions are interpolated at Chebyshev's nodes, and compared with that at
# probes which are no multiples of a fraction that a period may have
DEGREE = 7
NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
PROBES = np.array([-0.7726, 0.0582, 0.7426])
TO_COEFFICIENTS = np.linalg.inv(chebvander(NODES, DEGREE))
INTERPOLATED = chebvander(PROBES, DEGREE) @ TO_COEFFICIENTS
ROUNDING = 1e-13  # of the largest value on the piece

Rate = Callable[[float, Array, Array], Array]  # (t, x, u(t)) ↦ ẋ


class FastFunction:
    """A CasADi Function of vectors with one dense result, called without the wrapper's conversions."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function  # the buffer refers to it
        buffer: Any
        buffer, self._run = function.buffer()
        self._buffer = buffer  # CasADi's type stubs miss the memoryview overloads
        self._arguments = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self._result = np.zeros(function.numel_out(0))
        for i, argument in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self, *arguments: Array) -> Array:
        for slot, argument in zip(self._arguments, arguments, strict=True):
            slot[:] = argument
        self._run()
        return self._result.copy()


@dataclass(frozen=True)
class Path:
    """x(t) on [0, reached]; ``stopped`` says why the rest is missing, None where nothing is."""

    start: Array
    reached: float
    stopped: str | None = None
    _dense: Any = field(default=None, repr=False)

    def __call__(self, times: Array) -> Array:
        """States (k, n) at times (k,) in [0, reached]."""
        times = np.asarray(times, dtype=float)
        if self._dense is None:
            return np.tile(self.start, (len(times), 1))
        return np.asarray(self._dense(times)).T

    @property
    def times(self) -> Array:
        """Where the integrator's steps end, 0 first."""
        return np.zeros(1) if self._dense is None else np.asarray(self._dense.ts)

    def at(self, time: float) -> Array:
        """The state (n,) at one time, without the cost of arrays of times."""
        return self.start if self._dense is None else np.asarray(self._dense(time))


@dataclass(frozen=True)
class Samples:
    """A path on a fine grid; a breakpoint inside stands twice, with the control's limit from either side."""

    times: Array
    states: Array
    controls: Array


class Watch:
    """Follows the determinants that a system's equations divide by, from their value at the start.

    A product below ``vanishing`` times its largest value so far counts as zero: closer to a singularity rounding alone
    turns the step control back, thousands of times over.
    """

    def __init__(self, system: System, start: Array, vanishing: float) -> None:
        self._vanishing, self._names = vanishing, system.breaking()
        x = ca.SX.sym("x", system.state_space.size)
        matrices = [ca.densify(system.regularity(x)[name]) for name in self._names]
        self._matrices = [FastFunction(ca.Function("matrix", [x], [matrix])) for matrix in matrices]
        self._sign, self._largest = np.sign(self.value(start)), 0.0

    def value(self, state: Array) -> float:
        """The product of the determinants; 1 for a system that divides by none."""
        product = 1.0
        for matrix in self._matrices:
            entries = matrix(state)
            side = isqrt(len(entries))
            product *= float(np.linalg.det(entries.reshape(side, side)))
        return product

    def look(self, dense: Any, low: float, high: float) -> tuple[float, str | None]:
        """Where a step ends, ``high`` unless a zero is met before, and what was met."""
        value = self.value(dense(high))
        self._largest = max(self._largest, abs(value))
        named = " or ".join(f"det {name.upper()}" for name in self._names)
        if np.sign(value) != self._sign:
            if self.value(dense(low)) * value < 0:  # else the value is 0 or not a number
                high = float(brentq(lambda t: self.value(dense(t)), low, high, xtol=1e-12 * (high - low)))
            return high, f"{named}, by which these equations divide, changes its sign"
        if abs(value) < self._vanishing * self._largest:
            return high, f"{named}, by which these equations divide, vanishes"
        return high, None


def inputs_on_piece(control: Control, first: float, last: float) -> Callable[[float], Array]:
    """t ↦ u(t) between two breakpoints, with the limits from inside at either.

    Where all basis functions are one and the same polynomial each on the piece, which no choice of coefficients can
    feign, so is u, and the table is asked once.
    """
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    table = control.basis.table(middle + half * np.concatenate([NODES, PROBES]), control.horizon)
    if (table == table[0]).all():
        constant = control.coefficients @ table[0]
        return lambda t: constant
    nodes, probes = table[: len(NODES)], table[len(NODES) :]
    if (np.abs(INTERPOLATED @ nodes - probes) <= ROUNDING * np.abs(table).max()).all():
        polynomial = TO_COEFFICIENTS @ nodes @ control.coefficients.T
        orders = np.arange(DEGREE + 1)
        # T_k(x) = cos(k arccos x)
        return lambda t: np.cos(orders * acos(min(1.0, max(-1.0, (t - middle) / half)))) @ polynomial
    return lambda t: control(np.array([min(t, last)]), "left" if t >= last else "right")[0]


def integrate(
    rate: Rate, control: Control, start: Array, watch: Watch | None = None, scales: Array | float = 1.0
) -> Path:
    """ẋ = rate over the control's horizon; ends early where it cannot go on, or where ``watch`` meets a zero.

    ``scales``: the natural sizes of the state's numbers. No step or tolerance has a unit of its own.
    """
    knots = np.unique([0.0, *control.breakpoints, control.horizon])
    budget = MOST_STEPS + STEPS_PER_FUNCTION * control.basis.size
    times: list[float] = [0.0]
    pieces: list[Any] = []
    state, stopped = np.asarray(start, dtype=float), None
    with np.errstate(all="ignore"):  # a step that overflows is rejected and shortened
        for first, last in pairwise(knots):
            inputs = inputs_on_piece(control, first, last)

            def piecewise(t: float, x: Array, inputs: Callable[[float], Array] = inputs) -> Array:
                return rate(t, x, inputs(t))

            if not np.isfinite(
                piecewise(first, state)
            ).all():  # DOP853 would never return from its first step
                stopped = "the rate there is not finite"
                break
            step = min(last - first, FIRST_STEP * control.horizon)
            solver = DOP853(piecewise, first, state, last, rtol=RTOL, atol=ATOL * scales, first_step=step)
            taken = 0
            while solver.status == "running" and stopped is None:
                solver.step()
                taken += 1
                if solver.status == "failed":
                    stopped = "the step size collapsed"
                    break
                dense, end = solver.dense_output(), float(solver.t)
                if solver.status == "running" and solver.step_size < SHORTEST_STEP * (last - first):
                    stopped = "the step size collapsed"
                elif watch:
                    end, stopped = watch.look(dense, times[-1], end)
                if end > times[-1]:
                    times.append(end)
                    pieces.append(dense)
                if taken >= budget and solver.status == "running" and stopped is None:
                    stopped = (
                        f"{taken} steps were not enough for the smooth piece from t={first:g} to {last:g}"
                    )
            state = solver.y
            if stopped:
                break
    return Path(np.asarray(start), times[-1], stopped, OdeSolution(times, pieces) if pieces else None)


def replay(numeric: NumericSystem, control: Control, start: Array, scales: Array | float = 1.0) -> Path:
    """The system's own equations ẋ = G(x) u under the control; ``scales`` as for `integrate`."""
    rate = FastFunction(numeric.rate_function)
    patient = Watch(numeric.system, start, vanishing=1e-7)  # to stop here is to refute
    return integrate(lambda t, x, u: rate(x, u), control, start, patient, scales)


def sample(path: Path, control: Control, count: int) -> Samples:
    """``count`` equidistant times over [0, reached], and both sides of every breakpoint."""
    breaks = np.asarray(control.breakpoints, dtype=float)
    inside = breaks[(breaks > 0) & (breaks < path.reached)]
    right = np.union1d(np.linspace(0.0, path.reached, count)[:-1], inside)
    left = np.append(inside, path.reached)
    together = np.concatenate([left, right])
    order = np.argsort(together, kind="stable")  # at a breakpoint, from the left first
    controls = np.concatenate([control(left, "left"), control(right)])
    return Samples(together[order], path(together[order]), controls[order])


def weighted_difference(space: StateSpace, points: Array, origins: Array, error_length: float) -> Array:
    """Tangent vectors (k, dimension) from origins to points (k, size) with the weights of E; SciPy's own logarithm."""
    here, there = space.split(points), space.split(origins)
    parts = []
    for block in space.blocks:
        a, b = here[block.name], there[block.name]
        if block.kind == "rotation":
            parts.append(Rotation.from_matrix(a @ b.transpose(0, 2, 1)).as_rotvec())
        else:
            parts.append((a - b).reshape(len(a), -1))
    return np.hstack(parts) * np.asarray(space.weights(error_length))
