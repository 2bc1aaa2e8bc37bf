"""What is handed back where there is no control."""

from __future__ import annotations

from math import nan

import numpy as np

from nhpocp.flow.simulation import simulate
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Method, Solution


def unsolved(
    problem: PlanningProblem,
    solver: Method,
    outcome: Outcome,
    message: str,
    build_seconds: float = 0.0,
    solve_seconds: float = 0.0,
) -> Solution:
    """A Solution without inputs: it stays at the start, or goes where the drift takes it. Its E is not measured."""
    zeros = np.zeros((problem.system.input_space.size, problem.basis.size))
    control = problem.control(zeros, problem.horizon.first)
    motion, settings = simulate(problem, control), solver.settings()
    return Solution(
        problem=problem,
        solver=solver.name,
        settings=settings,
        objective=settings.get("objective", problem.objective),
        tolerance=solver.tolerance,
        outcome=outcome,
        message=message,
        final_error=nan,
        control=control,
        trajectory=motion.trajectory,
        costs=motion.costs,
        timing={"build_s": build_seconds, "solve_s": solve_seconds},
    )
