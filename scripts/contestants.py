"""Who takes part: scripts of one form, each with `build(*arguments)` that returns a function that solves.

A row of the table is one contestant on the paper's task: the warm solve (built once, solved again from the same guess),
the time until the first solve can start, the whole process, and what SciPy finds when it replays the control.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from statistics import median

import numpy as np
from measuring import SCRIPTS, cold_rounds, interleaved, medians
from replaying import replay

FRESH = 3  # rounds of fresh processes at most: they are long, and no wanted line depends on them
READY = """
from time import perf_counter as now
began = now()
import {module}
solve = {module}.build(*{arguments!r})
solve()
first = now()
solve()
print(2 * first - began - now())
"""


@dataclass(frozen=True)
class Contestant:
    """A script beside this one, and what it is called with."""

    name: str
    module: str
    arguments: tuple[str | int, ...] = ()
    harmonic: bool = True  # Λ over two harmonics, else v on equal intervals
    least: bool = True  # minimises ∫|v|²

    def build(self) -> Callable[[], tuple[float, np.ndarray]]:
        return import_module(self.module).build(*self.arguments)

    @property
    def command(self) -> list[str]:
        return [sys.executable, str(SCRIPTS / f"{self.module}.py"), *map(str, self.arguments)]

    def ready(self) -> float:
        """Seconds of imports and building in a fresh process: up to the first result, less a warm solve."""
        program = READY.format(module=self.module, arguments=self.arguments)
        said = subprocess.run(
            [sys.executable, "-c", program], cwd=SCRIPTS, check=True, capture_output=True, text=True
        )
        return float(said.stdout.splitlines()[-1])


@dataclass(frozen=True)
class Row:
    """What was measured of a contestant; times are medians."""

    name: str
    solve: float  # seconds, warm
    ready: float  # seconds
    cold: float  # seconds of the whole process
    megabytes: float  # peak of the whole process
    error: float  # E of the replay
    effort: float  # ∫|v|² of the replay
    objective: float  # ∫|v|² as the contestant says
    least: bool  # it looked for the least


def contestants(intervals: int, steps: int) -> list[Contestant]:
    """Ours, and the peers on the same task; ``steps`` are those of the peers that shoot over two harmonics."""
    ours = [
        Contestant(f"{name}, {evaluation}", "own", (method, evaluation), least=method == "null-space")
        for method, name in (
            ("auto", "continuation, auto"),
            ("unit", "continuation, γ = 1"),
            ("paper", "continuation, γ = 0.1"),
            ("null-space", "null-space optimum"),
        )
        for evaluation in ("compiled", "interpreted")
    ]
    return [
        *ours,
        *[
            Contestant(f"NLP, {evaluation}", "own", ("nlp", evaluation, intervals), harmonic=False)
            for evaluation in ("compiled", "interpreted")
        ],
        Contestant("Opti", "rival_opti", (intervals,), harmonic=False),
        Contestant("rockit", "rival_rockit", (intervals,), harmonic=False),
        Contestant("nlpsol", "rival_nlpsol", (intervals,), harmonic=False),
        Contestant("single shooting, L-BFGS", "rival_single_shooting", (steps,)),
        Contestant("least_squares, solve_ivp", "rival_least_squares", least=False),
        Contestant("plain (17), γ = 1", "rival_plain", (steps,), least=False),
    ]


def measured(taking_part: Sequence[Contestant], rounds: int) -> list[Row]:
    """Warm solves of all in interleaved rounds, then whole processes, then the times to be ready."""
    solvers = {one.name: one.build() for one in taking_part}
    answers = {name: solve() for name, solve in solvers.items()}
    warm = medians(interleaved(solvers, rounds))
    fresh = min(rounds, FRESH)
    processes = cold_rounds({one.name: one.command for one in taking_part}, fresh)
    ready: dict[str, list[float]] = {one.name: [] for one in taking_part}
    for _ in range(fresh):
        for one in taking_part:
            ready[one.name].append(one.ready())
    rows = []
    for one in taking_part:
        objective, control = answers[one.name]
        replayed = replay(control, one.harmonic)
        process = processes[one.name]
        rows.append(
            Row(
                name=one.name,
                solve=warm[one.name],
                ready=median(ready[one.name]),
                cold=process.seconds,
                megabytes=process.megabytes,
                error=replayed.error,
                effort=replayed.effort,
                objective=objective,
                least=one.least,
            )
        )
    return rows
