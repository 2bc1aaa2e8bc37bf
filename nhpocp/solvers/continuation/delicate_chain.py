"""Manoeuvres in sequence that multiply errors, as one control: corrected by the last of them alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.controls.sequence import join, retimed
from nhpocp.flow.end_point_map import flow_through, stops_of
from nhpocp.flow.integrators import Flow, RungeKutta4
from nhpocp.flow.step_error import FINER, MOST
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.confirmation import begun_from
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult

Solve = Callable[[Continuation, PlanningProblem], ContinuationResult]


ROUGH = 100  # steps of a manoeuvre, whose error says how many it needs
HUGE = 1e30  # of a derivative that is no number
NUDGE = 1e-6  # in units of the scales, for differences
FEWEST = 0.3  # of the mean: the steps that a manoeuvre gets at least


def joined_by_steps(
    problem: PlanningProblem, controls: Sequence[Control], solver: Continuation, solve: Solve
) -> ContinuationResult:
    """What controls of unit time lead to, two at least, that as one with the least change of all do not reach the goal.

    That change falls on the first of them, whose effect is multiplied most and is linear in the least; the last is
    corrected instead. Each gets time, and with it a share of the most steps that there are, as it needs steps.
    """
    needs = _steps_needed(problem, controls)
    durations = problem.horizon.fixed * needs / needs.sum()
    pieces = [retimed(control, time) for control, time in zip(controls, durations, strict=True)]
    whole, begins = join(pieces), 1.0 - float(needs[-1] / needs.sum())
    kept = solver.integrator if isinstance(solver.integrator, RungeKutta4) else RungeKutta4()
    solver = replace(solver, integrator=replace(kept, steps=MOST))
    flow = flow_through(problem.system, whole.basis, whole.horizon, solver.integrator, (begins,))
    path = flow.states(problem.start_point, whole.coefficients)
    if not np.isfinite(path).all():
        return solve(solver, begun_from(problem, whole))  # which says so
    space = problem.system.state_space
    here = space.nearest(path[stops_of(flow.times, (begins,), whole.horizon)[0]])
    rest = replace(problem, start=space.unpack(here), horizon=Horizon(pieces[-1].horizon))
    of_one = replace(solver, integrator=replace(kept, steps=int(MOST * (1.0 - begins))))
    whole = join([*pieces[:-1], of_one.find(begun_from(rest, pieces[-1])).control])
    return solve(solver, begun_from(problem, whole))


def _steps_needed(problem: PlanningProblem, controls: Sequence[Control]) -> Array:
    """Of each control, relative, so that as many steps in all leave the least error at the end of the last.

    A scheme of order 4 with n_i steps leaves Σ c_i / n_i⁴, which is least for n_i ~ c_i^(1/5); c_i is what a control is
    wrong by with as many steps as the others, times what the later ones multiply that by. As many for all where a few
    steps do not lead through one of them.
    """
    errors, derivatives, here = list[float](), list[Array](), problem.start_point
    for control in controls:
        rough, fine = (
            flow_through(problem.system, control.basis, control.horizon, RungeKutta4(steps), ())
            for steps in (ROUGH, FINER * ROUGH)
        )
        derivatives.append(end_by_start(problem, rough, here, control))
        end = fine.end(here, control.coefficients)
        if not np.isfinite(end).all():
            return np.ones(len(controls))
        errors.append(
            float((np.abs(end - rough.end(here, control.coefficients)) / problem.scales.points).max())
        )
        here = problem.system.state_space.nearest(end)
    later, needs = np.eye(len(derivatives[-1])), list[float]()
    for error, derivative in zip(errors[::-1], derivatives[::-1], strict=True):
        needs.append(error * float(np.linalg.norm(later, 2)))
        later = later @ derivative
    shares = np.asarray(needs[::-1]) ** 0.2
    told = shares.any() and np.isfinite(shares).all()
    return np.maximum(shares, FEWEST * shares.mean()) if told else np.ones(len(shares))


def end_by_start(problem: PlanningProblem, flow: Flow, here: Array, control: Control) -> Array:
    """∂end/∂start (dimension, dimension) of a control from a pose, by differences, in units of the scales."""
    space, scales = problem.system.state_space, problem.scales.states
    starts = [here, *(np.asarray(space.retract(here, a)) for a in NUDGE * np.diag(scales))]
    end, *ends = (flow.end(start, control.coefficients) for start in starts)
    derivative = np.array([np.asarray(space.difference(there, end)) / scales for there in ends]).T / NUDGE
    return derivative if np.isfinite(derivative).all() else HUGE * np.eye(len(scales))
