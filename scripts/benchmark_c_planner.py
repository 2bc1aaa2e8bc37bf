#!/usr/bin/env python3
"""Times a planner in C against Python's own `auto`, and holds its plans against Python's.

`default`, the paper's start and Λ₀, goals that are end points of Λ₀ plus noise (`reachable_goals`). Each is planned by
what `nhpocp export --format c-planner` writes, compiled with -O3 -march=native, then by `auto` with compiled kernels,
in turn and on one core: medians of CPU seconds a plan, and of the ratio goal by goal. The coefficients are held against
`step_rule: adaptive`, of which a planner is the C text.
Run: .venv/bin/python scripts/benchmark_c_planner.py [--goals 200] [--repeats 20]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
from compiled_planner import Answer, CompiledPlanner
from goals import paper_task, reachable_goals
from measuring import circumstances

from nhpocp.flow.compiled.kernels import Compiled, Kernels
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.machine.export.planner.c_planner import write_planner
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive

FLAGS = ("-O3", "-march=native")
CLOSE = 1e-9  # between coefficients
MOST = 0.5e-3  # seconds a plan
RATIO = 4.0  # that `auto` takes as long as a planner, at least


@dataclass(frozen=True)
class Row:
    """One goal: what the planner says, how far its coefficients are from Python's, and CPU seconds of `auto`."""

    answer: Answer
    outcome: str
    difference: float
    seconds: float


def compared(count: int, repeats: int, kernels: Kernels) -> list[Row]:
    """So many goals, one after another; kernels: Python's."""
    problem = paper_task("default")
    method = Continuation(step_rule=Adaptive(), integrator=RungeKutta4(kernels=kernels))
    auto, rows = Auto(method), []
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "planner.c"
        write_planner(problem, method, source)
        planner = CompiledPlanner(source, FLAGS)
        auto.solve(problem)  # its kernel is there before anything is timed
        for goal in reachable_goals(problem, count):
            task = problem.towards(goal)
            (answer,) = planner.plans([(task.start_point, task.goal_point, None)], repeats)
            began = process_time()
            auto.solve(task)
            seconds = process_time() - began
            plan = method.find(task)
            difference = np.abs(answer.coefficients - plan.control.coefficients.ravel()).max()
            rows.append(Row(answer, plan.outcome.value, float(difference), seconds))
    return rows


def report(rows: list[Row]) -> int:
    """0 where every plan is Python's; times are said, and no verdict."""
    endings = Counter((row.answer.status, row.outcome) for row in rows)
    worst = max(row.difference for row in rows)
    ours, others = (
        median(seconds) for seconds in zip(*((row.answer.seconds, row.seconds) for row in rows), strict=True)
    )
    ratio = median(row.seconds / row.answer.seconds for row in rows)
    where = circumstances()
    print(
        f"{len(rows)} goals; {where['processor']}, {where['compiler']}, load {where['load']}, {where['date']}"
    )
    print(
        "  endings in C, in Python: "
        + ", ".join(f"{one}, {other}: {n}" for (one, other), n in endings.items())
    )
    print(f"  evaluations, median: {median(row.answer.evaluations for row in rows):g}")
    print(f"  coefficients differ by {worst:.2g} (wanted: at most {CLOSE:g})")
    print(f"  planner in C, median: {1e3 * ours:.3f} ms (wanted: at most {1e3 * MOST:g})")
    print(
        f"  auto in Python, median: {1e3 * others:.3f} ms; {ratio:.2f} times as long (wanted: at least {RATIO:g})"
    )
    alike = all(row.answer.status == row.outcome for row in rows)
    return 0 if alike and worst <= CLOSE else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument(
        "--repeats", type=int, default=20, help="of a plan in C, whose clock has steps of 1 µs"
    )
    asked = parser.parse_args()
    sys.exit(report(compared(asked.goals, asked.repeats, Compiled())))
