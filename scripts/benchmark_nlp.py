#!/usr/bin/env python3
"""Times multiple shooting against two hand-written scripts for the same NLP.

`default`, N=50, one RK4 step per interval; building and solving are counted, verification is not. Interleaved rounds,
medians and ratios, since absolute times mean little on a shared machine. To be a fair rival, the careful script has to
beat the plain one by far. Cold: a system that this process has not met, a new solver. Warm: the same through the same
solver a second time. Never: without compiled kernels. Stored: the kernel is in the cache, and loaded.
Run: .venv/bin/python scripts/benchmark_nlp.py [ROUNDS]
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

import rival_nlpsol
import rival_opti

import nhpocp
from nhpocp.flow.compiled.kernels import Compiled, Interpreted, Kernels
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting

INTERVALS = 50
OPTIMUM = 2.05082  # [physics §2]
CLOSE = 1e-6  # between the ways, of the same discrete problem
FILE = Path(__file__).parents[1] / "problems" / "paper.yaml"
WANTED = [  # (one, other, at most)
    ("ours, cold, never", "nlpsol, cold", 1.0),
    ("ours, warm, never", "nlpsol, warm", 1.0),
    ("ours, cold, stored", "nlpsol, cold", 0.25),
    ("ours, warm, stored", "nlpsol, cold", 0.25),
    ("ours, warm, stored", "nlpsol, warm", 1.0),
    ("nlpsol, cold", "opti, cold", 0.45),
]
PEAK = """
import sys
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.provenance import peak_memory, reset_peak_memory
sys.path.insert(0, {folder!r})
import benchmark_nlp, rival_nlpsol
before = (reset_peak_memory(), peak_memory())[1]
{solve}
print(peak_memory() - before)
"""


def solved(solver: MultipleShooting, problem: nhpocp.PlanningProblem) -> float:
    return float(solver.solve(problem).details["objective_value"])


def fresh(kernels: Kernels) -> tuple[MultipleShooting, nhpocp.PlanningProblem]:
    """What is made for a system is kept beside it, and a file that is read again makes a new one."""
    solver = MultipleShooting(intervals=INTERVALS, steps_per_interval=1, kernels=kernels)
    return solver, nhpocp.load_problem(FILE)


def one_round(note: Callable[[str, Callable[[], float]], None]) -> None:
    for name, kernels in (("never", Interpreted()), ("stored", Compiled())):
        ours = fresh(kernels)
        note(f"ours, cold, {name}", lambda ours=ours: solved(*ours))  # type: ignore[misc]
        note(f"ours, warm, {name}", lambda ours=ours: solved(*ours))  # type: ignore[misc]
    note("nlpsol, cold", lambda: rival_nlpsol.solve(INTERVALS)[0])
    again = rival_nlpsol.build(INTERVALS)
    note("nlpsol, warm", lambda: again()[0])
    note("opti, cold", lambda: rival_opti.solve(INTERVALS)[0])


def peaks() -> None:
    """Memory that a cold solve adds to a process that has imported everything [MB]."""
    ours = "benchmark_nlp.solved(*benchmark_nlp.fresh({}()))"
    for name, solve in (
        ("ours, never", ours.format("Interpreted")),
        ("ours, stored", ours.format("Compiled")),
        ("nlpsol", f"rival_nlpsol.solve({INTERVALS})"),
    ):
        code = PEAK.format(folder=str(Path(__file__).parent), solve=solve)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        print(f"  {name:20} peak {float(done.stdout):6.1f} MB above imports")


def main(rounds: int) -> None:
    times: dict[str, list[float]] = {}

    def note(name: str, solve: Callable[[], float]) -> None:
        began = perf_counter()
        found[name] = solve()
        times.setdefault(name, []).append(perf_counter() - began)
        if abs(found[name] - OPTIMUM) > 1e-5:
            sys.exit(f"{name} found {found[name]:.8f}; expected {OPTIMUM}")

    began = perf_counter()
    solved(*fresh(Compiled()))
    print(f"first solve, its kernel built or found: {perf_counter() - began:.2f} s")
    for _ in range(rounds):
        found: dict[str, float] = {}
        one_round(note)
        if max(found.values()) - min(found.values()) > CLOSE:
            sys.exit(f"the optima differ: {found}")
    print(f"N={INTERVALS}, {rounds} rounds")
    for name, found_times in times.items():
        print(f"  {name:20} median {median(found_times):.3f} s   least {min(found_times):.3f} s")
    for one, other, limit in WANTED:
        ratio = median(times[one]) / median(times[other])
        print(f"  {one} / {other}: {ratio:.2f} (wanted: at most {limit:g})")
    peaks()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 7)
