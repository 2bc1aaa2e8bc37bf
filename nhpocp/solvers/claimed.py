"""What a solver hands back: a control with its motion and what is claimed of it, or no control."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np

from nhpocp.controls.control import Control
from nhpocp.flow.simulation import simulate
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Method, Solution


def claimed(
    problem: PlanningProblem,
    solver: Method,
    control: Control,
    outcome: Outcome,
    message: str,
    error: float,
    **more: Any,
) -> Solution:
    """The unverified Solution with a control's motion. error: E as the solver believes; more: its other fields."""
    motion, settings = simulate(problem, control), solver.settings()
    return Solution(
        problem=problem,
        solver=solver.name,
        settings=settings,
        tolerance=solver.tolerance,
        outcome=outcome,
        message=message,
        final_error=error,
        control=control,
        trajectory=motion.trajectory,
        costs=motion.costs,
        **{"objective": settings.get("objective", problem.objective), **more},
    )


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
    timing = {"build_s": build_seconds, "solve_s": solve_seconds}
    return claimed(problem, solver, control, outcome, message, nan, timing=timing)
