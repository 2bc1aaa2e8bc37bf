"""What a continuation claims, held against a finer simulation before anything is built on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.flow.end_point_map import flow_through, stops_of
from nhpocp.flow.integrators import Integrator
from nhpocp.flow.step_error import ALLOWED, StepError, finer, resolving
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.task import AlikeTasks, total_error

CORRECTIONS = 3


def confirmed(
    solver: Continuation, problem: PlanningProblem, progress: Progress | None = None, updates: int = 0
) -> ContinuationResult:
    """What a continuation finds; where a simulation with `finer` steps refutes it, corrected with those.

    Every claim is held against such a simulation, that of the last correction too; ends as `not_verified` only if that
    is refuted as well, after `CORRECTIONS` of them. ``updates``: as of `Continuation.find`.
    """
    solver = replace(solver, integrator=resolving(solver.integrator, problem.basis))
    claimed, error = solver.find(problem, progress, updates), np.inf
    begun = (
        claimed.integrator != solver.integrator
    )  # the search for least cost has gone over to finer steps itself
    for correction in range(begun, CORRECTIONS + 1):
        if claimed.outcome is not Outcome.CONVERGED:
            return claimed
        solver = replace(solver, integrator=claimed.integrator)
        error = missed(problem, claimed.control, solver.integrator)
        unresolved = _unresolved(problem, claimed.control, solver)
        if error <= solver.tolerance and not unresolved:
            return claimed
        if unresolved:
            return replace(claimed, outcome=Outcome.NOT_VERIFIED, message=f"{claimed.message}; {unresolved}")
        if correction == CORRECTIONS:
            break
        # the claim is near enough to the least cost; only the goal, and the bounds, are missed
        solver = replace(solver, integrator=finer(solver.integrator), objective="none")
        again = solver.find(begun_from(problem, claimed.control), progress, claimed.updates)
        message = f"{claimed.message}; with finer steps {again.message}"
        details, records = {**claimed.details, **again.details}, [*claimed.records, *again.records]
        claimed = replace(again, message=message, details=details, records=records)
    steps = getattr(finer(solver.integrator), "steps", 0)
    message = f"{claimed.message}; a simulation with {steps} steps misses by E = {error:.3g}"
    return replace(claimed, outcome=Outcome.NOT_VERIFIED, message=message)


def _unresolved(problem: PlanningProblem, control: Control, solver: Continuation) -> str:
    """What is wrong with the most steps that there are, in words: no finer ones would tell."""
    integrator = solver.integrator
    if finer(integrator) != integrator:
        return ""
    flow = flow_through(problem.system, control.basis, control.horizon, integrator, ())
    steps = StepError(begun_from(problem, control), integrator, control.horizon)
    error = steps.error(control.coefficients, flow.end(problem.start_point, control.coefficients))
    return (
        f"{integrator.steps} steps may be wrong by E = {error:.3g}"
        if error > ALLOWED * solver.tolerance
        else ""
    )


def begun_from(problem: PlanningProblem, control: Control) -> PlanningProblem:
    """The problem with a control that is at hand as its start."""
    return replace(problem, basis=control.basis, initial=control.coefficients)


def missed(problem: PlanningProblem, control: Control, integrator: Integrator) -> float:
    """E over goal and via poses, with finer steps than a claim's."""
    fractions, horizon = tuple(task.share for task in problem.tasks[:-1]), control.horizon
    flow = flow_through(problem.system, control.basis, horizon, finer(integrator), fractions)
    path = flow.states(problem.start_point, control.coefficients)
    return total_error(problem.tasks, path[list(stops_of(flow.times, fractions, horizon))])


def missed_by_each(
    problem: PlanningProblem, tasks: AlikeTasks, goals: Array, coefficients: Array, integrator: Integrator
) -> Array:
    """E of each of these goals under its own coefficients (k, inputs, size), as `missed`; infinite if it has none."""
    flow = flow_through(problem.system, problem.basis, problem.horizon.fixed, finer(integrator), ())
    ends = flow.ends(problem.start_point, coefficients, differentiated=False)
    return tasks.errors(goals, ends.states)


def end_of(problem: PlanningProblem, control: Control, integrator: Integrator) -> Array:
    """Where a control leads, with finer steps than a claim's, as a point of the state space; NaN where it is none."""
    resolved = resolving(integrator, control.basis)
    flow = flow_through(problem.system, control.basis, control.horizon, finer(resolved), ())
    end = flow.end(problem.start_point, control.coefficients)
    return problem.system.state_space.nearest(end) if np.isfinite(end).all() else end
