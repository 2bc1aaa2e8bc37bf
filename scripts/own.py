#!/usr/bin/env python3
"""The paper's task on `default` by nhpocp's solvers, in the form of the rivals: `build` makes, the result solves.

A solve is the solver object's own call: everything but verification and files.
Run: .venv/bin/python scripts/own.py auto|unit|paper|null-space|nlp compiled|interpreted [INTERVALS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from goals import paper_task

from nhpocp.flow.compiled.kernels import Compiled, Interpreted, Kernels
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solution import Solver
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler

INTERVALS = 50
EVALUATION: dict[str, Callable[[], Kernels]] = {"compiled": Compiled, "interpreted": Interpreted}


def nlp(kernels: Kernels, intervals: int) -> Solver:
    """One RK4 step per interval, as in the rivals' scripts."""
    from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting  # not paid for by the others

    return MultipleShooting(intervals=intervals, steps_per_interval=1, kernels=kernels)


SOLVERS: dict[str, Callable[[Kernels, int], Solver]] = {
    "auto": lambda kernels, _: Auto(
        Continuation(step_rule=Adaptive(), integrator=RungeKutta4(kernels=kernels))
    ),
    "unit": lambda kernels, _: Continuation(step_rule=Euler(1.0), integrator=RungeKutta4(kernels=kernels)),
    "paper": lambda kernels, _: Continuation(step_rule=Euler(0.1), integrator=RungeKutta4(kernels=kernels)),
    "null-space": lambda kernels, _: Continuation(
        step_rule=Adaptive(), integrator=RungeKutta4(kernels=kernels), objective="effort"
    ),
    "nlp": nlp,
}


def build(
    method: str, evaluation: str = "compiled", intervals: int = INTERVALS
) -> Callable[[], tuple[float, np.ndarray]]:
    """A function that solves from Λ0 and returns ∫|v|² and Λ (3, 5), or v (3, intervals)."""
    problem = paper_task("default")
    solver = SOLVERS[method](EVALUATION[evaluation](), intervals)

    def solve() -> tuple[float, np.ndarray]:
        solution = solver.solve(problem)
        if solution.outcome is not Outcome.CONVERGED:
            raise RuntimeError(solution.message)
        return solution.control.effort, solution.control.coefficients

    return solve


if __name__ == "__main__":
    method, evaluation, *rest = sys.argv[1:]
    print(f"{build(method, evaluation, *map(int, rest))()[0]:.8f}")
