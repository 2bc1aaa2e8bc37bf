"""Runs performed, in whatever process: from the texts of a study and the numbers of runs to rows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from nhpocp import planning
from nhpocp.batch import FEW, Plan, plan_many
from nhpocp.comparison import FAILURES
from nhpocp.controls.control import Control
from nhpocp.errors import InvalidProblemError, one_line
from nhpocp.interruption import Interruption
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import build
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.states import State, plain_state
from nhpocp.problem_file.variants import overrides as settings_of
from nhpocp.solution import Solution, Solver
from nhpocp.solution_folder import to_json
from nhpocp.solution_folder.reading import read_control
from nhpocp.solvers.claimed import claimed
from nhpocp.study.store import COLUMNS, Row
from nhpocp.study.study import Study, changed_goal, read_problem, read_study_text
from nhpocp.systems.margins import margin
from nhpocp.verification import verify, verify_many

JSON = ("parameters", "margins", "extremes", "limits", "warnings", "settings", "solved_control")


@dataclass(frozen=True)
class Source:
    """The texts that a study is read from, wherever it is performed; trials: those proposed so far, as JSON."""

    text: str
    file: str
    problem_text: str
    trials: str | None = None

    @staticmethod
    def of(study: Study) -> Source:
        trials = study.design.trials
        levels = json.dumps(trials.levels) if trials else None
        return Source(study.text, f"{study.name}.yaml", study.problem_text, levels)


@dataclass(frozen=True)
class Job:
    """Runs by one solver that differ in their goals alone.

    chained: each begins with the plan to the goal before it; start: the control, as stored, that the first begins with.
    tries: how often they have been begun, this time included.
    """

    runs: tuple[int, ...]
    chained: bool = False
    start: str | None = None
    tries: int = 1


@dataclass(frozen=True)
class _Setting:
    """What the runs of a job have in common: the problem at its first run, the goal as written, the solver."""

    problem: PlanningProblem
    goal: dict[str, Any]
    solver: Solver


@lru_cache(maxsize=2)
def _read(text: str, file: str, problem_text: str) -> Study:
    return read_study_text(text, file, problem_text)


@lru_cache(maxsize=2)
def _study(source: Source) -> Study:
    study = _read(source.text, source.file, source.problem_text)
    return study.proposed([tuple(level) for level in json.loads(source.trials)]) if source.trials else study


@lru_cache(maxsize=4)
def _setting(problem_text: str, others: str, solver: str) -> _Setting:
    """others: the parameters that are not of the goal, as JSON."""
    file = read_problem(problem_text, None, json.loads(others), solver)
    problem, name = build(file), settings_of(solver)[0]
    return _Setting(
        problem.with_(pictures=False),
        file.data.model_dump(mode="json", exclude_none=True)["goal"],
        planning.own_solver(problem, name),
    )


def performed(source: Source, job: Job) -> list[Row]:
    """The rows of a job's runs; without those that were stopped before their end.

    Errors: `KeyboardInterrupt` where they are no longer wanted.
    """
    study = _study(source)
    rows, planned = [], []
    for run in job.runs:
        try:
            planned.append((run, *_posed(study, run)))
        except InvalidProblemError as error:
            rows.append(failed_row(study, run, f"{error.path}: {error.message}", job.tries))
    for run, solution, seconds in _solved(planned, job):
        Interruption().check()
        if isinstance(solution, Exception):
            said = getattr(solution, "message", None) or one_line(solution)
            rows.append(failed_row(study, run, said, job.tries))
        elif solution.outcome is not Outcome.INTERRUPTED:
            rows.append(_row(study, run, solution, seconds, job.tries))
    return rows


def _posed(study: Study, run: int) -> tuple[PlanningProblem, Solver]:
    """The problem of a run and its solver. Errors: `InvalidProblemError`."""
    parameters, solver = study.parameters(run), study.solver(run)
    others = {path: value for path, value in parameters.items() if path not in study.goal_axes}
    setting = _setting(study.problem_text, json.dumps(others, default=str), solver)
    if not study.goal_axes:
        return setting.problem, setting.solver
    try:
        goal = changed_goal(setting.goal, parameters)
        return setting.problem.towards(plain_state(_goals().validate_python(goal))), setting.solver
    except ValidationError as error:
        raise translate(error, dict)[0].under("goal") from None  # type: ignore[arg-type]
    except (LookupError, TypeError):
        raise InvalidProblemError("the goal has no such place", path="goal") from None


@lru_cache(maxsize=1)
def _goals() -> TypeAdapter[Any]:
    return TypeAdapter(State)


def _solved(
    planned: Sequence[tuple[int, PlanningProblem, Solver]], job: Job
) -> Iterator[tuple[int, Solution | Exception, float]]:
    """A verified solution for each run, or what came in between; and the seconds that it took to plan."""
    together = len(planned) >= FEW and not job.chained and planned[0][2].name == "jacobian"
    if together:
        first, solver, began = *planned[0][1:], perf_counter()
        try:
            plans = list(plan_many(first, [problem.goal for _, problem, _ in planned], solver))
            each, began = (perf_counter() - began) / len(planned), perf_counter()
            pairs = zip(planned, plans, strict=True)
            claims = [_claimed(problem, solver, plan) for (_, problem, _), plan in pairs]
            verdicts = verify_many(claims)
        except FAILURES:
            together = False  # each by itself, to find out whose it was
        else:
            seconds = (perf_counter() - began) / len(planned)
            for (run, *_), claim, verdict in zip(planned, claims, verdicts, strict=True):
                yield run, claim.judged(verdict, seconds), each
    if not together:
        before = _stored_control(job.start, planned[0][1]) if job.start and planned else None
        for run, problem, solver in planned:
            warm, began = _beginning(problem, before), perf_counter()
            solution = _attempted(lambda p=warm, s=solver: planning.solve(p, s))
            yield run, solution, perf_counter() - began
            before = None
            if job.chained and isinstance(solution, Solution) and solution.converged:
                before = solution.control


def _stored_control(text: str, problem: PlanningProblem) -> Control:
    """Errors: `InvalidProblemError` where it is damaged."""
    try:
        return read_control(json.loads(text), problem)
    except (ValueError, RecursionError, TypeError, AttributeError, OverflowError) as error:
        reason = str(error) if isinstance(error, InvalidProblemError) else one_line(error)
        raise InvalidProblemError(f"a stored control is damaged: {reason}") from None


def _attempted(solve: Any) -> Solution | Exception:
    try:
        solution: Solution = solve()
        return solution
    except FAILURES as error:
        return error


def _beginning(problem: PlanningProblem, before: Control | None) -> PlanningProblem:
    """With the control of the plan before as the first, if it is over the same basis."""
    if before is None or before.basis != problem.basis:
        return problem
    return problem.with_(initial=np.asarray(before.coefficients))


def _claimed(problem: PlanningProblem, solver: Solver, plan: Plan) -> Solution:
    more = {"evaluations": plan.evaluations}
    return claimed(problem, solver, plan.control, plan.outcome, plan.message, plan.error, **more)


def judged(solution: Solution) -> Solution:
    """With the verdict."""
    began = perf_counter()
    verdict = verify(solution)
    return solution.judged(verdict, perf_counter() - began)


def _row(study: Study, run: int, solution: Solution, seconds: float, tries: int) -> Row:
    data = to_json(replace(solution, trajectory={}, iterations=[]))  # which no column holds
    least = {
        name: float(np.min(values))
        for name, values in solution.trajectory.items()
        if (known := margin(name)) and known.kind == "sigma"
    }
    moving = {block.name for part, block in solution.problem.quantities if part in ("input", "output")}
    extremes = {name: _extremes(values) for name, values in solution.trajectory.items() if name in moving}
    verify_s = solution.timing.get("verify_s", 0.0)
    return _as_row(
        run=run,
        variant=study.solver(run),
        parameters=study.parameters(run),
        outcome=data["outcome"],
        converged=int(solution.converged),
        message=data["message"],
        verified_error=(data["verified"] or {}).get("error"),
        final_error=data["final_error"],
        **{name: data[name] for name in costs_of_motion()},
        evaluations=solution.evaluations,
        margins={name: value if np.isfinite(value) else None for name, value in least.items()},
        extremes=extremes,
        limits=data["constraints"],
        warnings=data["warnings"],
        settings=data["settings"],
        seed=data["settings"].get("seed"),
        solved_control=data["control"],
        solve_s=solution.timing.get("solve_s", seconds),
        verify_s=verify_s,
        tries=tries,
    )


def _extremes(values: Any) -> list[float] | None:
    """The least and the greatest of a quantity's components along the path; None where it has no number there."""
    ends = [float(np.min(values)), float(np.max(values))]
    return ends if np.isfinite(ends).all() else None


def failed_row(study: Study, run: int, message: str, tries: int) -> Row:
    """The row of a run of which there is no control."""
    return _as_row(
        run=run,
        variant=study.solver(run),
        parameters=study.parameters(run),
        outcome=Outcome.SOLVER_ERROR.value,
        converged=0,
        message=message if message.endswith(".") else f"{message}.",
        tries=tries,
    )


def _as_row(**values: Any) -> Row:
    values = {**dict.fromkeys(COLUMNS), **values, "finished": datetime.now(UTC).isoformat(timespec="seconds")}
    written = {
        name: values[name] if values[name] is None else json.dumps(values[name], default=str) for name in JSON
    }
    return {**values, **written}


def restored(row: Row, facts: dict[str, Any]) -> Solution:
    """The verified solution of a stored run: its control, on the problem that its study says.

    Errors: `InvalidProblemError` for a run without a control.
    """
    if row["solved_control"] is None:
        raise InvalidProblemError(f"run {row['run']} left no control: {row['message']}")
    file = read_problem(
        facts["problem"], facts["problem_file"], json.loads(row["parameters"]), row["variant"]
    )
    problem = build(file)
    solver = planning.own_solver(problem, settings_of(row["variant"])[0])
    final = float("nan") if row["final_error"] is None else row["final_error"]
    control = _stored_control(row["solved_control"], problem)
    plan = Plan(Outcome(row["outcome"]), row["message"], final, control, row["evaluations"] or 0)
    solution = _claimed(problem, solver, plan)
    return judged(replace(solution, timing={"build_s": 0.0, "solve_s": row["solve_s"] or 0.0}))
