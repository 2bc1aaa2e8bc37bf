#!/usr/bin/env python3
"""What the NLP makes of `auto`'s plan (`nlp: {initial: jacobian}`), every other setting at its default.

Goals are poses drawn from the workspace of `default`, and end points of Λ₀ plus noise on the other robots. Success is
what `nhpocp.solve` verifies; dearer is what costs more than the plan that `auto` handed over, by its own word.
Run: .venv/bin/python scripts/benchmark_warm_start.py [--goals 200] [--first 0] [--every 1] [--robots default …]
Rows are appended to results/warm-start.jsonl as they come, and goals found there are not solved again.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, ClassVar

import numpy as np
from goals import ROBOTS, paper_task, reachable_goals, workspace_goal
from resumed import resumed

from nhpocp import planning
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.nlp.guesses import SolverGuess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

Row = dict[str, Any]
ROUNDING = 1e-9


@dataclass
class Kept:
    """`Auto`, and what it handed over."""

    solver: Auto = field(default_factory=Auto)
    plan: Solution | None = None
    cpu: float = 0.0
    name: ClassVar[str] = "jacobian"

    @property
    def tolerance(self) -> float:
        return self.solver.tolerance

    def settings(self) -> dict[str, Any]:
        return self.solver.settings()

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        began = process_time()
        self.plan = self.solver.solve(problem, progress)
        self.cpu = process_time() - began
        return self.plan


def goal_of(problem: PlanningProblem, number: int) -> Mapping[str, Any]:
    """Goal ``number`` of a robot."""
    if problem.name == "default":
        return workspace_goal(problem, number)
    return reachable_goals(problem, number + 1)[number]


def solved(robot: str, number: int) -> Row:
    """One goal, verified, as a row of the table; `cpu` [s] is this process's."""
    task = paper_task(robot)
    problem, kept = task.towards(goal_of(task, number)), Kept()
    began, cpu = perf_counter(), process_time()
    solution = planning.solve(problem, MultipleShooting(guess=SolverGuess(kept)))
    details, plan = solution.details, kept.plan
    ended = "optimum"
    if "handed_back" in details:
        ended = "less" if details["objective_value"] < details["handed_back"]["plan"] else "plan"
    elif not details.get("certified", True):
        ended = "uncertified"
    return {
        "robot": robot,
        "goal": number,
        "plan": plan.control.effort if plan else None,
        "plan_outcome": plan.outcome.value if plan else None,
        "pieces": len(getattr(plan.control.basis, "bases", (None,))) if plan else None,
        "plan_cpu": kept.cpu,
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "refuted": solution.outcome is Outcome.NOT_VERIFIED,
        "ended": ended,
        "effort": solution.control.effort,
        "attempts": [
            f"{attempt['guess']}: {attempt['outcome']} after {attempt['iterations']}"
            for attempt in details.get("attempts", [])
        ],
        "iterations": len(solution.iterations),
        "seconds": perf_counter() - began,
        "cpu": process_time() - cpu,
        "message": solution.message,
    }


def dearer(row: Row) -> bool:
    """Whether it costs more than the plan that it began with."""
    return bool(row["plan_outcome"] == "converged" and row["effort"] > (1 + ROUNDING) * row["plan"])


def run(arguments: argparse.Namespace) -> list[Row]:
    """Every row, from the file or new."""
    numbers = range(arguments.first, arguments.first + arguments.goals, arguments.every)
    asked = [(robot, number) for robot in arguments.robots for number in numbers]
    return resumed(arguments.output / "warm-start.jsonl", ("robot", "goal"), asked, solved, arguments.workers)


def table(rows: list[Row]) -> None:
    """Per robot: verified, how they ended, dearer; how the first NLP ended; what failed or is dearer."""
    print(
        "| robot | verified | optimum | handed back at less | handed back as it was | dearer | effort / plan: "
        "median, 95 %, most | CPU s: the same |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for robot in dict.fromkeys(row["robot"] for row in rows):
        mine = [row for row in rows if row["robot"] == robot]
        good = [row for row in mine if row["converged"]]
        ended = Counter(row["ended"] for row in good)
        counted = f"{ended['optimum']} | {ended['less']} | {ended['plan'] + ended['uncertified']}"
        ratios = [row["effort"] / row["plan"] for row in good if row["plan_outcome"] == "converged"]
        figures = [
            ", ".join(f"{np.quantile(values, q):.2f}" for q in (0.5, 0.95, 1.0)) if values else "–"
            for values in (ratios, [row["cpu"] for row in mine])
        ]
        print(
            f"| {robot} | {len(good)} of {len(mine)} | {counted} | {sum(map(dearer, good))} "
            f"| {figures[0]} | {figures[1]} |"
        )
    first = Counter(row["attempts"][0].split(" after ")[0] if row["attempts"] else "optimum" for row in rows)
    print("From the plan the NLP ended as: " + "; ".join(f"{name} {n}" for name, n in first.most_common()))
    for row in sorted(rows, key=lambda row: (row["robot"], row["goal"])):
        if not row["converged"]:
            print(f"{row['robot']} {row['goal']}: {row['outcome']}: {row['message'][:400]}")
        elif dearer(row):
            print(
                f"{row['robot']} {row['goal']}: {row['effort']:.6g} for {row['plan']:.6g}: {row['message'][:200]}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first goal")
    parser.add_argument("--every", type=int, default=1, help="of so many goals one")
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=["default"])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("results"))
    table(run(parser.parse_args()))
