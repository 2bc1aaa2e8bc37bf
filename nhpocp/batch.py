"""Many goals, one problem otherwise: a control for each and nothing that no reader asked for. The base of sweeps."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from nhpocp.controls.control import Control
from nhpocp.planning import default_solver, refused
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Solver

CHUNK = 64  # goals that a worker is handed at once


@dataclass(frozen=True)
class Plan:
    """What a solver claims of one goal; `nhpocp.solve` with this control as its start verifies it."""

    outcome: Outcome
    message: str
    error: float  # E as the solver believes
    control: Control
    evaluations: int


def plan_many(
    problem: PlanningProblem,
    goals: Iterable[Mapping[str, Any]],
    solver: Solver | None = None,
    executor: Executor | None = None,
) -> Iterator[Plan]:
    """A `Plan` for each goal, in their order, by ``solver`` (the problem's own Jacobian method), unverified.

    Functions and kernels are made once a process. ``executor``: where to plan, a ProcessPoolExecutor for more cores;
    None: here, one goal when it is asked for. Errors: `InvalidProblemError` for a goal that is none; Ctrl-C ends the
    series with `KeyboardInterrupt`, and what was handed out before stays good.
    """
    solver = solver or default_solver(problem)
    if executor is None:
        yield from (_planned(problem, goal, solver) for goal in goals)
        return
    payload, goals = pickle.dumps((problem, solver)), list(goals)
    parts = [goals[first : first + CHUNK] for first in range(0, len(goals), CHUNK)]
    chunks = [executor.submit(_planned_elsewhere, payload, part) for part in parts]
    try:
        for chunk in chunks:
            yield from chunk.result()
    finally:
        for chunk in chunks:
            chunk.cancel()


def _planned(problem: PlanningProblem, goal: Mapping[str, Any], solver: Solver) -> Plan:
    problem = problem.towards(goal)
    found = refused(problem, solver) or solver.solve(problem)
    if found.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return Plan(found.outcome, found.message, found.final_error, found.control, found.evaluations)


def _planned_elsewhere(payload: bytes, goals: Sequence[Mapping[str, Any]]) -> list[Plan]:
    problem, solver = _unpacked(payload)
    return [_planned(problem, goal, solver) for goal in goals]


@lru_cache(maxsize=4)  # what is made for a system is kept beside it
def _unpacked(payload: bytes) -> tuple[PlanningProblem, Solver]:
    problem, solver = pickle.loads(payload)
    return problem, solver
