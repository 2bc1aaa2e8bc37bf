"""What an NLP starts from: a path and a control made from the problem, from another solver, or from a straight line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.errors import InvalidProblemError, OrientationAtPiError
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem import Horizon, PlanningProblem
from nhpocp.solution import Outcome, Solver
from nhpocp.solvers.initial_control import NoStartError, seeded_coefficients
from nhpocp.solvers.transcription import Guess
from nhpocp.systems.numeric import numeric_system

STEPS_PER_INTERVAL = 4


class NoGuessError(InvalidProblemError):
    """A guess that cannot be made; ``outcome`` is how a solve ends that needed it."""

    def __init__(self, message: str, outcome: Outcome, path: str) -> None:
        super().__init__(message, path=path)
        self.outcome = outcome


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
) -> Guess:
    """The guess of a maker over ``basis`` (None: piecewise constant), simulated.

    Errors: `NoGuessError` where there is none, or its simulation is not finite.
    """
    horizon = starting_horizon(problem)
    control = maker.control(problem, horizon, seed)
    wanted = basis or PiecewiseConstant(intervals)
    if control.basis != wanted:
        control = project(control, wanted)
    states = follow(problem, control, intervals, STEPS_PER_INTERVAL)
    if not np.isfinite(states).all():
        raise NoGuessError(
            f"the path under the {maker.kind} guess is not finite; try another control.initial, or "
            "solvers.nlp.initial: straight",
            Outcome.NOT_FINITE,
            "control.initial" if maker.kind == "problem" else "solvers.nlp.initial",
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
) -> Array:
    """States (intervals + 1, size) at the nodes under a control, by RK4 with ``steps`` per interval."""
    times = np.linspace(0.0, control.horizon, intervals * steps + 1)
    flow = RungeKutta4().flow(
        numeric_system(problem.system).rate_function, control.basis, control.horizon, times
    )
    return flow.states(problem.start_point, control.coefficients)[::steps]


def held(problem: PlanningProblem, horizon: float) -> PlanningProblem:
    """The problem with its horizon held, for those who cannot choose it."""
    return replace(problem, horizon=Horizon(horizon)) if problem.horizon.free else problem


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
        try:
            coefficients = seeded_coefficients(held(problem, horizon), end_point_map, seed)
        except NoStartError as error:
            raise NoGuessError(error.message, Outcome.RANK_DEFICIENT, "control.initial") from error
        return Control(problem.basis, coefficients, horizon)


@dataclass(frozen=True)
class SolverGuess:
    """The control that another solver finds; without one the NLP ends as that solver did."""

    solver: Solver
    kind: ClassVar[str] = "jacobian"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        solution = self.solver.solve(held(problem, horizon))
        if solution.outcome is not Outcome.CONVERGED:
            raise NoGuessError(
                f"the {self.solver.name} solver, whose solution was to be the guess, ended as "
                f"{solution.outcome.value}: {solution.message}",
                solution.outcome,
                "solvers.nlp.initial",
            )
        return solution.control


@dataclass(frozen=True)
class StraightGuess:
    """The geodesic from start to goal at constant speed, with the control that comes nearest to following it."""

    pieces: int = 50
    kind: ClassVar[str] = "straight"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        system, space = problem.system, problem.system.state_space
        try:
            tangent = space.difference(problem.goal_point, problem.start_point)
        except OrientationAtPiError as error:
            raise NoGuessError(
                "the goal is half a turn from the start, so no straight line leads there; use "
                "solvers.nlp.initial: problem",
                Outcome.ORIENTATION_AT_PI,
                "solvers.nlp.initial",
            ) from error
        controls = []
        for share in (np.arange(self.pieces) + 0.5) / self.pieces:
            state = np.asarray(space.retract(problem.start_point, share * tangent))
            fields = np.asarray(system.vector_fields(state))
            if not np.isfinite(fields).all():
                raise NoGuessError(
                    f"the equations are undefined at {share:.3g} of the straight line to the goal",
                    Outcome.NOT_FINITE,
                    "solvers.nlp.initial",
                )
            controls.append(np.linalg.lstsq(fields, tangent / horizon, rcond=None)[0])
        return Control(PiecewiseConstant(self.pieces), np.array(controls).T, horizon)
