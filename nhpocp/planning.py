"""Solve, then verify: what `nhpocp.solve` means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.leg_acceleration import lacking_derivative
from nhpocp.deferred import at_hand
from nhpocp.errors import CallError, InvalidProblemError, describe, suggestion
from nhpocp.flow.simulation import simulate
from nhpocp.foreseen import broken_poses, contradiction, endless, other_side, singular_goal
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.kept import let_go
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.pace import ROOM, patient_horizon, too_far
from nhpocp.problem import PlanningProblem
from nhpocp.scales import coarse
from nhpocp.solution import Progress, Solution, Solver, telling
from nhpocp.solvers.claimed import unsolved
from nhpocp.solvers.registry import SOLVERS, made_solver
from nhpocp.verification import verify


def solve(
    problem: PlanningProblem, solver: Solver | str | None = None, progress: Progress | None = None
) -> Solution:
    """A verified Solution of a problem by ``solver``, an object or a name, as `chosen_solver`.

    A goal beyond a singular surface, or one that breaks a bound itself, is recognised before the solver starts.
    Errors: `NhpocpError` for a problem that the solver cannot take; everything that happens while solving is an outcome
    of the Solution.
    """
    solver = chosen_solver(problem, solver)
    if words := OBJECTIVES[problem.objective].lacking_control(problem.basis):
        raise InvalidProblemError(words, path="objective")
    if words := lacking_derivative(problem.bounds, problem.basis):
        raise InvalidProblemError(words, path="constraints.leg_acceleration")
    with Interruption() as interruption:
        solution: Solution | None = None
        try:
            solution = refused(problem, solver) or _in_short(solver.solve(problem, progress))
            solution = _with_a_cure(_with_its_pace(solution, solver), progress)
        except KeyboardInterrupt:
            if interruption.insisted:
                raise
        if solution is None:
            with Interruption(patient=True):  # short
                words = f"{STOPPED} before a control was found."
                solution = _refused(problem, solver, Outcome.INTERRUPTED, words)
        solution, began = _doubted(_with_pose(solution)), perf_counter()
        if progress:
            progress({"k": None, "error": None, "stage": "verifying"})
        try:
            verdict = verify(solution)  # interrupted ones deserve it too
        except KeyboardInterrupt:
            if interruption.insisted:
                raise
            message = f"{STOPPED} before it was verified; the solver's own word: {solution.message}"
            return replace(solution, outcome=Outcome.INTERRUPTED, message=message)
    if solution.outcome is Outcome.CONVERGED and not verdict.ok:
        # a class or a global that the equations read may have changed since what is kept was made
        let_go(problem.system)
    return solution.judged(verdict, perf_counter() - began)


def _in_short(solution: Solution) -> Solution:
    """After a stop, records of thousands of updates without what takes work to look at: nobody waits for that."""
    if solution.outcome is not Outcome.INTERRUPTED:
        return solution
    return replace(solution, iterations=[at_hand(record) for record in solution.iterations])


def _too_far(problem: PlanningProblem, solver: Solver) -> str:
    free = problem.horizon.free and getattr(solver, "chooses_horizon", False)
    horizon = problem.horizon.maximum if free else problem.horizon.initial
    return too_far(problem, horizon, solver.tolerance)


def _with_its_pace(solution: Solution, solver: Solver) -> Solution:
    """With a warning where the duration is free and the solver cannot choose it."""
    if not solution.problem.horizon.free or getattr(solver, "chooses_horizon", False):
        return solution
    words = (
        f"horizon: this solver does not choose the duration, which stays {solution.control.horizon:g}, its first "
        "guess; the NLP chooses it, `--solver nlp`"
    )
    return replace(solution, warnings=[*solution.warnings, words])


def _with_a_cure(solution: Solution, progress: Progress | None) -> Solution:
    """With the horizon in which its bounds on rates can be kept, if they are broken and a motion without them is found.

    A driftless motion takes the same path more slowly.
    """
    if solution.outcome not in (Outcome.CONSTRAINT_VIOLATED, Outcome.INFEASIBLE):
        return solution
    problem = solution.problem
    bounds = problem.bounds_on_rates
    if not bounds or problem.horizon.initial is None or list(broken_poses(problem)):
        return solution
    relaxed = problem.with_(bounds=[bound for bound in problem.bounds if bound not in bounds])
    plan = default_solver(problem).solve(relaxed, telling(progress, way="at another pace"))
    if plan.outcome is not Outcome.CONVERGED or lacking_derivative(bounds, plan.control.basis):
        return solution
    horizon = patient_horizon(bounds, simulate(problem, plan.control).trajectory)
    if horizon is None or float(horizon) <= ROOM * problem.horizon.initial:
        return solution
    names = " and ".join(dict.fromkeys(bound.label for bound in bounds))
    words = f"A motion that keeps {names} was found for horizon: {horizon}."
    return replace(solution, message=f"{solution.message} {words}")


def _doubted(solution: Solution) -> Solution:
    """With a warning where what counts as reached is a large part of the motion."""
    problem = solution.problem
    poses = [problem.start, *(via.goal for via in problem.via), problem.goal]
    words = coarse(problem.scales, poses, problem.error_length, solution.tolerance)
    if not words:
        return solution
    return replace(solution, warnings=[*solution.warnings, f"error_length: {words}"])


def _with_pose(solution: Solution) -> Solution:
    """A solution that says which of many poses it chose, where the goal names outputs or leaves something free."""
    if solution.outcome is not Outcome.CONVERGED or solution.problem.goal_is_a_pose:
        return solution
    reached = solution.pose_reached
    return replace(solution, message=f"{solution.message} It ends at {reached}.") if reached else solution


def default_solver(problem: PlanningProblem) -> Solver:
    """The problem's own Jacobian method."""
    from nhpocp.solvers.continuation.auto import Auto

    return problem.solvers.get("jacobian") or Auto()


def chosen_solver(problem: PlanningProblem, solver: Any) -> Solver:
    """A solver as it stands; of a name the problem's own, else that method's defaults; None: `default_solver`.

    Errors: `InvalidProblemError` for an unknown name, `CallError` for what is no solver.
    """
    if solver is None:
        return default_solver(problem)
    if isinstance(solver, str):
        return own_solver(problem, solver)
    if isinstance(solver, type) or not callable(getattr(solver, "solve", None)):
        hint = f"; write {solver.__name__}()" if isinstance(solver, type) else ""
        names = ", ".join(SOLVERS)
        words = f"expected a solver such as Auto(), or a name ({names}), got {describe(solver)}{hint}"
        raise CallError(words, path="solver")
    chosen: Solver = solver
    return chosen


def own_solver(problem: PlanningProblem, name: str) -> Solver:
    """A problem's own solver of that name, or the method's defaults.

    Errors: `InvalidProblemError` for an unknown one.
    """
    if name in problem.solvers:
        own: Solver = problem.solvers[name]
        return own
    if name not in SOLVERS:
        near = suggestion(name, [*problem.solvers, *SOLVERS])
        raise InvalidProblemError(f"unknown solver {name!r}; {near}", path="solver")
    return made_solver(name, SOLVERS[name]())


def refused(problem: PlanningProblem, solver: Solver) -> Solution | None:
    """The ending of a task that no path of this machine performs, recognised from its poses alone."""
    with np.errstate(all="ignore"):
        speeds = problem.scales.inputs
        numbers = np.isfinite(speeds) & np.isfinite(1.0 / speeds) & (speeds > 0)
    if not numbers.all():
        words = f"Lengths and times of this problem make speeds of about {speeds[~numbers][0]:g}, which are no numbers"
        return _refused(problem, solver, Outcome.NOT_FINITE, f"{words}. {Outcome.NOT_FINITE.advice}")
    if missed := _missed_by_the_drift(problem, solver):
        return _refused(problem, solver, Outcome.NOT_REACHED, f"{missed}. There is no control to search for.")
    matrix, on_the_surface = singular_goal(problem)
    if matrix:
        outcome = {"s": Outcome.SINGULAR_S}.get(matrix, Outcome.SINGULAR_W)
        words = f"The goal itself {on_the_surface}; choose one that is clear of it."
        return _refused(problem, solver, outcome, words)
    sentences = {
        Outcome.INFEASIBLE: contradiction(problem) or _broken_bounds(problem) or _too_far(problem, solver),
        Outcome.OTHER_COMPONENT: other_side(problem),
    }
    for outcome, sentence in sentences.items():
        if sentence:
            return _refused(problem, solver, outcome, f"{sentence}. {outcome.advice}")
    if getattr(solver, "chooses_horizon", False) and (words := endless(problem)):
        return _refused(problem, solver, Outcome.DIVERGED, f"{words}.")
    return None


def _missed_by_the_drift(problem: PlanningProblem, solver: Solver) -> str:
    """Where a system without inputs goes in a given time is no matter of choice."""
    if problem.system.input_space.size or problem.horizon.free:
        return ""
    horizon = problem.horizon.fixed
    control = problem.control(np.zeros((0, problem.basis.size)), horizon)
    error = _error_at_the_end(problem, simulate(problem, control).trajectory)
    if error <= solver.tolerance:
        return ""
    return f"{problem.system.model} has no inputs, and its drift ends E = {error:.3g} from the goal at t = {horizon:g}"


def _broken_bounds(problem: PlanningProblem) -> str:
    """The poses that break a bound themselves, in words."""
    names = {f"via[{i}]": f"via pose at {via.share:g}" for i, via in enumerate(problem.via)}
    return "; ".join(
        f"the {names.get(place, place)} itself breaks {report.name}, which is {report.value_words()}, "
        + report.limit_words()
        for place, report in broken_poses(problem)
    )


def _refused(problem: PlanningProblem, solver: Solver, outcome: Outcome, message: str) -> Solution:
    """A Solution whose control stands still, with E where that ends."""
    still = unsolved(problem, solver, outcome, message)
    return replace(still, final_error=_error_at_the_end(problem, still.trajectory))


def _error_at_the_end(problem: PlanningProblem, trajectory: Mapping[str, Array]) -> float:
    """E where a motion ends."""
    space = problem.system.state_space
    return problem.goal_error(np.asarray(space.pack({name: trajectory[name][-1] for name in space.names})))
