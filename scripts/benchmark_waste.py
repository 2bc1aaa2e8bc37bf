#!/usr/bin/env python3
"""What the merging of manoeuvres leaves of the effort of joined plans, beside the least that anything found.

Goals of `benchmark_routes.py` to which no start leads, by manoeuvres along a route from several seeds, each merged;
with --nlp also IPOPT's multiple shooting, begun from the first seed's merged plan. Only plans that verification
accepts and that stay on their side of det S = 0 and det W = 0 count.
Run: .venv/bin/python scripts/benchmark_waste.py [--numbers 0 3 5] [--seeds 3] [--nlp 200]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import process_time

import numpy as np
from goals import random_robot_task, walked_goal

from nhpocp import planning
from nhpocp.controls.control import Control
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting


def planned(problem: PlanningProblem, seed: int, objective: str) -> tuple[Solution, float]:
    """By manoeuvres along a route, and the processor's seconds."""
    solver = Continuation(step_rule=Adaptive(), objective=objective, seed=seed)
    began = process_time()
    solution = planning.solve(problem, Auto(solver, route="always"))
    return solution, process_time() - began


def optimised(problem: PlanningProblem, control: Control, intervals: int) -> Solution:
    """By IPOPT from a control, with time to end."""
    from_control = replace(problem, basis=control.basis, initial=control.coefficients)
    solver = MultipleShooting(intervals=intervals, optimizer=Ipopt(max_iterations=3000))
    return planning.solve(from_control, solver)


def counted(solution: Solution) -> bool:
    return bool(solution.converged and solution.verdict and not solution.verdict.crossings)


def main(arguments: argparse.Namespace) -> None:
    print("| goal | joined | after the phase | CPU s | other seeds | nlp | ratio to the least | ending |")
    print("|---|---|---|---|---|---|---|---|")
    ratios, seconds = [], []
    for number in arguments.numbers:
        task = random_robot_task(number)
        problem = task.towards(walked_goal(task, number))
        joined, _ = planned(problem, 0, "none")
        merged, cpu = planned(problem, 0, "effort")
        others = [planned(problem, seed, "effort")[0] for seed in range(1, arguments.seeds)]
        efforts = [plan.control.effort for plan in others if counted(plan)]
        nlp = optimised(problem, merged.control, arguments.nlp) if arguments.nlp else None
        by_nlp = nlp.control.effort if nlp and counted(nlp) else np.nan
        effort = merged.control.effort
        least = np.nanmin([effort, by_nlp, *efforts])
        seconds.append(cpu)
        if counted(merged):
            ratios.append(effort / least)
        words = "at rest" if merged.details.get("stationary") else "held off surfaces"
        ending = words if counted(merged) else f"{merged.outcome.value}, crossing or not verified"
        listed = " ".join(f"{each:.4g}" for each in efforts)
        row = f"{joined.control.effort:.4g} | {effort:.4g} | {cpu:.1f} | {listed} | {by_nlp:.4g}"
        print(f"| {number} | {row} | {effort / least:.2f} | {ending} |", flush=True)
    if ratios:
        median, most = np.quantile(ratios, (0.5, 0.95))
        print(f"ratio: median {median:.2f}, 95 % {most:.2f}; CPU s: median {np.median(seconds):.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--numbers", type=int, nargs="+", default=[0, 3, 5, 6, 7, 8, 10, 11])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--nlp", type=int, default=0, help="intervals; 0: without")
    main(parser.parse_args())
