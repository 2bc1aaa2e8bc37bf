"""One shooting interval of the NLP as CasADi functions: where it leads, what it costs, what it must respect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.constraints.bound import Bound, bound_rows
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.shot import Shot, part
from nhpocp.horizon import Horizon
from nhpocp.kept import kept
from nhpocp.objectives.objective import ControlObjective, PathObjective
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.nlp.task_rows import TaskRows, basis_table, stage_knots
from nhpocp.state_space import StateSpace
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System
from nhpocp.task import Task

# instructions of all intervals that are kept, whatever their system: a thousand take 3.5 MB; and as
# how many an interval counts besides, for what it keeps of its system
MOST, BESIDES = 56_000, 8_000
# what counts as 1, and the cost by which the objective is softened; one for every bound follows
UNITS = ("length", "number", "time", "cost", "soft")
# rows of a bound within an interval, at most: more steps than these integrate it well, but rows make most of an
# iteration's work, and bounds broken between them are tightened
LOOKS = 4
STEADY = 1e-4  # of a path's length: what keeps a horizon in which that is the same near its first value


@dataclass(frozen=True)
class StatedRow:
    """A bound on one component of a quantity at one place of the interval."""

    name: str
    lower: float  # in the quantity's own unit, which the NLP does not see
    upper: float
    fraction: float  # of the interval
    unit: int  # where what counts as 1 in it stands among the units
    of_pose: bool  # whatever the control


@dataclass(frozen=True)
class Kind:
    """All that tells the intervals of one system apart: neither start, goal, guess nor N is among it."""

    objective: str
    scale: float
    horizon: Horizon
    basis: ControlBasis | None
    steps: int
    sides: tuple[tuple[str, ...], ...]  # of the bounds, by which they are compared
    bounds: Sequence[Bound] = field(compare=False)


class Interval:
    """One shooting interval, symbolically: the same for every k, N and unit, which enter through parameters.

    ``shot``: its functions of w_k = (z_k, c, u_k), numbers without unit. The constants of its parameters are
    the reference poses at its ends, the lengths of an interval and of a step, fractions of the horizon where that is
    free, else times, and what counts as 1 (`units_of`).
    """

    def __init__(self, system: System, kind: Kind) -> None:
        space, basis = system.state_space, kind.basis
        self.system, self.kind = system, kind
        self.basis, self.steps, self.bounds = basis, kind.steps, kind.bounds
        self.free_horizon = kind.horizon.free
        d, m = space.dimension, system.input_space.size
        self.statics = (m * basis.size if basis else 0) + int(self.free_horizon)
        self.dimension, self.nodes, self.controls = d, d + self.statics, 0 if basis else m
        self.sees_slopes = basis is not None and any(b.quantity == LEG_ACCELERATIONS for b in self.bounds)
        self.seen = (1 + self.sees_slopes) * (basis.size if basis else 0)
        self.rows: list[StatedRow] = []
        self.shot = self._shot()

    def _shot(self) -> Shot:
        system, space = self.system, self.system.state_space
        z = ca.SX.sym("z", self.dimension)
        y = ca.SX.sym("y", space.size + 1)  # the state, then the cost so far
        s = ca.SX.sym("s", self.statics + self.controls)
        here, there = ca.SX.sym("here", space.size), ca.SX.sym("there", space.size)
        interval, step = ca.SX.sym("interval"), ca.SX.sym("step")
        phi = ca.SX.sym("phi", self.seen)
        units = ca.SX.sym("units", len(UNITS) + len(self.bounds))
        constants = ca.vertcat(here, there, interval, step, units)
        state, control = y[:-1], self._control(s, phi, units)
        time, scales = units[UNITS.index("time")], self._scales(space, units)
        horizon = time * s[self.statics - 1] if self.free_horizon else 1.0
        rate = numeric_system(system).rate_function(state, control)
        rest = units[UNITS.index("soft")] / (horizon if self.free_horizon else time)
        slope = step * horizon * ca.vertcat(rate, self._integrand(state, control, rest))
        after = space.coordinates(state, there) / scales
        control_rate = self._control_rate(
            s, phi, units, horizon if self.free_horizon else self.kind.horizon.fixed
        )
        places, expressions = self._path_rows(state, control, control_rate, s, units)
        if self.free_horizon:
            self.rows.append(StatedRow("horizon", *self.kind.horizon.range, 0.0, UNITS.index("time"), False))
            places = np.hstack([places, np.full((len(places), 1), -1)])
            places[-1, -1] = self.nodes + len(self.rows) - 1
            expressions.append(horizon / time)
        # continuity as s_{k+1} - F_k = 0, the sign that fatrop asks for
        cost = self._cost(s, interval * horizon, y[-1], units) / units[UNITS.index("cost")]
        closed = ca.vertcat(cost, -after, -s[: self.statics, :])
        first, others = (z, s, constants, phi), (y, s, constants, phi)
        opened = ca.vertcat(space.chart(scales * z, here), 0)
        return Shot(
            part("opened", first, opened),
            part("slope", others, slope),
            part("rows", others, ca.vertcat(*expressions)),
            part("closed", others, closed),
            places,
        )

    def constants(self, here: Array, there: Array, intervals: int, units: Array) -> Array:
        """c of one of so many intervals between two reference poses."""
        length = (1.0 if self.free_horizon else self.kind.horizon.fixed) / intervals
        return np.concatenate([here, there, [length, length / self.steps], units])

    def points(self, z: Array, references: Array, units: Array) -> Array:
        """The states (k, size) with local coordinates (k, dimension) about references (k, size)."""
        return self._at_nodes(self.shot.opened, z, references, units)[:, :-1]

    def coordinates(self, states: Array, references: Array, units: Array) -> Array:
        """The local coordinates (k, dimension) of states (k, size); `points` undone."""
        y = np.hstack([states, np.zeros((len(states), 1))])
        return -self._at_nodes(self.shot.closed, y, references, units)[:, 1 : 1 + self.dimension]

    def _at_nodes(self, part: ca.Function, y: Array, references: Array, units: Array) -> Array:
        """A part of the shot at many poses, where nothing but the pose matters."""
        k, (_, s, _, phi) = len(y), (part.size1_in(i) for i in range(4))
        constants = np.array([self.constants(reference, reference, 1, units) for reference in references])
        return call(mapped(part, k), y, np.zeros((k, s)), constants, np.zeros((k, phi)))[0]

    def meeting(
        self, task: Task, stage: int, offset: float, reference: Array, intervals: int, units: Array
    ) -> TaskRows:
        """A task's equations at a place inside interval ``stage``, reached by the interval's own steps.

        The last of them is cut short where the place lies within it.
        """
        space, size = self.system.state_space, self.seen
        w, here = ca.SX.sym("w", self.nodes + self.controls), ca.SX.sym("here", space.size)
        z, s = w[: self.dimension, :], w[self.dimension :, :]
        knots, tableau = stage_knots(offset, self.steps), self.shot.tableau
        fractions = tableau.times(knots)
        tables = ca.SX.sym("phi", size, len(fractions))
        phi = ca.horzsplit(tables)
        length = (1.0 if self.free_horizon else self.kind.horizon.fixed) / intervals
        y = self.shot.opened(z, s, ca.vertcat(here, here, 0, 0, units), phi[0])
        for j, step in enumerate(np.diff(knots)):
            constants = ca.vertcat(here, here, length, step * length, units)
            y = self.shot.step(y, s, constants, phi[tableau.samples(j) - 1 : tableau.samples(j + 1)])
        parameters = [reference]
        if self.basis:
            parameters.append(self.table((stage + fractions) / intervals).ravel())
        labels = [*(space.tangent_labels[i] for i in task.rows), *task.output_labels]
        return TaskRows(
            stage=stage,
            time=task.share,
            names=[f"via pose at {task.share:g}: {label}" for label in labels],
            w=w,
            p=ca.vertcat(here, ca.vec(tables)),
            rows=ca.SX(ca.vertcat(*task.equations(y[:-1]))),
            parameters=np.concatenate(parameters),
        )

    def last_meeting(self, task: Task, reference: Array, intervals: int, units: Array) -> TaskRows:
        """The equations of a task's outputs at the last node."""
        space = self.system.state_space
        s, here = ca.SX.sym("s", self.nodes), ca.SX.sym("here", space.size)
        state = space.chart(self._scales(space, units) * s[: self.dimension, :], here)
        names = [f"goal of {label}" for label in task.output_labels]
        rows = ca.SX(ca.vertcat(*task.output_equations(state)))
        return TaskRows(intervals, task.share, names, s, here, rows, reference)

    def _scales(self, space: StateSpace, units: Any) -> Any:
        """What counts as 1 in each tangent number of a space."""
        ones = {"length": units[UNITS.index("length")], "angle": 1.0, "": units[UNITS.index("number")]}
        return ca.vertcat(ca.SX(0, 1), *(ones[unit] for unit in space.tangent_units))

    def _input_scales(self, units: Any) -> Any:
        return self._scales(self.system.input_space, units) / units[UNITS.index("time")]

    def _control(self, s: ca.SX, phi: ca.SX, units: ca.SX) -> ca.SX:
        """u of the variables s, with φ of its time."""
        if self.basis is None:
            # with one index, nothing of one number is a row to CasADi
            return self._input_scales(units) * s[self.statics :, :]
        inputs = self.system.input_space.size
        coefficients = ca.reshape(s[: inputs * self.basis.size, :], self.basis.size, inputs).T
        return self._input_scales(units) * (coefficients @ phi[: self.basis.size])

    def _control_rate(self, s: ca.SX, phi: ca.SX, units: ca.SX, horizon: Any) -> ca.SX | None:
        """du/dt of the variables s, with dφ of its time; None where nothing takes it."""
        if self.basis is None or not self.sees_slopes:
            return None
        return self._control(s, phi[self.basis.size :], units) / horizon

    def table(self, shares: Array) -> Array:
        """What an interval sees of the basis at shares of the horizon, (k, seen): φ, and dφ by the share."""
        if self.basis is None:
            return np.zeros((len(shares), 0))
        return basis_table(self.basis, shares, self.sees_slopes)

    def _integrand(self, state: ca.SX, control: ca.SX, rest: ca.SX) -> Any:
        objective = OBJECTIVES[self.kind.objective]
        if not isinstance(objective, PathObjective):  # exact without quadrature
            return 0.0
        return objective.searched(self.system, state, control, self.kind.scale, rest)

    def _cost(self, s: ca.SX, length: Any, quadrature: ca.SX, units: ca.SX) -> Any:
        """q of an interval of that length in time."""
        objective = OBJECTIVES[self.kind.objective]
        if isinstance(objective, ControlObjective):
            return length * self._quadratic(objective, s, units)
        if not isinstance(objective, PathObjective):
            return length
        if objective.pace == 0 and self.free_horizon:
            ratio = s[self.statics - 1]  # of T to its first value
            return quadrature * (1.0 + STEADY * (ratio + 1.0 / ratio - 2.0))
        return quadrature

    def _quadratic(self, objective: ControlObjective, s: ca.SX, units: ca.SX) -> Any:
        """Σ λᵀ M λ / T over the basis, or over the one value of this interval."""
        inputs, basis = self.system.input_space.size, self.basis or PiecewiseConstant(1)
        first, size = 0 if self.basis else self.statics, basis.size
        coefficients = s[first : first + inputs * size, :] * _each(self._input_scales(units), size)
        # M of T is T^(pace + 2) times that of 1
        gram = ca.DM(np.kron(np.eye(inputs), np.asarray(objective.gram(basis, 1.0))))
        value = coefficients.T @ gram @ coefficients
        if objective.pace == -1:
            return value
        free = self.free_horizon
        horizon = units[UNITS.index("time")] * s[self.statics - 1] if free else self.kind.horizon.fixed
        return horizon ** (objective.pace + 1) * value

    def _path_rows(
        self, state: ca.SX, control: ca.SX, control_rate: ca.SX | None, chosen: ca.SX, units: ca.SX
    ) -> tuple[Array, list[Any]]:
        """Rows at the ends of steps, and at the interval's start where the control makes a quantity jump.

        ``chosen``: the variables that set the control. The places among the outputs that `Shot` wants, and expressions.
        """
        system, scale, expressions, columns = self.system, self.kind.scale, [], []
        for number, bound in enumerate(self.bounds, len(UNITS)):
            of_bound = bound_rows(bound, system, state, control, scale, control_rate)
            places = np.full((self.steps + 1, len(of_bound)), -1)
            for j in range(self.steps + 1):
                for i, (name, expression, lower, upper) in enumerate(of_bound):
                    of_pose = not ca.depends_on(ca.SX(expression), chosen)
                    if j == 0 and of_pose:
                        continue
                    if j < self.steps and (lower == upper or j % -(-self.steps // LOOKS)):
                        continue  # one control cannot hold an equation at several times
                    places[j, i] = self.nodes + len(self.rows)
                    self.rows.append(StatedRow(name, lower, upper, j / self.steps, number, of_pose))
            columns.append(places)
            expressions += [expression / units[number] for _, expression, _, _ in of_bound]
        return np.hstack([np.zeros((self.steps + 1, 0), dtype=int), *columns]), expressions


def _each(scales: ca.SX, size: int) -> ca.SX:
    """Every scale, repeated for so many coefficients."""
    return ca.vec(ca.repmat(scales.T, size, 1))


def units_of(problem: PlanningProblem, bounds: Sequence[Bound], softening: float | None = None) -> Array:
    """What counts as 1 in a problem, in the order of `UNITS`, then in each of its bounds; minors have no unit.

    ``softening``: of the objective's; its last unless given.
    """
    scales, objective = problem.scales, OBJECTIVES[problem.objective]
    cost = objective.scale(scales)
    soft = cost * (objective.softenings[-1] if softening is None else softening)
    own = [scales.length, scales.number, scales.time, cost, soft]
    return np.array([*own, *(1.0 if b.margin else b.scale for b in bounds)])


def interval_of(
    problem: PlanningProblem, basis: ControlBasis | None, steps: int, bounds: Sequence[Bound]
) -> Interval:
    """The `Interval`, made once for all problems of its `Kind`."""
    sides = tuple(
        (bound.label, bound.quantity, *(repr(np.asarray(x).tolist()) for x in (bound.lower, bound.upper)))
        for bound in bounds
    )
    kind = Kind(problem.objective, problem.scale, problem.horizon, basis, steps, sides, tuple(bounds))
    return _made(problem.system, kind)


@kept(most=MOST, size=lambda interval: BESIDES + interval.shot.length)
def _made(system: System, kind: Kind) -> Interval:
    return Interval(system, kind)
