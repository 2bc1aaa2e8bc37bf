"""Many goals from one start, by `Lockstep`; the plans are those of single solves to rounding.

A goal whose search does not end at it so is left to the solver itself, which finds out why and says it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solver
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.auto import EVALUATIONS, Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose
from nhpocp.solvers.continuation.lockstep_search import Lockstep, Method, Reached
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.continuation.stop_criteria import STAGNATION_WINDOW
from nhpocp.systems.numeric import numeric_system


def reached_together(solver: Solver, problems: Sequence[PlanningProblem]) -> list[Reached | None]:
    """What ``solver`` finds for problems that differ in their goals only; None where it has to be asked itself.

    Of the strategies of `Auto` only the first is tried here, the problem's own start.
    """
    reached: list[Reached | None] = [None] * len(problems)
    confirms = type(solver) is Auto
    method = _method(solver.continuation if type(solver) is Auto else solver, problems)
    if method is None:
        return reached
    limit = min(EVALUATIONS if confirms else STAGNATION_WINDOW, method.solver.max_iterations)
    with Interruption() as interruption, np.errstate(all="ignore"):
        for places in _alike(problems):
            try:
                search = Lockstep(method, [problems[place] for place in places], interruption)
                plans = search.plans(Budget(1 + limit))
                plans = search.confirmed(plans) if confirms else plans
            except (np.linalg.LinAlgError, RuntimeError):  # LAPACK's, CasADi's
                plans = {}  # the solver says whose goal it was
            interruption.check()
            for place, plan in plans.items():
                reached[places[place]] = plan
    return reached


def _method(solver: Solver, problems: Sequence[PlanningProblem]) -> Method | None:
    """None for other methods, subclasses among them, and where more is asked than to drive E to zero."""
    if type(solver) is not Continuation or not problems:
        return None
    problem, rule, inverse = problems[0], solver.step_rule, solver.inverse
    by_steps = type(solver.integrator) is RungeKutta4 and solver.sensitivity is DifferentiatedEndPointMap
    bare = solver.objective == "none" and not (problem.bounds or problem.via) and problem.initial is not None
    if type(rule) is Adaptive and type(inverse) is MoorePenrose and by_steps and bare:
        return Method(solver, rule, inverse)
    return None


def _alike(problems: Sequence[PlanningProblem]) -> list[list[int]]:
    """Places of the goals that fix the same blocks, those beyond a singular surface left out."""
    first, groups = problems[0], dict[frozenset[str], list[int]]()
    ends = np.stack([first.start_point, *(problem.goal_point for problem in problems)])
    determinants, apart = numeric_system(first.system).determinants(ends), np.zeros(len(problems), dtype=bool)
    for name in first.system.separating():
        apart |= ~(determinants[name][1:] * determinants[name][0] > 0)
    for place, problem in enumerate(problems):
        if not (apart[place] or problem.tasks[0].outputs):
            groups.setdefault(frozenset(problem.goal), []).append(place)
    return list(groups.values())
