r"""A task as a nonlinear programme on a grid of intervals: what single and multiple shooting have in common.

Interval k is `Interval`'s: RK4 from node to node under its control u_k, in local coordinates z_k about a reference pose
x̄_k, with the static variables c (coefficients of a basis, a free horizon).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.compiled.kernels import Kernels
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.nlp.interval import UNITS, interval_of, units_of
from nhpocp.solvers.nlp.task_rows import TaskRows, place


@dataclass(frozen=True)
class Guess:
    """States (N + 1, size) at the nodes and a control; what an NLP starts from."""

    states: Array
    control: Control
    origin: Solution | None = None  # whose control it is


@dataclass(frozen=True)
class Row:
    """One scalar constraint: its name for people, its bounds, and the time it is about."""

    name: str
    lower: float
    upper: float
    time: float  # fraction of the horizon
    stated: bool = False  # by the problem file, not by the transcription
    unit: float = 1.0  # what counts as 1 in it: the bounds are in multiples of it


class Transcription(ABC):
    """The whole NLP on one grid, about the reference poses of one guess."""

    size: int  # variables

    def __init__(
        self,
        problem: PlanningProblem,
        guess: Guess,
        basis: ControlBasis | None,
        intervals: int,
        steps: int,
        bounds: Sequence[Bound],
        kernels: Kernels,
        softening: float | None = None,
    ) -> None:
        self.problem, self.basis, self.intervals, self.steps = problem, basis, intervals, steps
        self.guess, self.kernels = guess, kernels
        self.interval = interval_of(problem, basis, steps, bounds)
        self.units = units_of(problem, bounds, softening)
        self.references = self._references(guess)
        self.terminal = problem.tasks[-1].rows
        self._shape()
        self.rows = self._rows()

    @abstractmethod
    def _shape(self) -> None:
        """Sets ``size`` and what else `_rows` needs."""

    @abstractmethod
    def _rows(self) -> list[Row]:
        """Every constraint in order."""

    @property
    @abstractmethod
    def nlp(self) -> ca.Function:
        """x ↦ f, g, which CasADi can differentiate."""

    @property
    @abstractmethod
    def functions(self) -> dict[str, Any]:
        """nlp (x ↦ f, g) and what derivatives there are, with the signatures that CasADi's nlpsol takes."""

    @abstractmethod
    def pack(self, guess: Guess) -> Array:
        """x of a guess whose control is sampled at the intervals' middles, or given over the basis."""

    @abstractmethod
    def _stages(self, x: Array) -> tuple[Array, Array]:
        """Variables w_k (N, stage) and local coordinates of the nodes (N + 1, dimension) of a vector x."""

    @property
    def structure(self) -> dict[str, Any] | None:
        """Stage sizes for solvers that ask for them (fatrop); None where there are no stages."""
        return None

    def note(self, seconds: float) -> None:  # noqa: B027
        """Takes down what a solve of this programme has cost, where there is a kernel to be built."""

    def costates(self, x: Array, multipliers: Array) -> Array | None:
        """p (N, dimension) at nodes 1…N, per unit of each tangent number: lengths, and radians in base coordinates.

        The optimum changes by -p_k·δ where the path is set off by δ on arriving at node k, and by p_N·δ where the goal
        moves by δ: p is the gradient of the cost of arriving. None where the path is rolled out from the start.
        """
        return None

    def _references(self, guess: Guess) -> Array:
        """x̄_k: the guess's own poses, but the start's and the goal's exactly."""
        space = self.problem.system.state_space
        references = space.nearest(guess.states)
        references[0] = self.problem.start_point
        for name in space.names:
            if name in self.problem.goal:
                references[-1, space.point_slice(name)] = np.ravel(self.problem.goal[name])
        return references

    @cached_property
    def meetings(self) -> list[TaskRows]:
        """What the tasks add to single stages, in the order of time: via poses, then the goal's outputs."""
        *via, goal = self.problem.tasks
        meetings = []
        for task in via:
            stage, offset = place(task.share, self.intervals)
            meetings.append(
                self.interval.meeting(task, stage, offset, self.references[stage], self.intervals, self.units)
            )
        if goal.outputs:
            meetings.append(self.interval.last_meeting(goal, self.references[-1], self.intervals, self.units))
        return meetings

    @property
    def _met_last(self) -> list[TaskRows]:
        return [meeting for meeting in self.meetings if meeting.stage == self.intervals]

    def _met(self, stage: int) -> list[Row]:
        return [
            Row(name, 0.0, 0.0, meeting.time)
            for meeting in self.meetings
            if meeting.stage == stage
            for name in meeting.names
        ]

    @property
    def _fixed(self) -> set[str]:
        """Labels of the bounds on blocks of the state and on outputs that the goal fixes."""
        return {bound.label for bound in self.interval.bounds if bound.quantity in self.problem.goal}

    @cached_property
    def parameters(self) -> Array:
        """p_k as columns."""
        pairs = pairwise(self.references)
        columns = [np.array([self.interval.constants(*pair, self.intervals, self.units) for pair in pairs]).T]
        if self.basis:
            edges = np.linspace(0.0, 1.0, self.intervals + 1)
            fractions = self.interval.shot.tableau.times(np.linspace(0.0, 1.0, self.steps + 1))
            seen = [low + (high - low) * fractions for low, high in pairwise(edges)]
            columns.append(np.array([self.interval.table(times).ravel() for times in seen]).T)
        return np.vstack(columns)

    def _stated(self, k: int) -> list[Row]:
        """Rows of the bounds in interval k.

        Those that the goal decides go free: an equation that is stated twice has no rank, and a bound that touches the
        goal leaves no interior; whether the goal keeps its bounds is asked before.
        """
        whole = len(self.terminal) == self.interval.dimension
        rows = []
        for row in self.interval.rows:
            last = k == self.intervals - 1 and row.fraction == 1.0
            given = last and ((whole and row.of_pose) or row.name.partition("[")[0] in self._fixed)
            unit = float(self.units[row.unit])
            bounds = (-np.inf, np.inf) if given else (row.lower / unit, row.upper / unit)
            rows.append(Row(row.name, *bounds, (k + row.fraction) / self.intervals, stated=True, unit=unit))
        return rows

    @property
    def cost_unit(self) -> float:
        """What counts as 1 in the objective."""
        return float(self.units[UNITS.index("cost")])

    @property
    def lower(self) -> Array:
        return np.array([row.lower for row in self.rows])

    @property
    def upper(self) -> Array:
        return np.array([row.upper for row in self.rows])

    def _statics(self, control: Control) -> list[float]:
        """c of a control."""
        scales = self.problem.scales
        statics = list((control.coefficients / scales.inputs[:, None]).ravel()) if self.basis else []
        return [*statics, control.horizon / scales.time] if self.interval.free_horizon else statics

    def unpack(self, x: Array) -> Guess:
        """The node states and the control of a vector x, its horizon within its bounds exactly."""
        d, (stages, locals_) = self.interval.dimension, self._stages(x)
        states = self.interval.points(locals_, self.references, self.units)
        horizon, pace = self._horizon(stages)
        scales = pace * self.problem.scales.inputs[:, None]
        if self.basis:
            inputs = self.problem.system.input_space.size
            coefficients = stages[0, d : d + inputs * self.basis.size].reshape(inputs, self.basis.size)
            return Guess(states, Control(self.basis, scales * coefficients, horizon))
        values = scales * stages[:, self.interval.nodes :].T
        return Guess(states, Control(PiecewiseConstant(self.intervals), values, horizon))

    def _horizon(self, stages: Array) -> tuple[float, float]:
        """T, and by how much faster the controls must be for the same path where T was not within its bounds."""
        if not self.interval.free_horizon:
            return self.problem.horizon.fixed, 1.0
        duration = float(stages[0, self.interval.nodes - 1]) * self.problem.scales.time
        horizon = self.problem.horizon.kept(duration)
        return horizon, duration / horizon if self.problem.system.driftless else 1.0
