"""What a planner is made of: a problem and a method that it can take, their functions, grids and numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.table import Table
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, flow_through
from nhpocp.flow.integrators import RungeKutta4, RungeKuttaFlow
from nhpocp.flow.runge_kutta import Grid, Scheme, scheme
from nhpocp.flow.step_error import FINER, finer, resolving
from nhpocp.machine.export.planned_path import motors_of
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solver
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose
from nhpocp.solvers.continuation.initial_control import initial_coefficients
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.metrics import CoefficientMetric, L2Metric
from nhpocp.systems.numeric import EXPANDED
from nhpocp.task import Task

ONLY = "the planner in C does without"


@dataclass(frozen=True, eq=False)
class Surface:
    """A matrix whose determinant may not change sign: its name, its size, and where its numbers begin."""

    name: str
    size: int
    first: int


@dataclass(frozen=True, eq=False)
class Parts:
    """A problem and the continuation that plans it, which `Parts.of` has looked at."""

    problem: PlanningProblem
    method: Continuation

    @classmethod
    def of(cls, problem: PlanningProblem, solver: Solver) -> Parts:
        """The parts of a problem and its solver, `Auto` standing for the first of its ways.

        Errors: `InvalidProblemError` for what a planner cannot do, and what to set instead.
        """
        method = solver.continuation if type(solver) is Auto else solver
        if not isinstance(method, Continuation):
            words = f"{type(solver).__name__}; expected one continuation: `starts: 1`, solver jacobian"
            raise InvalidProblemError(words, path="solvers.jacobian.starts")
        parts = cls(problem, method)
        for asked, path, words in _wishes(problem, method):
            if asked:
                raise InvalidProblemError(words, path=path)
        rows, columns = len(parts.task.rows), problem.system.input_space.size * problem.basis.size
        if columns < rows:
            words = f"{columns} coefficients cannot meet {rows} numbers of the goal; take more functions"
            raise InvalidProblemError(words, path="control")
        return parts

    @cached_property
    def task(self) -> Task:
        return self.problem.tasks[-1]

    @cached_property
    def integrator(self) -> RungeKutta4:
        return cast(RungeKutta4, resolving(self.method.integrator, self.problem.basis))

    @cached_property
    def flow(self) -> RungeKuttaFlow:
        return self._flow(self.integrator)

    @cached_property
    def fine(self) -> RungeKuttaFlow:
        """By which what was reached is held against finer steps."""
        return self._flow(cast(RungeKutta4, finer(self.integrator)))

    @cached_property
    def coarse(self) -> RungeKuttaFlow:
        """With as much fewer steps."""
        return self._flow(replace(self.integrator, steps=max(1, self.integrator.steps // FINER)))

    def _flow(self, integrator: RungeKutta4) -> RungeKuttaFlow:
        problem = self.problem
        flow = flow_through(problem.system, problem.basis, problem.horizon.fixed, integrator, ())
        return cast(RungeKuttaFlow, flow)

    @cached_property
    def grids(self) -> dict[str, tuple[Grid, Table]]:
        """The grids of the flows by what their names begin with, and φ where their steps see it, all of one width."""
        grids = {"": self.flow.grid, "FINE_": self.fine.grid, "COARSE_": self.coarse.grid}
        tables = [grid.samples.whole for grid in grids.values()]
        if len({table.values.shape[1] for table in tables}) > 1:
            tables = [Table(table.dense(), table.size) for table in tables]
        return dict(zip(grids, zip(grids.values(), tables, strict=True), strict=True))

    @cached_property
    def scheme(self) -> Scheme:
        return scheme(dynamics(self.problem.system), self.integrator.tableau)

    @cached_property
    def initial(self) -> Array:
        """Λ₀ (inputs × size): the problem's, or the one that its seed draws."""
        problem = self.problem
        horizon, start = problem.horizon.fixed, problem.start_point
        end_point_map = DifferentiatedEndPointMap(
            problem.system, problem.basis, horizon, start, self.integrator
        )
        return initial_coefficients(problem, end_point_map, self.method.seed)

    @cached_property
    def fixed(self) -> list[int]:
        """Which numbers of a packed pose the goal fixes."""
        space = self.problem.system.state_space
        numbers = np.arange(space.size)
        return [int(i) for n in space.names if n in self.task.values for i in numbers[space.point_slice(n)]]

    @cached_property
    def breaking(self) -> list[Surface]:
        """Determinants that no path crosses; those of small matrices are one number each."""
        sizes = self._sizes(self.problem.system.breaking())
        return _placed({name: (size, 1 if size <= EXPANDED else size * size) for name, size in sizes.items()})

    @cached_property
    def separating(self) -> list[Surface]:
        """Determinants that have one sign at start and goal; none where the goal leaves a part of the pose free."""
        names = self.problem.system.separating() if self.problem.goal_is_a_pose else ()
        return _placed({name: (size, size * size) for name, size in self._sizes(names).items()})

    def _sizes(self, names: tuple[str, ...]) -> dict[str, int]:
        system = self.problem.system
        regularity = system.regularity(ca.SX.sym("x", system.state_space.size)) if names else {}
        return {name: int(ca.SX(regularity[name]).size1()) for name in names}

    @cached_property
    def separating_function(self) -> ca.Function:
        """x ↦ the entries of the matrices of `separating`, row by row."""
        x = ca.SX.sym("x", self.problem.system.state_space.size)
        regularity = self.problem.system.regularity(x) if self.separating else {}
        columns = [ca.vec(ca.densify(ca.SX(regularity[each.name])).T) for each in self.separating]
        return ca.Function("separating", [x], ca.cse([ca.vertcat(ca.SX(0, 1), *columns)]))

    @cached_property
    def motors(self) -> list[int]:
        return motors_of(self.problem.system)

    @cached_property
    def joint_labels(self) -> list[str]:
        """As of a `Motion`: the legs with a motor; without legs the numbers of a state without rotations; else none."""
        space = self.problem.system.state_space
        if self.motors:
            return [f"leg_{i + 1}" for i in self.motors]
        return [] if any(block.kind == "rotation" for block in space.blocks) else space.labels

    @cached_property
    def joints(self) -> ca.Function:
        """(x, u) ↦ joints, their rates."""
        system, motors = self.problem.system, self.motors
        x, u = ca.SX.sym("x", system.state_space.size), ca.SX.sym("u", system.input_space.size)
        if motors:
            values = ca.SX(system.output("leg_lengths", x, u))[motors]
        else:
            values = x if self.joint_labels else ca.SX(0, 1)
        rates = ca.jtimes(values, x, ca.densify(ca.SX(system.rate(x, u))))
        return ca.Function("joints", [x, u], ca.cse([ca.densify(values), ca.densify(rates)]))


def _placed(sizes: dict[str, tuple[int, int]]) -> list[Surface]:
    """Surfaces one after another, from sizes and numbers by name."""
    surfaces, first = [], 0
    for name, (size, numbers) in sizes.items():
        surfaces.append(Surface(name, size, first))
        first += numbers
    return surfaces


def _wishes(problem: PlanningProblem, method: Continuation) -> list[tuple[bool, str, str]]:
    """What a planner cannot do: whether it is asked for, where, and what to write instead."""
    rule, inverse, metric = method.step_rule, method.inverse, method.metric
    by_steps = type(method.integrator) is RungeKutta4 and method.sensitivity is DifferentiatedEndPointMap
    here = "solvers.jacobian"
    return [
        (
            type(rule) is not Adaptive,
            f"{here}.step_rule",
            f"{rule.kind}; the planner in C takes the steps of a trust region: `step_rule: adaptive`",
        ),
        (
            type(inverse) is not MoorePenrose,
            f"{here}.inverse",
            f"{inverse.kind}; {ONLY}: `inverse: moore_penrose`",
        ),
        (
            type(metric) not in (CoefficientMetric, L2Metric),
            f"{here}.metric",
            f"{metric.kind}; {ONLY}: `metric: coefficients` or l2",
        ),
        (
            not by_steps,
            f"{here}.integrator",
            f"{method.integrator.kind}; {ONLY}: `integrator: rk4`, `sensitivity: automatic`",
        ),
        (
            method.objective != "none",
            f"{here}.objective",
            f"{method.objective}; the planner in C stops at the goal: `objective: none`",
        ),
        (bool(problem.bounds), "constraints", f"{ONLY} constraints; leave them out"),
        (bool(problem.via), "via", f"{ONLY} via poses; plan from one to the next"),
        (
            bool(problem.tasks[-1].outputs),
            "goal",
            f"{', '.join(o.name for o in problem.tasks[-1].outputs)}; the planner in C takes goals that are poses",
        ),
    ]
