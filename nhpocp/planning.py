"""Solve, then verify: what `nhpocp.solve` means."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from nhpocp.flow.simulation import simulate
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Progress, Solution, Solver
from nhpocp.solvers.interruption import Interruption
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification import verify

ON_THE_SURFACE = 1e-9  # σ_min below which the sign of a determinant is rounding


def solve(
    problem: PlanningProblem, solver: Solver | None = None, progress: Progress | None = None
) -> Solution:
    """A verified Solution of a problem by ``solver``; by default the problem's own Jacobian method.

    A goal on the other side of a singular surface is recognised before the solver starts. Errors: `NhpocpError` for a
    problem that the solver cannot take; everything that happens while solving is an outcome of the Solution.
    """
    if solver is None:
        solver = problem.solvers.get("jacobian") or _default_solver()
    solution = _refused(problem, solver) or solver.solve(problem, progress)
    began = perf_counter()
    with Interruption():  # short, and an interrupted solution deserves its verdict
        verdict = verify(solution)
    return solution.judged(verdict, perf_counter() - began)


def _default_solver() -> Solver:
    from nhpocp.solvers.continuation import Continuation

    return Continuation()


def _refused(problem: PlanningProblem, solver: Solver) -> Solution | None:
    """The ending of a goal that no path of this machine reaches, before anything is solved."""
    space, system = problem.system.state_space, problem.system
    if set(problem.goal) != set(space.names):
        return None
    numeric = NumericSystem(system)
    determinants = numeric.determinants(np.stack([problem.start_point, problem.goal_point]))
    margins = numeric.margins(np.stack([problem.start_point, problem.goal_point]), problem.scale)
    opposite = [
        name
        for name in system.separating()
        if determinants[name][0] * determinants[name][1] < 0
        and margins[f"sigma_{name}"].min() > ON_THE_SURFACE
    ]
    if not opposite:
        return None
    sentences = [
        f"det {name.upper()} is {determinants[name][0]:.3g} at the start and {determinants[name][1]:.3g} at the goal"
        for name in opposite
    ]
    control = problem.control(
        np.zeros((system.input_space.size, problem.basis.size)), problem.horizon.initial or 1.0
    )
    motion = simulate(problem, control, numeric)
    return Solution(
        problem=problem,
        solver=solver.name,
        settings=solver.settings(),
        tolerance=solver.tolerance,
        outcome=Outcome.OTHER_COMPONENT,
        message=f"{'; '.join(sentences)}. {Outcome.OTHER_COMPONENT.advice}",
        final_error=problem.goal_error(problem.start_point),
        timing={"build_s": 0.0, "solve_s": 0.0},
        control=control,
        trajectory=motion.trajectory,
        costs=motion.costs,
    )
