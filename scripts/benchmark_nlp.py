#!/usr/bin/env python3
"""Times multiple shooting against two hand-written scripts for the same NLP.

`default`, N=50, one RK4 step per interval; building and solving are counted, verification is not. Interleaved rounds,
medians and ratios, since absolute times mean little on a shared machine. To be a fair rival, the careful script has to
beat the plain one by far.
Run: .venv/bin/python scripts/benchmark_nlp.py [ROUNDS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

import rival_nlpsol
import rival_opti

import nhpocp
from nhpocp.solvers.multiple_shooting import MultipleShooting

INTERVALS = 50
OPTIMUM = 2.05082  # [physics §2]
PROBLEM = nhpocp.load_problem(Path(__file__).parents[1] / "problems" / "paper.yaml")


def ours() -> float:
    solution = MultipleShooting(intervals=INTERVALS, steps_per_interval=1).solve(PROBLEM)
    return float(solution.details["objective_value"])


WAYS: dict[str, Callable[[], float]] = {
    "nhpocp": ours,
    "nlpsol": lambda: rival_nlpsol.solve(INTERVALS)[0],
    "opti": lambda: rival_opti.solve(INTERVALS)[0],
}


def main(rounds: int) -> None:
    times: dict[str, list[float]] = {name: [] for name in WAYS}
    for _ in range(rounds):
        for name, solve in WAYS.items():
            began = perf_counter()
            found = solve()
            times[name].append(perf_counter() - began)
            if abs(found - OPTIMUM) > 1e-5:
                sys.exit(f"{name} found {found:.8f}; expected {OPTIMUM}")
    print(f"build + solve, N={INTERVALS}, {rounds} rounds")
    for name, found_times in times.items():
        print(f"  {name:8} median {median(found_times):.3f} s   least {min(found_times):.3f} s")
    for one, other, limit in (("nhpocp", "nlpsol", 1.0), ("nlpsol", "opti", 0.45)):
        ratio = median(times[one]) / median(times[other])
        print(f"  {one} / {other}: {ratio:.2f} (wanted: at most {limit:g})")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 7)
