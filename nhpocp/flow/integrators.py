"""Integrators of a driven system ẏ = f(y, u), u(t) = Λ φ(t): the end point, the path, and dy(T)/dΛ by CasADi's AD.

All are one kind of object: an `Integrator` makes a `Flow` for a right-hand side, a control basis and a time grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import accumulated, call, mapped
from nhpocp.controls.basis import ControlBasis
from nhpocp.errors import InvalidProblemError


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
        self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)
    ) -> tuple[Array, Array]:
        """The states as above, and dy/dλ at the grid's times of these indices, (stops, n, m·size)."""
        ...


class Integrator(Protocol):
    """A way to integrate."""

    kind: ClassVar[str]

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
    exact derivative of the scheme: f is differentiated (CasADi's AD) at its stages, the stages are chained within a
    step, the steps backwards, and the result is summed against φ.
    """

    steps: int = 100
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
        return RungeKuttaFlow(rate, basis, horizon, times, linearised)


@lru_cache(maxsize=64)
def runge_kutta_step(rate: ca.Function) -> ca.Function:
    """(y, h, [u(t), u(t + h/2), u(t + h)]) ↦ y(t + h), the last argument m × 3."""
    y, h = ca.SX.sym("y", rate.size1_in(0)), ca.SX.sym("h")
    u = ca.SX.sym("u", rate.size1_in(1), 3)
    k1 = rate(y, u[:, 0])
    k2 = rate(y + 0.5 * h * k1, u[:, 1])
    k3 = rate(y + 0.5 * h * k2, u[:, 1])
    k4 = rate(y + h * k3, u[:, 2])
    step = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [y, h, u], [ca.densify(step)], ["y", "h", "u"], ["next"])


class RungeKuttaFlow:
    """`RungeKutta4` on one grid of times; the grid need not be uniform."""

    def __init__(
        self,
        rate: ca.Function,
        basis: ControlBasis,
        horizon: float,
        times: Array,
        linearised: ca.Function | None = None,
    ) -> None:
        self.times = np.asarray(times, dtype=float)
        self._h = np.diff(self.times)
        starts, ends = self.times[:-1], self.times[1:]
        # one-sided limits: a step never sees the control beyond a breakpoint at its ends
        self._stages = np.stack(
            [
                basis.table(starts, horizon, "right"),
                basis.table(0.5 * (starts + ends), horizon),
                basis.table(ends, horizon, "left"),
            ]
        )  # (3, steps, size)
        self._rate, self._given = rate, linearised

    @property
    def _linearised(self) -> ca.Function:
        return self._given or differentiated(self._rate)

    def _stage_controls(self, coefficients: Array) -> Array:
        """u at every stage of every step, (steps, 3, m)."""
        return (self._stages @ np.asarray(coefficients, dtype=float).T).swapaxes(0, 1)

    def states(self, start: Array, coefficients: Array) -> Array:
        return self._states(np.asarray(start, dtype=float), self._stage_controls(coefficients))

    def _states(self, start: Array, controls: Array) -> Array:
        (walked,) = call(accumulated(runge_kutta_step(self._rate), len(self._h)), start, self._h, controls)
        return np.vstack([start, walked])

    def end(self, start: Array, coefficients: Array) -> Array:
        return self.states(start, coefficients)[-1]

    def sensitivity(
        self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)
    ) -> tuple[Array, Array]:
        controls = self._stage_controls(coefficients)
        states = self._states(np.asarray(start, dtype=float), controls)
        ends = [range(len(states))[stop] for stop in stops]
        with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
            derivatives = self._step_derivatives(states, controls)
            few = len(ends) * states.shape[1] <= np.size(coefficients)
            chained = self._backwards if few else self._forwards
            return states, chained(*derivatives, ends)

    def _backwards(self, by_state: Array, by_controls: Array, ends: Sequence[int]) -> Array:
        """dy(stop)/dλ from the last step to the first: cheap where the stops are few and λ is long."""
        steps, size, inputs = len(by_state), by_state.shape[1], by_controls.shape[2] // 3
        onward = np.zeros((len(ends), size, size))  # dy(stop)/dy at the end of the step
        gradients = np.empty((steps, len(ends) * size, 3 * inputs))
        for k in range(steps - 1, -1, -1):
            for place, end in enumerate(ends):
                if end == k + 1:
                    onward[place] = np.eye(size)
            rows = onward.reshape(-1, size)
            gradients[k] = rows @ by_controls[k]
            onward = (rows @ by_state[k]).reshape(onward.shape)
        by_stage = gradients.reshape(steps, -1, 3, inputs).transpose(1, 3, 2, 0).reshape(-1, 3 * steps)
        derivative = by_stage @ self._stages.reshape(3 * steps, -1)
        return derivative.reshape(len(ends), size, -1)

    def _forwards(self, by_state: Array, by_controls: Array, ends: Sequence[int]) -> Array:
        """The same from the first step to the last: one pass for any number of stops."""
        steps, size, inputs = len(by_state), by_state.shape[1], by_controls.shape[2] // 3
        driven = np.einsum("knjm,jkf->knmf", by_controls.reshape(steps, size, 3, inputs), self._stages)
        driven = driven.reshape(steps, size, -1)
        along = np.zeros((steps + 1, size, driven.shape[2]))
        for k in range(steps):
            along[k + 1] = by_state[k] @ along[k] + driven[k]
        return along[list(ends)]

    def _step_derivatives(self, states: Array, controls: Array) -> tuple[Array, Array]:
        """Derivatives of every step by its first state (steps, n, n) and by its three controls (steps, n, 3 m).

        The scheme is differentiated stage by stage, all steps side by side: K_i = F_i (I + a_i h K_{i-1}), F = ∂f/∂y.
        """
        steps, size, inputs = len(self._h), states.shape[1], controls.shape[2]
        first, middle, last = (np.ascontiguousarray(controls[:, j]) for j in range(3))
        y, h = states[:-1], self._h[:, None]
        rates, points, slope = mapped(self._rate, steps), [y], y
        for offset, control in ((0.5, first), (0.5, middle), (1.0, middle)):
            (slope,) = call(rates, points[-1], control)
            points.append(y + offset * h * slope)
        at = np.concatenate(points), np.concatenate([first, middle, middle, last])
        (linear,) = call(mapped(self._linearised, 4 * steps), *at)
        linear = linear.reshape(4, steps, size + inputs, size).swapaxes(2, 3)
        F, B = linear[..., :size], linear[..., size:]
        step = h[:, :, None]
        by_state, by_controls = np.zeros((steps, size, size)), np.zeros((steps, size, 3 * inputs))
        state_slope, control_slope = np.zeros_like(by_state), np.zeros_like(by_controls)
        for stage, (offset, column, weight) in enumerate(
            ((0.0, 0, 1), (0.5, 1, 2), (0.5, 1, 2), (1.0, 2, 1))
        ):
            state_slope = F[stage] + offset * step * (F[stage] @ state_slope)
            control_slope = offset * step * (F[stage] @ control_slope)
            control_slope[:, :, column * inputs : (column + 1) * inputs] += B[stage]
            by_state += weight * state_slope
            by_controls += weight * control_slope
        return np.eye(size) + step / 6 * by_state, step / 6 * by_controls


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
        self, start: Array, coefficients: Array, stops: Sequence[int] = (-1,)
    ) -> tuple[Array, Array]:
        ends, jacobian = self._jacobian(stops)(start, np.ravel(coefficients))
        states = self.states(start, coefficients)
        states[list(stops)] = np.array(ends).reshape(len(stops), -1)  # the points that were differentiated
        return states, np.array(jacobian).reshape(len(stops), states.shape[1], -1)
