#!/usr/bin/env python3
"""How many of the goals among obstacles `auto` reaches, and what the NLP makes of its plans.

Worlds at random (`worlds.py`), half of them robots, half unicycles and cars, among 3 to 8 obstacles, some of them in
the way of the straight motion; a walk that keeps clear of them leads to every goal. Success is what `nhpocp.solve`
verifies; the least distance at 1001 times is measured again here, by fcl's own capsules, balls and convex bodies, and
has to be 0.99 of the bound.
Run: .venv/bin/python scripts/benchmark_worlds.py [--worlds 60] [--first 0] [--only robots] [--nlp] [--free]
Rows are appended to results/worlds.jsonl as they come, and worlds found there are not solved again.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from resumed import resumed
from worlds import World, least_distance, straight, world

from nhpocp import planning
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.guesses import SolverGuess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

Row = dict[str, Any]
KINDS = ("robots", "vehicles")  # in turn
KEPT = 0.99  # of the bound
SAME = 1 + 1e-6  # of two efforts


def solved(number: int, method: str) -> Row:
    """One world by one method, verified, as a row of the table; `cpu` [s] is this process's.

    method: "auto", "nlp" after it, or "free": auto as if nothing stood around, which says how far the way is blocked.
    """
    place = world(number)
    problem = place.problem
    if method == "free":
        problem = problem.with_(bounds={}, obstacles=())
    auto, cpu = Auto(Continuation(step_rule=Adaptive())), process_time()
    solver = MultipleShooting(guess=SolverGuess(auto)) if method == "nlp" else auto
    solution = planning.solve(problem, solver)
    tried = solution.details.get("tried") or [{"way": ""}]
    return {
        "world": number,
        "method": method,
        "model": problem.system.model,
        "obstacles": len(place.problem.obstacles),
        "bound": place.bound,
        "straight": least_distance(place.problem.system, straight(place.problem)),
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "refuted": solution.outcome is Outcome.NOT_VERIFIED,
        "distance": distance(place, solution),
        "effort": solution.control.effort,
        "evaluations": solution.evaluations,
        "way": tried[-1]["way"],
        "pieces": len(getattr(solution.control.basis, "bases", (None,))),
        "cpu": process_time() - cpu,
        "verdict": solution.verdict.method if solution.verdict else "",
        "message": solution.message,
    }


def distance(place: World, solution: Solution) -> float | None:
    """The least at the plan's samples; None without a plan."""
    system, trajectory = place.problem.system, solution.trajectory
    if not len(trajectory["t"]):
        return None
    names = system.state_space.names
    path = np.array(
        [
            system.state_space.pack({name: trajectory[name][k] for name in names})
            for k in range(len(trajectory["t"]))
        ]
    )
    return least_distance(system, path)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Every row, from the file or new."""
    methods = ["auto", *(["nlp"] if arguments.nlp else []), *(["free"] if arguments.free else [])]
    every = range(arguments.first, arguments.first + arguments.worlds)
    numbers = [number for number in every if arguments.only in (None, KINDS[number % 2])]
    asked = [(number, method) for number in numbers for method in methods]
    return resumed(arguments.output / "worlds.jsonl", ("world", "method"), asked, solved, arguments.workers)


def kept(row: Row) -> bool:
    """Whether a plan is verified and the distance measured here is that of the bound."""
    return bool(row["converged"] and row["distance"] is not None and row["distance"] >= KEPT * row["bound"])


def table(rows: list[Row]) -> None:
    """Per system and method; then what was not reached, with the reason."""
    of = {(row["world"], row["method"]): row for row in rows}
    print("| system | method | verified, distance kept | refuted claims | ways | CPU s: median, 95 %, most |")
    print("|---|---|---|---|---|---|")
    for method in ("auto", "nlp"):
        for model in [*dict.fromkeys(row["model"] for row in rows), None]:
            mine = [row for row in rows if row["method"] == method and model in (row["model"], None)]
            if not mine:
                continue
            times = ", ".join(f"{np.quantile([row['cpu'] for row in mine], q):.1f}" for q in (0.5, 0.95, 1.0))
            routes = sum("route" in row["way"] for row in mine if kept(row))
            ways = f"{routes} by a route" if method == "auto" else ""
            count, refuted = sum(map(kept, mine)), sum(row["refuted"] for row in mine)
            print(f"| {model or 'all'} | {method} | {count} of {len(mine)} | {refuted} | {ways} | {times} |")
    worlds = [row for row in rows if row["method"] == "auto"]
    blocked = sum(not row["straight"] >= row["bound"] for row in worlds)
    print(f"The straight motion is too near in {blocked} of {len(worlds)} worlds", end="")
    free = [row for row in rows if row["method"] == "free"]
    if free:
        near = sum(not (row["distance"] or -1) >= KEPT * row["bound"] for row in free)
        print(f", the plan that minds nothing in {near} of {len(free)}", end="")
    print(".")
    pairs = [(of[number, "auto"], row) for (number, method), row in of.items() if method == "nlp"]
    begun = [(auto, nlp) for auto, nlp in pairs if kept(auto)]
    if begun:
        good = sum(kept(nlp) and nlp["effort"] <= SAME * auto["effort"] for auto, nlp in begun)
        shares = [nlp["effort"] / auto["effort"] for auto, nlp in begun if kept(nlp)]
        median = f", in the median {np.median(shares):.3g} times as much" if shares else ""
        print(
            f"From those plans the NLP keeps the distance and costs no more in {good} of {len(begun)}{median}."
        )
    outcomes = Counter(
        (row["method"], row["outcome"]) for row in rows if not kept(row) and row["method"] != "free"
    )
    print(", ".join(f"{method} {outcome}: {count}" for (method, outcome), count in outcomes.most_common()))
    for row in sorted(rows, key=lambda row: (row["method"], row["world"])):
        if row["method"] != "free" and not kept(row):
            measured = (
                ""
                if row["distance"] is None
                else f" (distance {row['distance']:.3g}, bound {row['bound']:g})"
            )
            print(
                f"world {row['world']}, {row['model']}, {row['method']}: {row['outcome']}{measured}: "
                f"{row['message'][:500]}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first world")
    parser.add_argument("--only", choices=KINDS, help="half of the worlds")
    parser.add_argument("--nlp", action="store_true", help="the NLP from each plan too")
    parser.add_argument("--free", action="store_true", help="the plans that mind nothing too")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("results"))
    table(run(parser.parse_args()))
