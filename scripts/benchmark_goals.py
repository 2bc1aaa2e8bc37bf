#!/usr/bin/env python3
"""How many goals each method reaches, with how many end-point evaluations, and what its plans cost.

reachable: end points of Λ₀ plus noise on five robots, for `step_rule: auto`, `adaptive` and the paper's (17).
workspace: poses drawn from the workspace of `default`, for `auto`, for the NLP from the same start, and for the NLP
started from auto's plan, with the effort of each (searches for least effort on the first --efforts goals only).
Success is what `nhpocp.solve` verifies; a solver's claim that the replay refutes is counted beside it.
Run: .venv/bin/python scripts/benchmark_goals.py reachable [--goals 100] [--robots default …]
     .venv/bin/python scripts/benchmark_goals.py workspace [--goals 200] [--nlp-iterations 200]
Rows are appended to results/goals-PART.jsonl as they come, and goals found there are not solved again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
from goals import ROBOTS, paper_task, reachable_goals, workspace_goal

from nhpocp import planning
from nhpocp.controls.control import Control
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution, Solver
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

Row = dict[str, Any]
INTERVALS = 50  # of the NLP, per manoeuvre of the plan that it starts from
MOST_INTERVALS = 100

REACHABLE: dict[str, Callable[[], Solver]] = {
    "auto": Auto,
    "adaptive": lambda: Continuation(step_rule=Adaptive()),
    "(17), γ=0.1": lambda: Continuation(step_rule=Euler(0.1)),
    "(17), γ=1": lambda: Continuation(step_rule=Euler(1.0)),
}


@dataclass(frozen=True)
class Given:
    """The NLP's guess: a control that is at hand."""

    given: Control
    kind: ClassVar[str] = "given"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        return self.given


def solved(problem: PlanningProblem, solver: Solver, method: str, **names: Any) -> tuple[Row, Solution]:
    """One verified solve as a row of the table."""
    began = perf_counter()
    solution = planning.solve(problem, solver)
    row = {
        **names,
        "method": method,
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "refuted": solution.outcome is Outcome.NOT_VERIFIED,
        "evaluations": solution.evaluations,
        "effort": solution.control.effort,
        "way": (solution.details.get("tried") or [{"way": ""}])[-1]["way"],
        "seconds": perf_counter() - began,
    }
    return row, solution


def reachable(robot: str, goal: Any, number: int) -> list[Row]:
    """Every method on one goal that is reachable by construction."""
    problem = paper_task(robot, goal=goal)
    return [
        solved(problem, make(), method, robot=robot, goal=number)[0] for method, make in REACHABLE.items()
    ]


def workspace(number: int, iterations: int, with_efforts: bool) -> list[Row]:
    """Every method on one pose of the workspace; those that look for least effort only where asked."""
    problem = paper_task("default")
    problem = replace(problem, goal=workspace_goal(problem, number))
    names = {"robot": "default", "goal": number}
    optimizer = Ipopt(max_iterations=iterations)
    rows = []
    row, plan = solved(problem, Auto(), "auto", **names)
    rows.append(row)
    rows.append(
        solved(problem, MultipleShooting(intervals=INTERVALS, optimizer=optimizer), "nlp", **names)[0]
    )
    if with_efforts:
        cheap = Auto(Continuation(step_rule=Adaptive(), objective="effort"))
        rows.append(solved(problem, cheap, "auto, effort", **names)[0])
    if with_efforts and plan.converged:
        pieces = len(getattr(plan.control.basis, "bases", (None,)))
        intervals = min(MOST_INTERVALS, INTERVALS * pieces)
        warm = MultipleShooting(intervals=intervals, guess=Given(plan.control), optimizer=optimizer)
        rows.append(solved(problem, warm, "nlp from auto", **names)[0])
    return rows


def tasks(
    arguments: argparse.Namespace,
) -> Iterable[tuple[Callable[..., list[Row]], tuple[Any, ...], tuple[str, int]]]:
    """(function, arguments, key) of everything asked for."""
    if arguments.part == "workspace":
        for number in range(arguments.goals):
            yield (
                workspace,
                (number, arguments.nlp_iterations, number < arguments.efforts),
                ("default", number),
            )
        return
    for robot in arguments.robots:
        for number, goal in enumerate(reachable_goals(paper_task(robot), arguments.goals)):
            yield reachable, (robot, goal, number), (robot, number)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Every row, from the file or new."""
    arguments.output.mkdir(parents=True, exist_ok=True)
    file = arguments.output / f"goals-{arguments.part}.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {(row["robot"], row["goal"]) for row in rows}
    asked = list(tasks(arguments))
    wanted = [task for task in asked if task[2] not in done]
    with ProcessPoolExecutor(arguments.workers) as pool, file.open("a") as target:
        for number, future in enumerate(as_completed([pool.submit(f, *a) for f, a, _ in wanted]), 1):
            for row in future.result():
                rows.append(row)
                target.write(json.dumps(row) + "\n")
            target.flush()
            print(f"{number} of {len(wanted)}", end="\r", flush=True)
    keys = {task[2] for task in asked}
    return [row for row in rows if (row["robot"], row["goal"]) in keys]


def table(rows: list[Row]) -> None:
    """Per robot and method: verified, false claims, medians; efforts against the best that any method found."""
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    best: dict[tuple[str, int], float] = {}
    for row in rows:
        if row["converged"]:
            key = row["robot"], row["goal"]
            best[key] = min(best.get(key, np.inf), row["effort"])
    print("| robot | method | verified | refuted claims | evaluations | seconds | effort / best |")
    print("|---|---|---|---|---|---|---|")
    for robot in robots:
        for method in methods:
            mine = [row for row in rows if row["robot"] == robot and row["method"] == method]
            if not mine:
                continue
            ratios = [row["effort"] / best[robot, row["goal"]] for row in mine if row["converged"]]
            print(
                f"| {robot} | {method} | {sum(row['converged'] for row in mine)} of {len(mine)} "
                f"| {sum(row['refuted'] for row in mine)} | {median(row['evaluations'] for row in mine):g} "
                f"| {median(row['seconds'] for row in mine):.2f} | {median(ratios):.2f} |"
                if ratios
                else f"| {robot} | {method} | 0 of {len(mine)} | 0 | – | – | – |"
            )
    for row in rows:
        if row["method"].startswith("auto") and not row["converged"]:
            print(f"{row['robot']} {row['goal']} {row['method']}: {row['outcome']}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("reachable", "workspace"))
    parser.add_argument("--goals", type=int, default=100)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--nlp-iterations", type=int, default=200)
    parser.add_argument("--efforts", type=int, default=200, help="goals for the searches for least effort")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("results"))
    table(run(parser.parse_args()))
