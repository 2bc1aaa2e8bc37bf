"""What an NLP starts from: a path and a control made from the problem, from another solver, or from a straight line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Solver
from nhpocp.solvers.initial_control import seeded_coefficients
from nhpocp.solvers.transcription import Guess
from nhpocp.systems.numeric import NumericSystem

STEPS_PER_INTERVAL = 4


class GuessMaker(Protocol):
    """Makes the first guess of an NLP over a basis, with node states at the ends of equal intervals."""

    kind: ClassVar[str]

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        """A control over any basis; the guess projects it and follows it."""
        ...


def make_guess(
    maker: GuessMaker,
    problem: PlanningProblem,
    basis: ControlBasis | None,
    intervals: int,
    seed: int,
    numeric: NumericSystem | None = None,
) -> Guess:
    """The guess of a maker over ``basis`` (None: piecewise constant), simulated.

    Errors: `InvalidProblemError` where the simulation is not finite.
    """
    horizon = starting_horizon(problem)
    control = maker.control(problem, horizon, seed)
    wanted = basis or PiecewiseConstant(intervals)
    if control.basis != wanted:
        control = project(control, wanted)
    states = follow(problem, control, intervals, STEPS_PER_INTERVAL, numeric)
    if not np.isfinite(states).all():
        raise InvalidProblemError(
            f"the path under the {maker.kind} guess is not finite; try another control.initial, or "
            "solvers.nlp.initial: straight",
            path="control.initial" if maker.kind == "problem" else "solvers.nlp.initial",
        )
    return Guess(states, control)


def starting_horizon(problem: PlanningProblem) -> float:
    """T to begin with: the problem's own, or the middle of a free one's range."""
    horizon = problem.horizon
    if horizon.initial is not None:
        return horizon.initial
    low, high = horizon.minimum, horizon.maximum
    if low is not None and high is not None:
        return 0.5 * (low + high)
    return low if low is not None else high if high is not None else 1.0


def follow(
    problem: PlanningProblem,
    control: Control,
    intervals: int,
    steps: int,
    numeric: NumericSystem | None = None,
) -> Array:
    """States (intervals + 1, size) at the nodes under a control, by RK4 with ``steps`` per interval."""
    numeric = numeric or NumericSystem(problem.system)
    times = np.linspace(0.0, control.horizon, intervals * steps + 1)
    flow = RungeKutta4().flow(numeric.rate_function, control.basis, control.horizon, times)
    return flow.states(problem.start_point, control.coefficients)[::steps]


@dataclass(frozen=True)
class ProblemGuess:
    """The problem's own initial control; for the second and later starts a seeded one."""

    kind: ClassVar[str] = "problem"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        if problem.initial is not None and not seed:
            return Control(problem.basis, problem.initial, horizon)
        end_point_map = DifferentiatedEndPointMap(
            problem.system, problem.basis, horizon, problem.start_point, RungeKutta4()
        )
        return Control(problem.basis, seeded_coefficients(problem, end_point_map, seed), horizon)


@dataclass(frozen=True)
class SolverGuess:
    """The control that another solver finds. Errors: `InvalidProblemError` if it finds none."""

    solver: Solver
    kind: ClassVar[str] = "jacobian"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        solution = self.solver.solve(problem)
        if solution.outcome is not Outcome.CONVERGED:
            raise InvalidProblemError(
                f"the {self.solver.name} solver, whose solution was to be the guess, ended as "
                f"{solution.outcome.value}: {solution.message}",
                path="solvers.nlp.initial",
            )
        return solution.control


@dataclass(frozen=True)
class StraightGuess:
    """The geodesic from start to goal at constant speed, with the control that comes nearest to following it."""

    pieces: int = 50
    kind: ClassVar[str] = "straight"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        system, space = problem.system, problem.system.state_space
        tangent = space.difference(problem.goal_point, problem.start_point)
        controls = []
        for share in (np.arange(self.pieces) + 0.5) / self.pieces:
            state = np.asarray(space.retract(problem.start_point, share * tangent))
            fields = np.asarray(system.vector_fields(state))
            controls.append(np.linalg.lstsq(fields, tangent / horizon, rcond=None)[0])
        return Control(PiecewiseConstant(self.pieces), np.array(controls).T, horizon)
