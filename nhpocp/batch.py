"""Many goals, one problem otherwise: a control for each and nothing that no reader asked for. The base of sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import islice
from typing import Any

from nhpocp.controls.control import Control
from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import Interruption
from nhpocp.outcome import Outcome
from nhpocp.planning import default_solver, refused
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solver
from nhpocp.solvers.continuation.lockstep import reached_together
from nhpocp.solvers.workers import awaited, packed, permit, submitted, unpacked

TOGETHER = 64  # goals planned at once; more gain little
FEW = 3  # goals: fewer are planned faster one by one


@dataclass(frozen=True)
class Plan:
    """What a solver claims of one goal; `nhpocp.solve` with this control as its start verifies it.

    outcome, message: how it ended, in words. error: E as the solver believes [rad]. control: the last `Control`.
    evaluations: of the end point.
    """

    outcome: Outcome
    message: str
    error: float  # E as the solver believes
    control: Control
    evaluations: int

    def __repr__(self) -> str:
        return (
            f"<Plan {self.outcome.value}: E = {self.error:.3g}, {self.evaluations} evaluations, unverified>"
        )


def plan_many(
    problem: PlanningProblem,
    goals: Iterable[Mapping[str, Any]],
    solver: Solver | None = None,
    executor: Executor | None = None,
    together: int = TOGETHER,
) -> Iterator[Plan]:
    """A `Plan` for each goal, in their order, by ``solver`` (the problem's own Jacobian method), unverified.

    Functions and kernels are made once a process. ``executor``: where to plan, a ProcessPoolExecutor for more cores;
    None: here. So many goals are taken ``together`` as the first of them is asked for, and planned side by side where
    the method is an adaptive continuation; memory grows with them. Errors: `InvalidProblemError` for a goal that is
    none, after the plans for those before it; what ``goals`` itself raises comes before the plans for the goals that
    were taken with it. The same for a problem that cannot be sent to other processes, before all plans. Ctrl-C ends the
    series with `KeyboardInterrupt`; no more is begun elsewhere, and what was handed out before stays good.
    """
    if together < 1:
        raise InvalidProblemError(f"together is {together}; expected the number of goals to plan to at once")
    solver = solver or default_solver(problem)
    if executor is None:
        series = iter(goals)
        while part := list(islice(series, together)):
            yield from _planned(problem, part, solver)
        return
    payload, goals = packed((problem, solver)), list(goals)
    parts = [goals[first : first + together] for first in range(0, len(goals), together)]
    with permit() as given:
        chunks = [submitted(executor, given, _planned_elsewhere, payload, part) for part in parts]
        try:
            for chunk in chunks:
                with Interruption() as interruption:
                    plans, wrong = awaited(chunk, interruption)
                yield from plans
                if wrong:
                    raise wrong
        finally:
            for chunk in chunks:
                chunk.cancel()


def _planned(problem: PlanningProblem, goals: Sequence[Mapping[str, Any]], solver: Solver) -> Iterator[Plan]:
    problems, wrong = [], None
    for goal in goals:
        try:
            problems.append(problem.towards(goal))
        except InvalidProblemError as error:
            wrong = error  # but those before it are planned
            break
    together = reached_together(solver, problems) if len(problems) >= FEW else [None] * len(problems)
    for towards, reached in zip(problems, together, strict=True):
        if reached:
            control = towards.control(reached.coefficients)
            message = f"{reached.message}."
            yield Plan(Outcome.CONVERGED, message, reached.error, control, reached.evaluations)
            continue
        solution = refused(towards, solver) or solver.solve(towards)
        if solution.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        yield Plan(
            solution.outcome, solution.message, solution.final_error, solution.control, solution.evaluations
        )
    if wrong:
        raise wrong


def _planned_elsewhere(
    payload: bytes, goals: Sequence[Mapping[str, Any]]
) -> tuple[list[Plan], InvalidProblemError | None]:
    """The plans before the first goal that is none, and what is wrong with that one."""
    problem, solver = unpacked(payload)
    plans: list[Plan] = []
    try:
        plans.extend(_planned(problem, goals, solver))
    except InvalidProblemError as error:
        return plans, error
    return plans, None
