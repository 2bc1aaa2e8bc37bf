#!/usr/bin/env python3
"""Random workspace goals of `default`, and what the NLP solver says of them against what verification finds.

x, y ∈ ±8, z ∈ 18…40, tilt up to 30°, yaw -120°…20°, det S and det W of the sign that they have at the start; N=50.
IPOPT's word alone is often wrong there: a step jumps across det S = 0, and `Solve_Succeeded` is not where it says.
Run: .venv/bin/python scripts/random_goals.py [--goals 16] [--first 0] [--steps 1|auto] [--max-iterations 200]
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from time import perf_counter

from goals import paper_task, workspace_goal

from nhpocp import planning
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting


def attempt(problem: PlanningProblem, seed: int, solver: MultipleShooting) -> Solution:
    """The verified solution of one random goal."""
    return planning.solve(replace(problem, goal=workspace_goal(problem, seed)), solver)


def main(arguments: argparse.Namespace) -> None:
    problem = paper_task("default")
    solver = MultipleShooting(
        steps_per_interval=None if arguments.steps == "auto" else int(arguments.steps),
        optimizer=Ipopt(max_iterations=arguments.max_iterations),
    )
    print(
        "seed  outcome              status                            believed   verified  steps  iterations    s"
    )
    outcomes: Counter[str] = Counter()
    false_claims = 0
    for seed in range(arguments.first, arguments.first + arguments.goals):
        began = perf_counter()
        solution = attempt(problem, seed, solver)
        error = solution.verdict.error if solution.verdict else None
        status = str(solution.details.get("status", "-"))
        outcomes[solution.outcome.value] += 1
        claimed = status == "Solve_Succeeded"
        false_claims += claimed and not solution.converged
        print(
            f"{seed:4}  {solution.outcome.value:20} {status:32} {solution.final_error:9.2e}  "
            f"{'-' if error is None else f'{error:.2e}':>9}  {solution.details.get('steps_per_interval', '-'):>5}  "
            f"{len(solution.iterations):10}  {perf_counter() - began:5.1f}",
            flush=True,
        )
    print(", ".join(f"{name} {count}" for name, count in outcomes.most_common()))
    print(f"Solve_Succeeded refuted by verification: {false_claims} of {arguments.goals}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=16)
    parser.add_argument("--first", type=int, default=0, help="seed of the first goal")
    parser.add_argument("--steps", default="1", help="RK4 steps per interval, or auto")
    parser.add_argument("--max-iterations", type=int, default=200)
    main(parser.parse_args())
