"""Integrators of a driven system ẏ = f(y, u), u(t) = Λ φ(t): the end point, the path, and dy(T)/dΛ by CasADi's AD.

All are one kind of object: an `Integrator` makes a `Flow` for a right-hand side, a control basis and a time grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import accumulated, call, mapped
from nhpocp.controls.basis import ControlBasis
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.kernels import CompiledWhenReady, Kernels
from nhpocp.flow.runge_kutta import Scheme, Sweep, runge_kutta_step, scheme


class Flow(Protocol):
    """y(0), Λ ↦ y on a grid of times. States (n,), coefficients Λ (m, size); λ = the rows of Λ one after another."""

    times: Array

    def states(self, start: Array, coefficients: Array) -> Array:
        """y at the grid's times, (len(times), n)."""
        ...

    def end(self, start: Array, coefficients: Array) -> Array:
        """y(T), (n,)."""
        ...

    def sensitivity(
        self,
        start: Array,
        coefficients: Array,
        stops: Sequence[int] = (-1,),
        observed: ca.Function | None = None,
    ) -> tuple[Array, Array]:
        """The states as above, and dy/dλ at the grid's times of these indices, (stops, n, m·size).

        observed: y ↦ matrix (rows × n), by which dy is multiplied: (stops, rows, m·size). Few rows are cheap.
        """
        ...


class Integrator(Protocol):
    """A way to integrate."""

    kind: ClassVar[str]

    def __hash__(self) -> int: ...

    def grid(self, basis: ControlBasis, horizon: float) -> Array:
        """Times at which this integrator's own steps end (the basis's breakpoints among them)."""
        ...

    def flow(
        self,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array | None = None,
        linearised: ca.Function | None = None,
    ) -> Flow:
        """The flow of ẏ = rate(y, u) with u(t) = Λ φ(t) over [0, horizon], on the given times or on `grid`.

        linearised: (y, u) ↦ [∂rate/∂y, ∂rate/∂u], n × (n + m), where a cheaper one than CasADi's AD finds is known.
        """
        ...


def uniform_grid(steps: int, breakpoints: Array, horizon: float) -> Array:
    """``steps`` equal steps, cut further at the breakpoints; a grid point beside a breakpoint gives way to it."""
    kept = np.concatenate([[0.0], np.asarray(breakpoints, dtype=float), [horizon]])
    grid = np.linspace(0.0, horizon, steps + 1)
    apart = np.abs(grid[:, None] - kept).min(axis=1) > 1e-9 * horizon
    return np.sort(np.concatenate([kept, grid[apart]]))


@dataclass(frozen=True)
class RungeKutta4:
    """The classical fourth-order Runge–Kutta scheme with fixed steps, written out.

    A step sees the control at its start, middle and end only, so the basis never enters the integrator: dy(T)/dλ is the
    exact derivative of the scheme. The wanted rows of it are pulled back through the steps (`Scheme`), and what they
    gather is summed against φ at the end. ``kernels``: whether a compiled kernel does that.
    """

    steps: int = 100
    kernels: Kernels = field(default_factory=CompiledWhenReady)
    kind: ClassVar[str] = "rk4"

    def grid(self, basis: ControlBasis, horizon: float) -> Array:
        return uniform_grid(self.steps, basis.breakpoints(horizon), horizon)

    def flow(
        self,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array | None = None,
        linearised: ca.Function | None = None,
    ) -> RungeKuttaFlow:
        times = self.grid(basis, horizon) if times is None else times
        return RungeKuttaFlow(rate, basis, horizon, times, linearised, self.kernels)


class RungeKuttaFlow:
    """`RungeKutta4` on one grid of times; the grid need not be uniform."""

    def __init__(
        self,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array,
        linearised: ca.Function | None,
        kernels: Kernels,
    ) -> None:
        self.times = np.asarray(times, dtype=float)
        self._h = np.diff(self.times)
        self._nodes, self._table = _control_nodes(basis, horizon, self.times)
        self._rate, self._given, self._kernels = rate, linearised, kernels
        self._known: tuple[ca.Function | None, Scheme] | None = None  # the last

    def _scheme(self, observed: ca.Function | None) -> Scheme:
        if self._known is None or self._known[0] is not observed:
            found = scheme(self._rate, self._given or differentiated(self._rate), observed)
            self._known = observed, found
        return self._known[1]

    def states(self, start: Array, coefficients: Array) -> Array:
        controls = (self._table @ np.asarray(coefficients, dtype=float).T)[self._nodes]
        (walked,) = call(accumulated(runge_kutta_step(self._rate), len(self._h)), start, self._h, controls)
        return np.vstack([start, walked])

    def end(self, start: Array, coefficients: Array) -> Array:
        return self.states(start, coefficients)[-1]

    def sensitivity(
        self,
        start: Array,
        coefficients: Array,
        stops: Sequence[int] = (-1,),
        observed: ca.Function | None = None,
    ) -> tuple[Array, Array]:
        functions = self._scheme(observed)
        ends = [range(len(self.times))[stop] for stop in stops]
        start, coefficients = (np.asarray(numbers, dtype=float) for numbers in (start, coefficients))
        sweep = Sweep(start, self._h, self._nodes, self._table, coefficients, ends)
        if len(ends) * functions.rows > coefficients.size:
            with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
                return self._forwards(functions, sweep)
        return self._kernels.swept(functions, sweep)

    def _forwards(self, functions: Scheme, sweep: Sweep) -> tuple[Array, Array]:
        """dy/dλ from the first step to the last: one pass for any number of stops."""
        path, tape = functions.walked(sweep.start, sweep.h, sweep.controls())
        ends = list(sweep.stops)
        steps, size, inputs = len(self._h), functions.size, functions.inputs
        by_state, by_controls = call(mapped(functions.blocks, steps), tape, self._h)
        by_state = by_state.reshape(steps, size, size)
        by_controls = by_controls.reshape(steps, size, 3, inputs)
        driven = np.einsum("knjm,kjf->knmf", by_controls, self._table[self._nodes])
        driven = driven.reshape(steps, size, -1)
        along = np.zeros((steps + 1, size, driven.shape[2]))
        for k in range(steps):
            along[k + 1] = by_state[k] @ along[k] + driven[k]
        (matrices,) = call(mapped(functions.observed, len(ends)), path[ends])
        return path, matrices.reshape(len(ends), size, functions.rows).swapaxes(1, 2) @ along[ends]


def _control_nodes(basis: ControlBasis, horizon: float, times: Array) -> tuple[Array, Array]:
    """Places (steps, 3) of each step's three controls in a table of φ (nodes, size), and that table.

    One-sided limits: a step never sees the control beyond a breakpoint at its ends. Where there is none, the end of a
    step and the start of the next are one node.
    """
    starts, ends = times[:-1], times[1:]
    tables = [
        basis.table(starts, horizon, "right"),
        basis.table(0.5 * (starts + ends), horizon),
        basis.table(ends, horizon, "left"),
    ]
    shared = 2 if np.array_equal(tables[0][1:], tables[2][:-1]) else 3
    nodes = shared * np.arange(len(starts))[:, None] + np.arange(3)
    table = np.empty((nodes[-1, -1] + 1, basis.size))
    for column, values in zip(nodes.T, tables, strict=True):
        table[column] = values
    return np.ascontiguousarray(nodes, dtype=np.int64), table


@lru_cache(maxsize=64)
def differentiated(rate: ca.Function) -> ca.Function:
    """(y, u) ↦ [∂rate/∂y, ∂rate/∂u] by CasADi's AD."""
    y, u = ca.SX.sym("y", rate.size1_in(0)), ca.SX.sym("u", rate.size1_in(1))
    jacobian = ca.densify(ca.jacobian(rate(y, u), ca.vertcat(y, u)))
    return ca.Function("linearised", [y, u], [jacobian])


@dataclass(frozen=True)
class CasadiIntegrator:
    """``ca.integrator`` and CasADi's own sensitivities.

    Kept to forward sensitivities: with more parameters than outputs CasADi would choose the adjoint, whose backward
    quadratures SUNDIALS leaves out of its error control, and the Jacobian comes out silently wrong (casadi#4383).
    """

    plugin: str
    steps: int = 100
    options: tuple[tuple[str, Any], ...] = ()

    @property
    def kind(self) -> str:
        return self.plugin

    def grid(self, basis: ControlBasis, horizon: float) -> Array:
        return uniform_grid(self.steps, basis.breakpoints(horizon), horizon)

    def flow(
        self,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array | None = None,
        linearised: ca.Function | None = None,
    ) -> CasadiFlow:
        return CasadiFlow(self, rate, basis, horizon, self.grid(basis, horizon) if times is None else times)


@dataclass(frozen=True)
class CasadiRungeKutta(CasadiIntegrator):
    """CasADi's ``rk``: the same scheme as `RungeKutta4`, differentiated as a whole."""

    plugin: str = "rk"


@dataclass(frozen=True)
class Cvodes(CasadiIntegrator):
    """SUNDIALS' variable-order, variable-step integrator; ``steps`` only sets where the path is recorded."""

    plugin: str = "cvodes"
    options: tuple[tuple[str, Any], ...] = (
        ("reltol", 1e-10),
        ("abstol", 1e-10),
        ("max_num_steps", 100_000),
        ("fsens_err_con", True),
    )


class CasadiFlow:
    """A ``ca.integrator`` over one grid of times."""

    def __init__(
        self,
        integrator: CasadiIntegrator,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array,
    ) -> None:
        if len(basis.breakpoints(horizon)):
            raise InvalidProblemError(
                f"{integrator.plugin} integrates smooth controls only; use `integrator: rk4` for a {basis.kind} basis",
                path="solvers.jacobian.integrator",
            )
        self.times = np.asarray(times, dtype=float)
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
        walked = self._walk(x0=start, p=np.ravel(coefficients))["xf"]
        return np.vstack([start, np.array(walked).T])

    def end(self, start: Array, coefficients: Array) -> Array:
        return np.array(self._end(x0=start, p=np.ravel(coefficients))["xf"]).ravel()

    def sensitivity(
        self,
        start: Array,
        coefficients: Array,
        stops: Sequence[int] = (-1,),
        observed: ca.Function | None = None,
    ) -> tuple[Array, Array]:
        ends, jacobian = self._jacobian(stops)(start, np.ravel(coefficients))
        states = self.states(start, coefficients)
        states[list(stops)] = np.array(ends).reshape(len(stops), -1)  # the points that were differentiated
        derivatives = np.array(jacobian).reshape(len(stops), states.shape[1], -1)
        if observed is None:
            return states, derivatives
        matrices = [call(observed, states[stop])[0].T for stop in stops]
        return states, np.stack(matrices) @ derivatives
