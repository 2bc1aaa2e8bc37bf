"""Integrators of a driven system ẏ = f(y, u), u(t) = Λ φ(t): the end point, the path, and dy(T)/dΛ by CasADi's AD.

All are one kind of object: an `Integrator` makes a `Flow` for a right-hand side, a control basis and a time grid.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.samples import Samples
from nhpocp.declared import check, count
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled.kernels import CompiledWhenReady, Kernels
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.runge_kutta import Bundle, Ends, Grid, Scheme, Sweep, Swept, ends_of, scheme, walked
from nhpocp.flow.tableau import CLASSICAL, Tableau
from nhpocp.provenance import afford

WORTH_ASKING = 1e8  # bytes: asking the system for its free memory takes as long as a small sweep


class Flow(ABC):
    """y(0), Λ ↦ y on a grid of times. States (n,), coefficients Λ (m, size); λ = the rows of Λ one after another."""

    times: Array

    @abstractmethod
    def states(self, start: Array, coefficients: Array) -> Array:
        """y at the grid's times, (len(times), n)."""

    def end(self, start: Array, coefficients: Array) -> Array:
        """y(T), (n,)."""
        return self.states(start, coefficients)[-1]

    @abstractmethod
    def sensitivity(self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)) -> Swept:
        """The states as above, and dy/dλ, as observed, at the grid's times of these indices."""

    @abstractmethod
    def ends(self, start: Array, coefficients: Array, differentiated: bool = True) -> Ends:
        """Where many controls (k, m, size) lead from one start, with dy(T)/dλ if wanted."""


class Integrator(Constructed):
    """A way to integrate. Hashable: flows are kept by it."""

    kind: ClassVar[str]
    steps: int

    def __post_init__(self) -> None:
        check(self)

    def grid(self, basis: ControlBasis, horizon: float) -> Array:
        """Times at which this integrator's own steps end (the basis's breakpoints among them)."""
        return uniform_grid(self.steps, basis.breakpoints(horizon), horizon)

    def flow(
        self, dynamics: Dynamics, basis: ControlBasis, horizon: float, times: Array | None = None
    ) -> Flow:
        """The flow of ẏ = rate(y, u) with u(t) = Λ φ(t) over [0, horizon], on the given times or on `grid`."""
        times = self.grid(basis, horizon) if times is None else np.asarray(times, dtype=float)
        return self._flow(dynamics, basis, horizon, times)

    @abstractmethod
    def _flow(self, dynamics: Dynamics, basis: ControlBasis, horizon: float, times: Array) -> Flow:
        """That on these times."""


def uniform_grid(steps: int, breakpoints: Array, horizon: float) -> Array:
    """``steps`` equal steps, cut further at the breakpoints; a grid point beside a breakpoint gives way to it."""
    kept = np.concatenate([[0.0], np.asarray(breakpoints, dtype=float), [horizon]])
    grid = np.linspace(0.0, horizon, steps + 1)
    return np.sort(np.concatenate([kept, grid[~beside(grid, kept, horizon)]]))


def even_pieces(steps: int, breakpoints: Array, horizon: float) -> Array:
    """``steps`` equal steps from each breakpoint to the next, for controls that are as smooth in every piece."""
    knots = np.concatenate([[0.0], np.asarray(breakpoints, dtype=float), [horizon]])
    inner = knots[:-1, None] + np.diff(knots)[:, None] * np.arange(steps) / steps
    return np.append(inner.ravel(), horizon)


def beside(times: Array, others: Array, horizon: float) -> Array:
    """Which times are one of the others, which rise, up to rounding."""
    if not len(others):
        return np.zeros(len(times), dtype=bool)
    after = np.searchsorted(others, times)
    near = [others[np.clip(place, 0, len(others) - 1)] for place in (after - 1, after)]
    return np.asarray(np.abs(np.asarray(near) - times).min(axis=0) <= 1e-9 * horizon)


@dataclass(frozen=True)
class RungeKutta4(Integrator):
    """The classical fourth-order Runge–Kutta scheme, or that of another tableau, with fixed steps, written out.

    A step sees the control at a few times only, so the basis never enters the integrator: dy(T)/dλ is the exact
    derivative of the scheme. The wanted rows of it are pulled back through the steps (`Scheme`), and what they gather
    is summed against φ at the end. ``kernels``: whether a compiled kernel does that.
    """

    steps: int = count(100, "integration steps over the horizon")
    kernels: Kernels = field(default_factory=CompiledWhenReady)
    tableau: Tableau = CLASSICAL
    kind: ClassVar[str] = "rk4"

    def _flow(self, dynamics: Dynamics, basis: ControlBasis, horizon: float, times: Array) -> RungeKuttaFlow:
        grid = Grid(np.diff(times), *_control_nodes(basis, horizon, times, self.tableau))
        return RungeKuttaFlow(dynamics, self.tableau, times, grid, self.kernels)


class RungeKuttaFlow(Flow):
    """`RungeKutta4` on one grid of times; the grid need not be uniform."""

    def __init__(
        self, dynamics: Dynamics, tableau: Tableau, times: Array, grid: Grid, kernels: Kernels
    ) -> None:
        self.times, self.grid, self._kernels = times, grid, kernels
        self._dynamics, self._tableau = dynamics, tableau

    @cached_property
    def _scheme(self) -> Scheme:
        return scheme(self._dynamics, self._tableau)

    def _sweep(self, start: Array, coefficients: Array, stops: Sequence[int]) -> Sweep:
        start, coefficients = (np.asarray(numbers, dtype=float) for numbers in (start, coefficients))
        return Sweep(start, self.grid, coefficients, tuple(stops))

    def states(self, start: Array, coefficients: Array) -> Array:
        sweep = self._sweep(start, coefficients, ())
        if self._dynamics.linearised is None:  # no kernel for what is never differentiated
            return walked(self._dynamics.rate, self._tableau, sweep)
        return self._kernels.swept(self._scheme, sweep).path

    def ends(self, start: Array, coefficients: Array, differentiated: bool = True) -> Ends:
        start, coefficients = (np.asarray(numbers, dtype=float) for numbers in (start, coefficients))
        bundle = Bundle(start, self.grid, coefficients, differentiated)
        return self._kernels.bundled(self._scheme, bundle)

    def sensitivity(self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)) -> Swept:
        functions = self._scheme
        wanted = 16.0 * len(stops) * functions.rows * np.size(coefficients)
        if wanted > WORTH_ASKING:
            afford(wanted, f"the derivatives of {len(stops)} states by {np.size(coefficients)} coefficients")
        sweep = self._sweep(start, coefficients, [range(len(self.times))[stop] for stop in stops])
        if len(stops) * functions.rows > sweep.coefficients.size:
            return self._forwards(functions, sweep)
        return self._kernels.swept(functions, sweep)

    def _forwards(self, functions: Scheme, sweep: Sweep) -> Swept:
        """dy/dλ from the first step to the last: one pass for any number of stops."""
        steps, ends = functions.linearised_along(sweep), list(sweep.stops)
        path, along = steps.path, steps.pushed_on(sweep.grid.basis)[ends]
        (matrices,) = call(mapped(functions.observed, len(ends)), path[ends])
        derivatives = matrices.reshape(len(ends), functions.size, functions.rows).swapaxes(1, 2) @ along
        return Swept(path, derivatives, functions.watched_along(path))


def _control_nodes(
    basis: ControlBasis, horizon: float, times: Array, tableau: Tableau
) -> tuple[Array, Samples]:
    """Places (steps, seen) of the controls that each step sees among samples of φ, and these samples.

    One-sided limits: a step never sees the control beyond a breakpoint at its ends. Where there is none, the end of a
    step and the start of the next are one sample.
    """
    steps = len(times) - 1
    broken = beside(times[1:-1], basis.breakpoints(horizon), horizon)
    starts = (tableau.seen - 1) * np.arange(steps) + np.concatenate([[0], np.cumsum(broken)])
    nodes = np.ascontiguousarray(starts[:, None] + np.arange(tableau.seen), dtype=np.int64)
    at, from_left = np.empty(nodes[-1, -1] + 1), np.zeros(nodes[-1, -1] + 1, dtype=bool)
    for column, fraction in zip(nodes.T[::-1], tableau.fractions[::-1], strict=True):
        at[column] = (1.0 - fraction) * times[:-1] + fraction * times[1:]
    from_left[nodes[np.append(broken, True), -1]] = True
    return nodes, Samples(basis, horizon, at, from_left)


@dataclass(frozen=True)
class CasadiIntegrator(Integrator):
    """``ca.integrator`` and CasADi's own sensitivities.

    Kept to forward sensitivities: with more parameters than outputs CasADi would choose the adjoint, whose backward
    quadratures SUNDIALS leaves out of its error control, and the Jacobian comes out silently wrong (casadi#4383).
    """

    plugin: str
    steps: int = count(100, "integration steps over the horizon")
    options: tuple[tuple[str, Any], ...] = ()

    def _flow(self, dynamics: Dynamics, basis: ControlBasis, horizon: float, times: Array) -> CasadiFlow:
        return CasadiFlow(self, dynamics, basis, horizon, times)


@dataclass(frozen=True)
class CasadiRungeKutta(CasadiIntegrator):
    """CasADi's ``rk``: the same scheme as `RungeKutta4`, differentiated as a whole.

    steps: integration steps over the horizon. plugin, options: of ``ca.integrator``, options as pairs (name, value).
    Errors: `InvalidProblemError` for steps that are no whole number from 1 to 100000.
    """

    plugin: str = "rk"
    kind: ClassVar[str] = "rk"


@dataclass(frozen=True)
class Cvodes(CasadiIntegrator):
    """SUNDIALS' variable-order, variable-step integrator, at a relative and absolute tolerance of 1e-10.

    steps: where the path is recorded, no more. plugin, options: of ``ca.integrator``, options as pairs (name, value).
    Errors: `InvalidProblemError` for steps that are no whole number from 1 to 100000.
    """

    plugin: str = "cvodes"
    kind: ClassVar[str] = "cvodes"
    options: tuple[tuple[str, Any], ...] = (
        ("reltol", 1e-10),
        ("abstol", 1e-10),
        ("max_num_steps", 100_000),
        ("fsens_err_con", True),
    )


class CasadiFlow(Flow):
    """A ``ca.integrator`` over one grid of times."""

    def __init__(
        self,
        integrator: CasadiIntegrator,
        dynamics: Dynamics,
        basis: ControlBasis,
        horizon: float,
        times: Array,
    ) -> None:
        if len(basis.breakpoints(horizon)):
            raise InvalidProblemError(
                f"{integrator.plugin} integrates smooth controls only; use `integrator: rk4` for a {basis.kind} basis",
                path="solvers.jacobian.integrator",
            )
        self.times, self._dynamics, rate = times, dynamics, dynamics.rate
        inputs = rate.size1_in(1)
        y, t = ca.SX.sym("y", rate.size1_in(0)), ca.SX.sym("t")
        coefficients = ca.SX.sym("L", inputs, basis.size)
        parameters = ca.vec(coefficients.T)  # the rows one after another
        ode = rate(y, coefficients @ basis.values(t, horizon))
        self._problem = {"x": y, "p": parameters, "t": t, "ode": ode}
        self._plugin = integrator.plugin
        self._options = {"enable_reverse": False, **dict(integrator.options)}
        if integrator.plugin == "rk":
            self._options["number_of_finite_elements"] = len(self.times) - 1
        self._jacobians: dict[tuple[int, ...], ca.Function] = {}

    @cached_property
    def _walk(self) -> ca.Function:
        return ca.integrator(
            "walk", self._plugin, self._problem, self.times[0], self.times[1:], self._options
        )

    @cached_property
    def _end(self) -> ca.Function:
        return ca.integrator("end", self._plugin, self._problem, self.times[0], self.times[-1], self._options)

    def _jacobian(self, stops: Sequence[int]) -> ca.Function:
        """(y0, λ) ↦ y at the stops one below the other, and its derivative by λ."""
        key = tuple(stops)
        if key not in self._jacobians:
            walk = ca.integrator(
                "stops", self._plugin, self._problem, self.times[0], self.times[list(key)], self._options
            )
            start, parameters = ca.MX.sym("y0", walk.size1_in("x0")), ca.MX.sym("p", walk.size1_in("p"))
            ends = ca.vec(walk(x0=start, p=parameters)["xf"])
            self._jacobians[key] = ca.Function(
                "jacobian", [start, parameters], [ends, ca.jacobian(ends, parameters)]
            )
        return self._jacobians[key]

    def states(self, start: Array, coefficients: Array) -> Array:
        return np.vstack([start, np.array(self._walk(x0=start, p=np.ravel(coefficients))["xf"]).T])

    def end(self, start: Array, coefficients: Array) -> Array:
        return np.array(self._end(x0=start, p=np.ravel(coefficients))["xf"]).ravel()

    def sensitivity(self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)) -> Swept:
        ends, jacobian = self._jacobian(stops)(start, np.ravel(coefficients))
        states = self.states(start, coefficients)
        states[list(stops)] = np.array(ends).reshape(len(stops), -1)  # the points that were differentiated
        derivatives = np.array(jacobian).reshape(len(stops), states.shape[1], -1)
        observed, watched = self._dynamics.observed, np.empty((len(states), 0))
        if observed is not None:
            matrices = [call(observed, states[stop])[0].T for stop in stops]
            derivatives = np.stack(matrices) @ derivatives
        if self._dynamics.watched is not None:
            (watched,) = call(mapped(self._dynamics.watched, len(states)), states)
        return Swept(states, derivatives, watched)

    def ends(self, start: Array, coefficients: Array, differentiated: bool = True) -> Ends:
        if differentiated:
            return ends_of([self.sensitivity(start, each) for each in coefficients])
        nothing = np.empty((0, 0, 0))
        return Ends(np.stack([self.end(start, each) for each in coefficients]), nothing, nothing)
