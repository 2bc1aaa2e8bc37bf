"""Integrators of a driven system ẏ = f(y, u), u(t) = Λ φ(t): the end point, the path, and dy(T)/dΛ by CasADi's AD.

All are one kind of object: an `Integrator` makes a `Flow` for a right-hand side, a control basis and a time grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
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

    def sensitivity(self, start: Array, coefficients: Array) -> tuple[Array, Array]:
        """The states as above, and dy(T)/dλ (n, m·size)."""
        ...


class Integrator(Protocol):
    """A way to integrate."""

    kind: ClassVar[str]

    def grid(self, basis: ControlBasis, horizon: float) -> Array:
        """Times at which this integrator's own steps end (the basis's breakpoints among them)."""
        ...

    def flow(
        self, rate: ca.Function, basis: ControlBasis, horizon: float, times: Array | None = None
    ) -> Flow:
        """The flow of ẏ = rate(y, u) with u(t) = Λ φ(t) over [0, horizon], on the given times or on `grid`."""
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
        self, rate: ca.Function, basis: ControlBasis, horizon: float, times: Array | None = None
    ) -> RungeKuttaFlow:
        return RungeKuttaFlow(rate, basis, horizon, self.grid(basis, horizon) if times is None else times)


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

    def __init__(self, rate: ca.Function, basis: ControlBasis, horizon: float, times: Array) -> None:
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
        self._rate = rate
        self._walk = runge_kutta_step(rate).mapaccum(len(self._h))
        self._rates = rate.map(len(self._h))

    @cached_property
    def _linearised(self) -> ca.Function:
        """(y, u) ↦ [∂f/∂y, ∂f/∂u] at the four stages of every step at once."""
        y, u = ca.SX.sym("y", self._rate.size1_in(0)), ca.SX.sym("u", self._rate.size1_in(1))
        jacobian = ca.densify(ca.jacobian(self._rate(y, u), ca.vertcat(y, u)))
        return ca.Function("linearised", [y, u], [jacobian]).map(4 * len(self._h))

    def _stage_controls(self, coefficients: Array) -> Array:
        """u at every stage, m × 3·steps, the three stages of a step side by side."""
        controls = np.einsum("ij,skj->iks", np.asarray(coefficients, dtype=float), self._stages)
        return controls.reshape(len(coefficients), -1)

    def states(self, start: Array, coefficients: Array) -> Array:
        return self._states(np.asarray(start, dtype=float), self._stage_controls(coefficients))

    def _states(self, start: Array, controls: Array) -> Array:
        walked = np.array(self._walk(start, self._h[None, :], controls))
        return np.vstack([start, walked.T])

    def end(self, start: Array, coefficients: Array) -> Array:
        return self.states(start, coefficients)[-1]

    def sensitivity(self, start: Array, coefficients: Array) -> tuple[Array, Array]:
        controls = self._stage_controls(coefficients)
        states = self._states(np.asarray(start, dtype=float), controls)
        size, inputs = states.shape[1], len(coefficients)
        onward = np.eye(size)  # dy(T)/dy at the end of the step
        gradients = np.empty((len(self._h), size, 3 * inputs))
        with np.errstate(all="ignore"):  # a path that runs away is the caller's to judge
            by_state, by_controls = self._step_derivatives(states, controls)
            for k in range(len(self._h) - 1, -1, -1):
                gradients[k] = onward @ by_controls[k]
                onward = onward @ by_state[k]
        stages = gradients.reshape(len(self._h), size, 3, inputs)
        return states, np.einsum("knsm,skj->nmj", stages, self._stages, optimize=True).reshape(size, -1)

    def _step_derivatives(self, states: Array, controls: Array) -> tuple[Array, Array]:
        """Derivatives of every step by its first state (steps, n, n) and by its three controls (steps, n, 3 m).

        The scheme is differentiated stage by stage, all steps side by side: K_i = F_i (I + a_i h K_{i-1}), F = ∂f/∂y.
        """
        steps, size, inputs = len(self._h), states.shape[1], controls.shape[0]
        u = controls.reshape(inputs, steps, 3)
        first, middle, last = (np.ascontiguousarray(u[:, :, j]) for j in range(3))
        y, h = states[:-1].T, self._h
        points, slope = [y], y
        for offset, control in ((0.5, first), (0.5, middle), (1.0, middle)):
            slope = np.array(self._rates(points[-1], control))
            points.append(y + offset * h * slope)
        linear = np.array(self._linearised(np.hstack(points), np.hstack([first, middle, middle, last])))
        linear = linear.reshape(size, 4, steps, size + inputs).transpose(1, 2, 0, 3)
        F, B = linear[..., :size], linear[..., size:]
        step = h[:, None, None]
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
        self, rate: ca.Function, basis: ControlBasis, horizon: float, times: Array | None = None
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

    @cached_property
    def _walk(self) -> ca.Function:
        return ca.integrator(
            "walk", self._plugin, self._problem, self.times[0], self.times[1:], self._options
        )

    @cached_property
    def _end(self) -> ca.Function:
        return ca.integrator("end", self._plugin, self._problem, self.times[0], self.times[-1], self._options)

    @cached_property
    def _jacobian(self) -> ca.Function:
        start, parameters = ca.MX.sym("y0", self._end.size1_in("x0")), ca.MX.sym("p", self._end.size1_in("p"))
        end = self._end(x0=start, p=parameters)["xf"]
        return ca.Function("jacobian", [start, parameters], [end, ca.jacobian(end, parameters)])

    def states(self, start: Array, coefficients: Array) -> Array:
        walked = self._walk(x0=start, p=np.ravel(coefficients))["xf"]
        return np.vstack([start, np.array(walked).T])

    def end(self, start: Array, coefficients: Array) -> Array:
        return np.array(self._end(x0=start, p=np.ravel(coefficients))["xf"]).ravel()

    def sensitivity(self, start: Array, coefficients: Array) -> tuple[Array, Array]:
        end, jacobian = self._jacobian(start, np.ravel(coefficients))
        states = self.states(start, coefficients)
        states[-1] = np.array(end).ravel()  # the point that was differentiated
        return states, np.array(jacobian)
