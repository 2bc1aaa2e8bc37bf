"""How many goals a second: the paper's start on `default` towards end points of Λ₀ plus noise, on one core and more."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cache
from statistics import median
from time import perf_counter
from types import TracebackType
from typing import Any, Self

from goals import paper_task, reachable_goals
from own import EVALUATION, SOLVERS

import nhpocp
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem

Goal = Mapping[str, Any]
ROBOT = "default"
METHOD = "auto"
BUDGET = 300.0  # seconds for the rounds of one number of goals; one round is always made
WARMING = 65  # plans a core, so many that each worker is handed some
VERIFIED = 50  # goals whose solutions are verified, untimed
UNCOMPILED = 100  # goals at most, without kernels


@cache
def task() -> PlanningProblem:
    """Made once, as its functions are."""
    return paper_task(ROBOT)


class Crew:
    """Cores that plan; the workers are there, and warm, before anything is timed."""

    def __init__(self, cores: int, evaluation: str) -> None:
        self.cores, self.evaluation, self.problem = cores, evaluation, task()
        self.solver = SOLVERS[METHOD](EVALUATION[evaluation](), 0)
        self.pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        if self.cores > 1:
            self.pool = ProcessPoolExecutor(self.cores, mp_context=multiprocessing.get_context("spawn"))
        self.plan([self.problem.goal] * (WARMING * self.cores))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.pool:
            self.pool.shutdown(cancel_futures=True)

    def plan(self, goals: Sequence[Goal]) -> int:
        """Plans to every goal; how many the solver claims to reach."""
        plans = nhpocp.plan_many(self.problem, goals, self.solver, self.pool)
        return sum(plan.outcome is Outcome.CONVERGED for plan in plans)


@dataclass
class Throughput:
    """Seconds for numbers of goals, by name of the way; how many were reached."""

    seconds: dict[str, dict[int, float]] = field(default_factory=dict)
    rounds: dict[int, int] = field(default_factory=dict)
    claimed: dict[str, int] = field(default_factory=dict)  # of the largest number
    verified: int = 0
    tried: int = 0  # of which so many were verified


def crew_name(cores: int, evaluation: str) -> str:
    return f"{evaluation}, {cores} core{'s' if cores > 1 else ''}"


def throughput(counts: Sequence[int], cores: Sequence[int], rounds: int) -> Throughput:
    """Every number of goals with every number of cores, in interleaved rounds; without kernels on one core only."""
    goals = reachable_goals(task(), max(counts))
    found = Throughput()
    with ExitStack() as stack:
        crews = {
            crew_name(number, evaluation): stack.enter_context(Crew(number, evaluation))
            for number, evaluation in [*((number, "compiled") for number in cores), (1, "interpreted")]
        }
        found.seconds = {name: {} for name in crews}
        for count in counts:
            going = {
                name: crew
                for name, crew in crews.items()
                if count <= UNCOMPILED or crew.evaluation == "compiled"
            }
            measure(found, going, goals[:count], rounds)
    verify = goals[:VERIFIED]
    found.tried = len(verify)
    found.verified = sum(is_verified(goal) for goal in verify)
    return found


def measure(found: Throughput, crews: Mapping[str, Crew], goals: Sequence[Goal], rounds: int) -> None:
    """Adds the median times for these goals."""
    times: dict[str, list[float]] = {name: [] for name in crews}
    began = perf_counter()
    for made in range(rounds):
        if made and (perf_counter() - began) * (made + 1) / made > BUDGET:
            break
        for name, crew in crews.items():
            start = perf_counter()
            found.claimed[name] = crew.plan(goals)
            times[name].append(perf_counter() - start)
        found.rounds[len(goals)] = made + 1
    for name, taken in times.items():
        found.seconds[name][len(goals)] = median(taken)


def is_verified(goal: Goal) -> bool:
    solve: Callable[..., Any] = nhpocp.solve
    return bool(
        solve(replace(paper_task(ROBOT), goal=goal), SOLVERS[METHOD](EVALUATION["compiled"](), 0)).converged
    )
