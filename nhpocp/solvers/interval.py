"""One shooting interval of the NLP as CasADi functions: where it leads, what it costs, what it must respect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints import Bound, bound_rows
from nhpocp.controls.basis import ControlBasis
from nhpocp.objectives import INTEGRANDS
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.meeting import Meeting, basis_table, stage_times
from nhpocp.systems.numeric import numeric_system
from nhpocp.task import Task


class Interval:
    """One shooting interval, symbolically: the same for every k, which enters through parameters."""

    def __init__(
        self,
        problem: PlanningProblem,
        basis: ControlBasis | None,
        steps: int,
        intervals: int,
        bounds: Sequence[Bound],
    ) -> None:
        system, space = problem.system, problem.system.state_space
        self.problem, self.basis, self.steps, self.intervals = problem, basis, steps, intervals
        self.bounds = bounds
        self.free_horizon = problem.horizon.free
        d, m = space.dimension, system.input_space.size
        statics = (m * basis.size if basis else 0) + int(self.free_horizon)
        self.dimension, self.nodes, self.controls = d, d + statics, 0 if basis else m
        self.scales = np.array([problem.scale if unit == "length" else 1.0 for unit in space.tangent_units])
        w = ca.SX.sym("w", self.nodes + self.controls)
        here, there = ca.SX.sym("here", space.size), ca.SX.sym("there", space.size)
        tables = ca.SX.sym("phi", basis.size if basis else 0, 2 * steps + 1)
        horizon = self._horizon(w)
        controls, self._rate = self._stage_controls(w, tables), numeric_system(system).rate_function
        state = space.chart(self.scales * w[:d], here)
        points, cost = [(0.0, state, controls[0])], 0.0
        h = horizon / (intervals * steps)
        for j in range(steps):
            state, share = self._step(state, h, controls[2 * j : 2 * j + 3])
            cost += share
            points.append(((j + 1) / steps, state, controls[2 * j + 2]))
        self.rows, expressions = self._path_rows(bounds, points, w[d:])
        if self.free_horizon:
            self.rows.append(
                ("horizon", problem.horizon.minimum or 0.0, problem.horizon.maximum or np.inf, 0.0)
            )
            expressions.append(ca.SX(horizon))
        after = space.coordinates(state, there) / self.scales
        # continuity as s_{k+1} - F_k = 0, the sign that fatrop asks for
        outputs = ca.vertcat(-after, -w[d : self.nodes], *expressions)
        parameters = ca.vertcat(here, there, ca.vec(tables))
        self._make_functions(w, parameters, outputs, self._cost(w, controls, horizon, cost))

    def _horizon(self, w: ca.SX) -> Any:
        return w[self.nodes - 1] if self.free_horizon else self.problem.horizon.fixed

    def meeting(self, task: Task, stage: int, offset: float, reference: Array) -> Meeting:
        """A task's equations at a place inside interval ``stage``, reached by the interval's own steps.

        The last of them is cut short where the place lies within it.
        """
        space, size = self.problem.system.state_space, self.basis.size if self.basis else 0
        w, here = ca.SX.sym("w", self.nodes + self.controls), ca.SX.sym("here", space.size)
        shares = stage_times(offset, self.steps)
        tables = ca.SX.sym("phi", size, len(shares))
        controls, horizon = self._stage_controls(w, tables), self._horizon(w)
        state = space.chart(self.scales * w[: self.dimension], here)
        for j in range(0, len(shares) - 1, 2):
            h = (shares[j + 2] - shares[j]) * horizon / self.intervals
            state, _ = self._step(state, h, controls[j : j + 3])
        parameters = [reference]
        if self.basis:
            parameters.append(basis_table(self.basis, (stage + shares) / self.intervals).ravel())
        labels = [*(space.tangent_labels[i] for i in task.rows), *task.output_labels]
        return Meeting(
            stage=stage,
            time=task.share,
            names=[f"via pose at {task.share:g}: {label}" for label in labels],
            w=w,
            p=ca.vertcat(here, ca.vec(tables)),
            rows=ca.SX(ca.vertcat(*task.equations(state))),
            parameters=np.concatenate(parameters),
        )

    def last_meeting(self, task: Task, reference: Array) -> Meeting:
        """The equations of a task's outputs at the last node."""
        space = self.problem.system.state_space
        s, here = ca.SX.sym("s", self.nodes), ca.SX.sym("here", space.size)
        state = space.chart(self.scales * s[: self.dimension], here)
        names = [f"goal of {label}" for label in task.output_labels]
        rows = ca.SX(ca.vertcat(*task.output_equations(state)))
        return Meeting(self.intervals, task.share, names, s, here, rows, reference)

    def _stage_controls(self, w: ca.SX, tables: ca.SX) -> list[ca.SX]:
        if self.basis is None:
            return [w[self.nodes :]] * tables.size2()
        inputs = self.problem.system.input_space.size
        first = self.dimension
        coefficients = ca.reshape(w[first : first + inputs * self.basis.size], self.basis.size, inputs).T
        return [coefficients @ tables[:, j] for j in range(tables.size2())]

    def _step(self, state: ca.SX, h: Any, u: Sequence[ca.SX]) -> tuple[ca.SX, Any]:
        """One RK4 step, and the objective's share by the same quadrature."""
        rate, cost = self._rate, self._integrand
        k1 = rate(state, u[0])
        x2 = state + 0.5 * h * k1
        k2 = rate(x2, u[1])
        x3 = state + 0.5 * h * k2
        k3 = rate(x3, u[1])
        x4 = state + h * k3
        k4 = rate(x4, u[2])
        share = h / 6 * (cost(state, u[0]) + 2 * cost(x2, u[1]) + 2 * cost(x3, u[1]) + cost(x4, u[2]))
        return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), share

    def _integrand(self, state: ca.SX, control: ca.SX) -> Any:
        name = self.problem.objective
        if name in ("effort", "time"):  # exact without quadrature
            return 0.0
        return INTEGRANDS[name](self.problem.system, state, control, self.problem.scale)

    def _cost(self, w: ca.SX, controls: Sequence[ca.SX], horizon: Any, quadrature: Any) -> Any:
        if self.problem.objective == "time":
            return horizon / self.intervals
        if self.problem.objective != "effort":
            return quadrature
        if self.basis is None:
            return horizon / self.intervals * ca.sumsqr(w[self.nodes :])
        inputs, size = self.problem.system.input_space.size, self.basis.size
        coefficients = w[self.dimension : self.dimension + inputs * size]
        gram = ca.DM(np.kron(np.eye(inputs), self.basis.gram(1.0)))  # ∫₀ᵀ = T ∫₀¹
        return horizon / self.intervals * (coefficients.T @ gram @ coefficients)

    def _path_rows(
        self, bounds: Sequence[Bound], points: Sequence[tuple[float, ca.SX, ca.SX]], chosen: ca.SX
    ) -> tuple[list[tuple[str, float, float, float]], list[ca.SX]]:
        """Rows at the end of every step, and at the interval's start where the control makes a quantity jump.

        ``chosen``: the variables that set the control.
        """
        rows, expressions = [], []
        for bound in bounds:
            for share, state, control in points:
                found = bound_rows(bound, self.problem.system, state, control, self.problem.scale)
                for name, expression, lower, upper in found:
                    if share == 0.0 and not ca.depends_on(ca.SX(expression), chosen):
                        continue
                    if share < 1.0 and lower == upper:
                        continue  # one control cannot hold an equation at several times
                    rows.append((name, lower, upper, share))
                    expressions.append(expression)
        return rows, expressions

    def _make_functions(self, w: ca.SX, parameters: ca.SX, outputs: ca.SX, cost: Any) -> None:
        multipliers, weight = ca.SX.sym("lam", outputs.numel()), ca.SX.sym("sigma")
        cost = ca.SX(cost)
        # apart, since IPOPT asks for f and for g apart
        self.cost = ca.Function("cost", [w, parameters], [cost])
        self.value = ca.Function("value", [w, parameters], [cost, ca.densify(outputs)])
        gradient = ca.densify(ca.gradient(cost, w))
        self.gradient = ca.Function("gradient", [w, parameters], [cost, gradient])
        jacobian = ca.densify(ca.jacobian(outputs, w))
        self.jacobian = ca.Function("jacobian", [w, parameters], [ca.densify(outputs), jacobian])
        hessian = ca.hessian(weight * cost + ca.dot(multipliers, outputs), w)[0]
        self.hessian = ca.Function("hessian", [w, parameters, weight, multipliers], [ca.densify(hessian)])
