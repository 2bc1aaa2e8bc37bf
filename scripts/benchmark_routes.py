#!/usr/bin/env python3
"""How many of the goals that are connected to the start `auto` reaches, with routes and without.

Robots at random (A 10-40, B 4-20, β ±40…±90 degrees, each w4 axis, Veselova and Suslov) on starts that are clear of
their singular surfaces; goals are ends of random walks of the pose that stay clear, on the start's side and above the
base, far ones among them. Success is what `nhpocp.solve` verifies; a claim that the replay refutes is counted beside.
Run: .venv/bin/python scripts/benchmark_routes.py [--goals 300] [--first 0] [--routes auto never] [--objective none]
Rows are appended to results/routes.jsonl as they come, and goals found there are not solved again.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from goals import random_robot_task, walked_goal
from resumed import resumed

from nhpocp import planning
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive

Row = dict[str, Any]
FAR = np.radians(90)


def solved(number: int, route: str, objective: str) -> Row:
    """One goal by `auto`, verified, as a row of the table; `cpu` [s] is this process's."""
    task = random_robot_task(number)
    problem = task.towards(walked_goal(task, number))
    space = problem.system.state_space
    moved = np.asarray(space.difference(problem.goal_point, problem.start_point))
    solver = Auto(Continuation(step_rule=Adaptive(), objective=objective), route=route)
    began, cpu = perf_counter(), process_time()
    solution = planning.solve(problem, solver)
    tried = solution.details.get("tried") or [{"way": ""}]
    return {
        "goal": number,
        "route": route,
        "objective": objective,
        "turn": float(np.linalg.norm(moved[3:])),
        "tilt": float(np.arccos(np.clip(space.unpack(problem.goal_point)["orientation"][2, 2], -1, 1))),
        "distance": float(np.linalg.norm(moved[:3])),
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "refuted": solution.outcome is Outcome.NOT_VERIFIED,
        "crossings": len(solution.verdict.crossings) if solution.verdict else None,
        "evaluations": solution.evaluations,
        "effort": solution.control.effort,
        "way": tried[-1]["way"],
        "pieces": len(getattr(solution.control.basis, "bases", (None,))),
        "seconds": perf_counter() - began,
        "cpu": process_time() - cpu,
        "message": "" if solution.converged else solution.message,
    }


def run(arguments: argparse.Namespace) -> list[Row]:
    """Every row, from the file or new."""
    asked = [
        (number, route, arguments.objective)
        for number in range(arguments.first, arguments.first + arguments.goals)
        for route in arguments.routes
    ]
    return resumed(
        arguments.output / "routes.jsonl", ("goal", "route", "objective"), asked, solved, arguments.workers
    )


def table(rows: list[Row]) -> None:
    """Per setting of `route`, of all goals and of the far ones; then those that were not reached, with the reason."""
    print(
        "| route | goals | verified | refuted claims | crossing det W | seconds: median, 95 %, most | CPU s: the same |"
    )
    print("|---|---|---|---|---|---|---|")
    for route in dict.fromkeys(row["route"] for row in rows):
        mine = [row for row in rows if row["route"] == route]
        far = [row for row in mine if max(row["turn"], row["tilt"]) > FAR]
        for name, part in (("all", mine), ("turn or tilt > 90°", far)):
            if not part:
                continue
            times = [
                ", ".join(f"{np.quantile([row[key] for row in part], q):.2f}" for q in (0.5, 0.95, 1.0))
                for key in ("seconds", "cpu")
            ]
            counts = [sum(bool(row[key]) for row in part) for key in ("converged", "refuted", "crossings")]
            verified, refuted, crossing = counts
            print(
                f"| {route} | {name} | {verified} of {len(part)} | {refuted} | {crossing} | {times[0]} | {times[1]} |"
            )
    for row in sorted(rows, key=lambda row: row["goal"]):
        if not row["converged"]:
            print(f"goal {row['goal']}, route {row['route']}: {row['outcome']}: {row['message'][:400]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first goal")
    parser.add_argument("--routes", nargs="+", default=["auto", "never"], choices=("auto", "always", "never"))
    parser.add_argument("--objective", default="none")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("results"))
    table(run(parser.parse_args()))
