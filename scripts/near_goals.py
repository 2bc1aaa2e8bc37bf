#!/usr/bin/env python3
"""Two hundred goals near the start, from a file of defaults: how many are verified, and what the least effort is worth.

Each coordinate of the pose alone, all pairs, and all of them, by at most 5 and 30°, on four presets (`near_goal`, with
the goal's number as its seed). `auto` is the file as `nhpocp init` writes it with another goal; `auto, effort` the same
with `objective: effort`, to be held against what anything else finds: other seeds, the search from one start, the NLP
over the file's basis and over 50 constant pieces, both from auto's plans (120 iterations of IPOPT). Rows are appended
to results/near-goals.jsonl, and a run goes on where the last one ended.
Run: .venv/bin/python scripts/near_goals.py [--goals 200] [--every 9] [--workers 2] [-o FOLDER]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from goals import NEAR, near_goal, paper_task

from nhpocp import planning
from nhpocp.solution import Solution
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.guesses import SolverGuess
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

PRESETS = ("default", "normal75", "vertical_equal", "paper_conjecture")
ITERATIONS = 120  # of IPOPT
OTHER_SEEDS = (1000, 2000)
OURS, PIECES = "auto, effort", "nlp, 50 pieces"  # the method in question, and the one over another basis
CHEAP = Continuation(step_rule=Adaptive(), objective="effort")

Row = dict[str, Any]


def methods() -> Mapping[str, Any]:
    """Every method by its name."""
    nlp = {"optimizer": Ipopt(max_iterations=ITERATIONS)}
    return {
        "auto": Auto(),
        OURS: Auto(CHEAP),
        "one start, effort": CHEAP,
        **{f"{OURS}, seed {seed}": Auto(replace(CHEAP, seed=seed)) for seed in OTHER_SEEDS},
        "nlp over the basis": MultipleShooting(
            over_basis=True, intervals=25, guess=SolverGuess(Auto()), **nlp
        ),
        PIECES: MultipleShooting(intervals=50, guess=SolverGuess(Auto(CHEAP)), **nlp),
    }


def goal_rows(number: int) -> list[Row]:
    """What every method makes of one goal."""
    preset = PRESETS[number % len(PRESETS)]
    problem = paper_task(preset)
    problem = replace(problem, goal=near_goal(problem, number // len(PRESETS)))
    rows = []
    for method, solver in methods().items():
        began = perf_counter()
        solution: Solution = planning.solve(problem, solver)
        rows.append(
            {
                "goal": number,
                "preset": preset,
                "moved": NEAR[number // len(PRESETS)],
                "method": method,
                "outcome": solution.outcome.value,
                "verified": solution.converged,
                "effort": solution.control.effort,
                "doubted": any("may be far from the least" in words for words in solution.warnings),
                "evaluations": solution.evaluations,
                "seconds": perf_counter() - began,
            }
        )
    return rows


def run(arguments: argparse.Namespace) -> list[Row]:
    """Every row, from the file or new."""
    arguments.output.mkdir(parents=True, exist_ok=True)
    file = arguments.output / "near-goals.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    wanted = sorted(set(arguments.numbers) - {row["goal"] for row in rows})
    with ProcessPoolExecutor(arguments.workers) as pool, file.open("a") as target:
        for job in as_completed([pool.submit(goal_rows, number) for number in wanted]):
            rows += job.result()
            target.writelines(json.dumps(row) + "\n" for row in job.result())
            target.flush()
    return [row for row in rows if row["goal"] in arguments.numbers]


def ratios(rows: list[Row], within: list[str]) -> dict[int, float]:
    """Effort of the method in question over the least verified one of these methods, by goal."""
    ours = {row["goal"]: row["effort"] for row in rows if row["method"] == OURS and row["verified"]}
    return {
        goal: effort
        / min(
            row["effort"]
            for row in rows
            if row["goal"] == goal and row["verified"] and row["method"] in within
        )
        for goal, effort in ours.items()
    }


def report(rows: list[Row]) -> None:
    """Counts and medians by method, then quantiles of the effort over the least."""
    names = list(methods())
    for method in names:
        mine = [row for row in rows if row["method"] == method]
        evaluations, seconds = (np.median([row[key] for row in mine]) for key in ("evaluations", "seconds"))
        verified = sum(row["verified"] for row in mine)
        print(
            f"{method:28} {verified:3} of {len(mine)} verified, {evaluations:5g} evaluations, {seconds:5.2f} s"
        )
    same_basis = [name for name in names if name != PIECES]
    for words, within in (("over the same basis", same_basis), ("of any control", names)):
        for preset in ("all", *PRESETS):
            chosen = [row for row in rows if preset in ("all", row["preset"])]
            values = np.array(list(ratios(chosen, within).values()))
            if values.size:
                quantiles = " ".join(f"{np.quantile(values, q):.4f}" for q in (0.5, 0.9, 0.95, 1.0))
                share = np.mean(values <= 1.1)
                print(
                    f"effort over the least {words}, {preset}: 50, 90, 95, 100 %: {quantiles}; <= 1.1: {share:.1%}"
                )
    doubted = {row["goal"] for row in rows if row["method"] == OURS and row["doubted"]}
    poor = {goal for goal, ratio in ratios(rows, same_basis).items() if ratio > 1.1}
    print(
        f"above 1.1 over the same basis: {sorted(poor)}; with a warning {len(poor & doubted)} of {len(poor)}"
    )
    failed = [row["goal"] for row in rows if row["method"] == "auto" and not row["verified"]]
    print(f"warned of: {len(doubted)}; not reached by auto: {failed}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--every", type=int, default=1, help="of the goals: a sample of all kinds")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("results"))
    asked = parser.parse_args()
    asked.numbers = range(0, asked.goals, asked.every)
    report(run(asked))
