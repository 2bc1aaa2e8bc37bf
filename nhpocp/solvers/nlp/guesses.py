"""What an NLP starts from: a path and a control made from the problem, from another solver, or from a straight line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.declared import check, count
from nhpocp.errors import CallError, InvalidProblemError, OrientationAtPiError, TooLargeError, describe
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import resolving
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.provenance import afford
from nhpocp.solution import Solution, Solver
from nhpocp.solvers.continuation.initial_control import seeded_start
from nhpocp.solvers.nlp.first_plan import brought, over, reaches
from nhpocp.solvers.nlp.transcription import Guess
from nhpocp.state_space import StateSpace
from nhpocp.systems.numeric import numeric_system

STEPS_PER_INTERVAL = 4
BYTES = 350.0  # for each entry of the Hessians that an NLP with a control over a basis is made of, measured
BYTES_AT_LEAST = 35_000.0  # for each interval
TOLERANCE = 1e-6  # of an NLP, unless said
DRAWS = 40  # of a seeded control; an NLP needs no full rank, and begins with what is best conditioned


class NoGuessError(InvalidProblemError):
    """A guess that cannot be made; ``outcome`` is how a solve ends that needed it.

    origin: what another solver came to, of which none could be made.
    """

    def __init__(self, message: str, outcome: Outcome, path: str, origin: Solution | None = None) -> None:
        super().__init__(message, path=path)
        self.outcome, self.origin = outcome, origin


class GuessMaker(Protocol):
    """Makes the first guess of an NLP over a basis, with node states at the ends of equal intervals."""

    @property
    def kind(self) -> str:
        """How a file calls it."""
        ...

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        """A control over any basis; the guess projects it and follows it."""
        ...


def make_guess(
    maker: GuessMaker,
    problem: PlanningProblem,
    basis: ControlBasis | None,
    intervals: int,
    seed: int,
    tolerance: float = TOLERANCE,
) -> Guess:
    """The guess of a maker over ``basis`` (None: piecewise constant), simulated.

    Another solver's plan leads to the goal over that basis too, within ``tolerance``, where the basis can follow it.
    Errors: `NoGuessError` where there is none, or its simulation is not finite.
    """
    _check_memory(problem, basis, intervals)
    horizon, origin = problem.horizon.first, None
    wanted = basis or PiecewiseConstant(intervals)
    if isinstance(maker, SolverGuess):
        origin = brought(maker.solution(problem, horizon), tolerance)
        control = origin.control
        if reaches(origin, tolerance):
            control = over(origin.problem, control, wanted, tolerance) or control
    else:
        control = maker.control(problem, horizon, seed)
    if control.basis != wanted:
        control = project(control, wanted)
    states = follow(problem, control, intervals, STEPS_PER_INTERVAL)
    if not np.isfinite(states).all():
        raise NoGuessError(
            f"the path under the {maker.kind} guess is not finite; try another control.initial, or "
            "solvers.nlp.initial: straight",
            Outcome.NOT_FINITE,
            "control.initial" if maker.kind == "problem" else "solvers.nlp.initial",
            origin,
        )
    return Guess(states, control, origin)


def _check_memory(problem: PlanningProblem, basis: ControlBasis | None, intervals: int) -> None:
    """Errors: `NoGuessError` where the NLP's Hessians would not fit: every interval knows all coefficients."""
    inputs, state = problem.system.input_space.size, problem.system.state_space.dimension
    stage = state + inputs * (basis.size if basis else 1)
    try:
        afford(
            max(BYTES * stage**2, BYTES_AT_LEAST) * intervals,
            f"an NLP with {intervals} intervals of {stage} variables each",
        )
    except TooLargeError as error:
        raise NoGuessError(
            f"{error}; take fewer functions{' or solvers.nlp.control: piecewise_constant' if basis else ''}",
            Outcome.SOLVER_ERROR,
            "solvers.nlp",
        ) from error


def follow(problem: PlanningProblem, control: Control, intervals: int, steps: int) -> Array:
    """States (intervals + 1, size) at the nodes under a control, by RK4 with ``steps`` per interval."""
    return _walk(problem, control, intervals * steps)[1][::steps]


def meets(problem: PlanningProblem, control: Control, intervals: int, steps: int) -> Array:
    """States (tasks, size) at the times of the problem's tasks, on the same path, the last step to one cut short."""
    times, states = _walk(problem, control, intervals * steps)
    points = []
    for task in problem.tasks:
        time = task.share * control.horizon
        before = int(np.searchsorted(times, time + 1e-9 * control.horizon)) - 1
        point = states[before]
        if time - times[before] > 1e-9 * control.horizon:
            last = np.array([times[before], time])
            flow = RungeKutta4().flow(_dynamics(problem), control.basis, control.horizon, last)
            point = flow.end(point, control.coefficients)
        points.append(point)
    return np.array(points)


def _dynamics(problem: PlanningProblem) -> Dynamics:
    """For paths alone, which no kernel is worth."""
    return Dynamics(numeric_system(problem.system).rate_function)


def _walk(problem: PlanningProblem, control: Control, steps: int) -> tuple[Array, Array]:
    """Times and states of one path by RK4 with equal steps."""
    times = np.linspace(0.0, control.horizon, steps + 1)
    flow = RungeKutta4().flow(_dynamics(problem), control.basis, control.horizon, times)
    return times, flow.states(problem.start_point, control.coefficients)


def held(problem: PlanningProblem, horizon: float) -> PlanningProblem:
    """The problem with its horizon held, for those who cannot choose it."""
    return replace(problem, horizon=Horizon(horizon)) if problem.horizon.free else problem


@dataclass(frozen=True)
class ProblemGuess(Constructed):
    """The problem's own initial control; for the second and later starts a seeded one, of full rank if one is found."""

    kind: ClassVar[str] = "problem"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        if problem.initial is not None and not seed:
            return Control(problem.basis, problem.initial, horizon)
        end_point_map = DifferentiatedEndPointMap(
            problem.system,
            problem.basis,
            horizon,
            problem.start_point,
            resolving(RungeKutta4(), problem.basis),
            [task.share for task in problem.tasks[:-1]],
        )
        start = seeded_start(held(problem, horizon), end_point_map, seed, DRAWS)
        if start is None:
            raise NoGuessError(
                f"no path of {DRAWS} seeded controls is finite and stays on one side of every singular surface; write "
                "a control.initial, or use solvers.nlp.initial: straight",
                Outcome.NOT_FINITE,
                "control.initial",
            )
        return Control(problem.basis, start.coefficients, horizon)


@dataclass(frozen=True)
class SolverGuess(Constructed):
    """The control at which another solver ends; a guess need neither keep the bounds nor reach the goal.

    solver: such as `Auto()`. Errors: `CallError` for what is no solver.
    """

    solver: Solver
    kind: ClassVar[str] = "jacobian"

    def __post_init__(self) -> None:
        if isinstance(self.solver, type) or not hasattr(self.solver, "solve"):
            raise CallError(
                f"expected a solver such as Auto(), got {describe(self.solver)}", path="SolverGuess.solver"
            )

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        return self.solution(problem, horizon).control

    def solution(self, problem: PlanningProblem, horizon: float) -> Solution:
        """Whatever it ends as: near the goal is a guess too. Errors: `NoGuessError` where it was stopped."""
        solution = self.solver.solve(held(problem, horizon))
        if solution.outcome is Outcome.INTERRUPTED:
            raise NoGuessError(
                f"the {self.solver.name} solver, whose solution was to be the guess, was stopped",
                solution.outcome,
                "solvers.nlp.initial",
                solution,
            )
        return solution


@dataclass(frozen=True)
class StraightGuess(Constructed):
    """Geodesics from start to goal through the via poses, with the control that comes nearest to following them.

    Between two of them each at constant speed. A block that one leaves free passes it on its way to the next that does
    not, and stays where it is where there is none.
    """

    pieces: int = count(50, "equal parts of the horizon, on each of which the control follows a geodesic")
    kind: ClassVar[str] = "straight"

    def __post_init__(self) -> None:
        check(self)

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        system, space = problem.system, problem.system.state_space
        fractions, points = waypoints(problem)
        controls = []
        for fraction in (np.arange(self.pieces) + 0.5) / self.pieces:
            leg = int(np.searchsorted(fractions, fraction)) - 1
            span = fractions[leg + 1] - fractions[leg]
            tangent = np.asarray(_geodesic(space, points[leg + 1], points[leg]))
            state = np.asarray(space.retract(points[leg], (fraction - fractions[leg]) / span * tangent))
            fields, drift = np.asarray(system.vector_fields(state)), np.asarray(system.drift(state))
            if not (np.isfinite(fields).all() and np.isfinite(drift).all()):
                raise NoGuessError(
                    f"the equations are undefined at {fraction:.3g} of the straight line to the goal",
                    Outcome.NOT_FINITE,
                    "solvers.nlp.initial",
                )
            wanted = tangent / (span * horizon) - drift
            controls.append(np.linalg.lstsq(fields, wanted, rcond=None)[0])
        return Control(PiecewiseConstant(self.pieces), np.array(controls).T, horizon)


def waypoints(problem: PlanningProblem) -> tuple[Array, Array]:
    """Shares of the horizon (k,) and poses (k, size): the start, the via poses, the goal, free blocks filled in.

    Errors: `NoGuessError` where a task fixes an output, from which no pose follows, or lies half a turn ahead.
    """
    space, tasks = problem.system.state_space, problem.tasks
    named = [output.name for task in tasks for output in task.outputs]
    if named:
        raise NoGuessError(
            f"{named[0]} is an output, which gives no pose to go straight to; use solvers.nlp.initial: problem",
            Outcome.NOT_REACHED,
            "solvers.nlp.initial",
        )
    fractions = np.array([0.0, *(task.share for task in tasks)])
    columns = {}
    for block in space.blocks:
        alone = StateSpace([block])
        wanted = [problem.start[block.name], *(task.values.get(block.name) for task in tasks)]
        fixed = [i for i, value in enumerate(wanted) if value is not None]
        values = [np.asarray(alone.pack({block.name: problem.start[block.name]}))]
        for i in range(1, len(fractions)):
            later = [j for j in fixed if j >= i]
            if not later:
                values.append(values[-1])
                continue
            target = np.asarray(alone.pack({block.name: wanted[later[0]]}))
            part = (fractions[i] - fractions[i - 1]) / (fractions[later[0]] - fractions[i - 1])
            values.append(np.asarray(alone.retract(values[-1], part * _geodesic(alone, target, values[-1]))))
        columns[block.name] = np.array(values)
    return fractions, np.hstack([columns[name] for name in space.names])


def _geodesic(space: StateSpace, point: Array, origin: Array) -> Array:
    try:
        return np.asarray(space.difference(point, origin))
    except OrientationAtPiError as error:
        raise NoGuessError(
            "the goal is half a turn from the start, so no straight line leads there; use "
            "solvers.nlp.initial: problem",
            Outcome.ORIENTATION_AT_PI,
            "solvers.nlp.initial",
        ) from error
