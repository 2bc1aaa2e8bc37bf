"""Several solutions side by side, as data: what ran, how it ended, and the table that files and reports show."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from nhpocp import planning
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis
from nhpocp.csv_writer import write_table
from nhpocp.errors import NhpocpError, expect
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion, exact_costs
from nhpocp.outcome import Outcome
from nhpocp.plain_text import brief, visible
from nhpocp.problem import PlanningProblem
from nhpocp.provenance import machine, peak_memory, reset_peak_memory
from nhpocp.runs_apart import task_of, told_apart
from nhpocp.shown import Shown
from nhpocp.solution import Progress, Solution, Solver, telling
from nhpocp.solvers.claimed import unsolved

SCHEMA_VERSION = 1
VARIANTS = ("jacobian", "nlp")  # what is compared unless told
# what a solver can stumble over that is no mistake of ours: its message is enough
FAILURES = (NhpocpError, RuntimeError, ArithmeticError, np.linalg.LinAlgError, MemoryError)


@dataclass(frozen=True)
class Run(Constructed):
    """A solve to be done, as `compare` takes it.

    problem: a `PlanningProblem`. solver: such as `Auto()`. variant: how the pair is called, "nlp:control=basis" say.
    Errors: `CallError` for what is none of these.
    """

    problem: PlanningProblem
    solver: Solver
    variant: str

    def __post_init__(self) -> None:
        expect(self.problem, PlanningProblem, "a PlanningProblem", "Run.problem")
        expect(self.variant, str, "a text", "Run.variant")
        planning.chosen_solver(self.problem, self.solver)


@dataclass(frozen=True)
class Entry:
    """A run that is done, and where its solution is stored.

    solution: the verified `Solution`. variant: how the run is called. folder: its name, None where it is not stored.
    """

    solution: Solution
    variant: str
    folder: str | None = None

    def __repr__(self) -> str:
        return f"<Entry {visible(self.variant)}: {self.solution!r}>"

    @classmethod
    def of(cls, solution: Solution, folder: str | None = None) -> Entry:
        """An entry by what the solution itself says of the run that it came from."""
        return cls(solution, str(_noted(solution).get("variant", solution.solver)), folder)

    @property
    def tried(self) -> bool:
        """Whether the solver evaluated anything; without it the stored control is a place-holder that stands still."""
        return self.solution.evaluations > 0 or bool(self.solution.iterations)

    @property
    def claim_right(self) -> bool | None:
        """Whether the solver's claim of success was right.

        True: claimed and confirmed by verification. False: claimed and refuted. None: it claimed nothing (it failed in
        its own eyes), or nobody has verified the claim.
        """
        return False if self.solution.refuted else self.solution.converged or None

    @property
    def objective_value(self) -> float:
        """What the problem's own objective says of the motion, whatever the solver minimised; NaN where unknown."""
        solution = self.solution
        name = solution.problem.objective
        exact = OBJECTIVES[name].of_control(solution.control)
        return float(solution.costs.get(name, math.nan)) if exact is None else exact

    @property
    def physics(self) -> Mapping[str, Any]:
        """What a physics engine made of the plan, where it was asked; lengths and radians."""
        opinion: Mapping[str, Any] = _noted(self.solution).get("physics") or {}
        return opinion

    @property
    def machine(self) -> Mapping[str, Any]:
        """Versions and machine of the run."""
        environment: Mapping[str, Any] = _noted(self.solution).get("environment", {})
        return environment

    @property
    def memory(self) -> float | None:
        """Peak resident memory of the process during the run [MB]."""
        megabytes: float | None = _noted(self.solution).get("peak_memory_mb")
        return megabytes


def _noted(solution: Solution) -> Mapping[str, Any]:
    """What `compare` wrote into a solution's details."""
    noted: Mapping[str, Any] = solution.details.get("comparison", {})
    return noted


@dataclass(frozen=True)
class Group:
    """The runs on one problem."""

    title: str
    entries: Sequence[Entry]

    def __repr__(self) -> str:
        return f"<Group {brief(self.title)} of {len(self.entries)} runs>"

    @property
    def problem(self) -> PlanningProblem:
        return self.entries[0].solution.problem

    @property
    def best(self) -> float | None:
        """The least objective among the verified solutions."""
        values = [entry.objective_value for entry in self.entries if entry.solution.converged]
        return min((value for value in values if math.isfinite(value)), default=None)


@dataclass(frozen=True)
class Comparison(Shown):
    """Runs that are done, as `compare` returns them.

    entries: a run each, in order. notes: what a reader has to know of the whole, such as runs that never began.
    """

    entries: Sequence[Entry]
    notes: Sequence[str] = ()

    def __repr__(self) -> str:
        good = sum(entry.solution.converged for entry in self.entries)
        names = [brief(group.title) for group in self.groups]
        on = names[0] if len(names) == 1 else f"{len(names)} problems"
        notes = f", {len(self.notes)} notes" if self.notes else ""
        return f"<Comparison of {len(self.entries)} runs on {on}: {good} verified{notes}>"

    @classmethod
    def of(
        cls,
        solutions: Iterable[Solution],
        folders: Iterable[str | None] | None = None,
        notes: Sequence[str] = (),
    ) -> Comparison:
        """The comparison of stored solutions; equal names on the same problem are told apart by their settings."""
        solutions = list(solutions)
        places = list(folders) if folders is not None else [None] * len(solutions)
        entries = [Entry.of(solution, folder) for solution, folder in zip(solutions, places, strict=True)]
        return cls(_told_apart(entries), notes)

    @cached_property
    def groups(self) -> list[Group]:
        """The entries problem by problem, in order."""
        by_task: dict[str, list[Entry]] = {}
        for entry in self.entries:
            by_task.setdefault(task_of(entry.solution.problem), []).append(entry)
        titles: list[str] = []
        for entries in by_task.values():
            name = entries[0].solution.problem.name
            count = sum(title == name or title.startswith(f"{name} (") for title in titles)
            titles.append(f"{name} ({count + 1})" if count else name)
        return [Group(title, entries) for title, entries in zip(titles, by_task.values(), strict=True)]

    @property
    def all_converged(self) -> bool:
        return bool(self.entries) and not self.notes and all(e.solution.converged for e in self.entries)

    def rows(self) -> list[dict[str, Any]]:
        """The table, one row an entry, None where a number is missing or not finite."""
        best = {id(entry): group.best for group in self.groups for entry in group.entries}
        return [_row(entry, best[id(entry)]) for entry in self.entries]

    def to_json(self) -> dict[str, Any]:
        return {"schema_version": SCHEMA_VERSION, "runs": self.rows()}

    def to_csv(self) -> str:
        """The rows as CSV: empty where there is no value, true and false in JSON's spelling."""
        stream = io.StringIO()
        rows = self.rows()
        names = list(rows[0]) if rows else []
        write_table(stream, names, (row.values() for row in rows), ("false", "true"))
        return stream.getvalue()


def compare(
    problems: Sequence[PlanningProblem | Run],
    variants: Sequence[str] = VARIANTS,
    progress: Progress | None = None,
    finished: Callable[[Solution, Run], str | None] | None = None,
    opinion: Callable[[Solution], Mapping[str, Any] | None] | None = None,
) -> Comparison:
    """Solves every problem by its own solvers of these names, and every `Run` as it stands.

    ``opinion(solution)``: what somebody else says of a solution, noted as `Entry.physics`.
    ``finished(solution, run)`` is called as soon as a run ends, to store it, and returns where. A run that fails, in
    whatever way, is a failed entry, and one that cannot be stored a note; Ctrl-C ends it with what there is.
    """
    runs = [
        run for item in problems for run in ([item] if isinstance(item, Run) else _by_variant(item, variants))
    ]
    entries: list[Entry] = []
    notes: list[str] = []
    with Interruption() as interruption, suppress(KeyboardInterrupt):
        for i, run in enumerate(runs, 1):
            interruption.check()
            solution = _solved(run, telling(progress, run=i, runs=len(runs)))
            interruption.patient = True  # what is found is kept
            if opinion and (noted := opinion(solution)):
                note = {**_noted(solution), "physics": dict(noted)}
                solution = replace(solution, details={**solution.details, "comparison": note})
            folder = None
            try:
                folder = finished(solution, run) if finished else None
            except (NhpocpError, OSError, MemoryError) as error:
                notes.append(f"{run.problem.name} by {run.variant} could not be stored: {_reason(error)}.")
            entries.append(Entry(solution, run.variant, folder))
            interruption.patient = False
    missing = [f"{run.problem.name} by {run.variant}" for run in runs[len(entries) :]]
    notes += [f"{STOPPED}; not run: {', '.join(missing)}."] if missing else []
    return Comparison(_told_apart(entries), notes)


def _by_variant(problem: PlanningProblem, variants: Sequence[str]) -> list[Run]:
    return [Run(problem, planning.own_solver(problem, name), name) for name in variants]


def _solved(run: Run, progress: Progress | None) -> Solution:
    """The verified solution, with a note of the run in its details; what cannot be solved is a failure."""
    told = telling(progress, name=run.problem.name, variant=run.variant)
    measured = reset_peak_memory()
    began = perf_counter()
    try:
        solution = planning.solve(run.problem, run.solver, told)
    except Exception as error:  # noqa: BLE001 - whatever it is, neither other runs nor the report are lost for it
        solution = _failure(run, error, perf_counter() - began)
    note = {
        "variant": run.variant,
        "peak_memory_mb": peak_memory() if measured else None,
        "environment": machine(),
    }
    return replace(solution, details={**solution.details, "comparison": note})


def _reason(error: Exception) -> str:
    """An error in a sentence; one that nobody has foreseen says its kind too."""
    said = getattr(error, "message", None) or str(error).strip()
    if not said or isinstance(error, (*FAILURES, OSError)):
        return said or type(error).__name__
    return f"{type(error).__name__}: {said}"


def _failure(run: Run, error: Exception, seconds: float) -> Solution:
    """A solution that says why there is none; its control stands still."""
    reason = _reason(error)
    sentence = reason if reason.endswith(".") else f"{reason}."
    solution = unsolved(run.problem, run.solver, Outcome.SOLVER_ERROR, sentence, solve_seconds=seconds)
    return replace(solution, timing={**solution.timing, "verify_s": 0.0, "total_s": seconds})


def _told_apart(entries: Sequence[Entry]) -> list[Entry]:
    """Runs on one task that are called alike, called by what differs between them."""
    names = told_apart([(entry.solution, entry.variant) for entry in entries])
    return [replace(entry, variant=name) for entry, name in zip(entries, names, strict=True)]


# --- the table ------------------------------------------------------------------------------------------------------


def _row(entry: Entry, best: float | None) -> dict[str, Any]:
    solution, verdict = entry.solution, entry.solution.verdict
    timing = solution.timing
    motion = _motion(entry) if entry.tried else dict.fromkeys(costs_of_motion())
    value = entry.objective_value
    comparable = solution.converged and best is not None and best > 0
    row = {
        "name": solution.problem.name,
        "solver": solution.solver,
        "variant": entry.variant,
        "folder": entry.folder,
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "verified_error": verdict.error if verdict else None,
        **motion,
        "evaluations": solution.evaluations,
        "build_s": timing.get("build_s"),
        "solve_s": timing.get("solve_s"),
        "claim_right": entry.claim_right,
        "basis": basis_words(solution.control.basis) if entry.tried else None,
        "tolerance": solution.tolerance,
        "objective": solution.problem.objective,
        "objective_value": value if entry.tried else None,
        "optimality_gap": value / best - 1 if comparable and best else None,
        **_extremes(entry),
        "iterations": solution.iterations[-1].get("k") if solution.iterations else None,
        "verify_s": timing.get("verify_s"),
        "peak_memory_mb": entry.memory,
        **{f"physics_{name}": entry.physics.get(name) for name in PHYSICS},
        "reason": None if solution.converged else solution.message,
    }
    return {key: _finite(item) for key, item in row.items()}


def basis_words(basis: ControlBasis) -> str:
    """A basis and its size as a file says them: fourier harmonics=2."""
    size = (f"{key}={value}" for key, value in basis.parameters().items() if isinstance(value, int))
    return " ".join([basis.kind, *size])


PHYSICS = ("outcome", "position_error", "angle_error", "slip", "duration")
EXTREMES = ("least_sigma_s", "least_sigma_w", "leg_length_min", "leg_length_max", "peak_leg_speed")


def _motion(entry: Entry) -> dict[str, float | None]:
    costs = entry.solution.costs
    return {name: costs.get(name) for name in costs_of_motion()} | exact_costs(entry.solution.control)


def _extremes(entry: Entry) -> dict[str, float | None]:
    """Extremes over the stored samples; None for what the system does not have."""
    extremes: dict[str, float | None] = dict.fromkeys(EXTREMES)
    if not entry.tried:
        return extremes
    trajectory = entry.solution.trajectory
    for name in ("s", "w"):
        extremes[f"least_sigma_{name}"] = _extreme(trajectory.get(f"sigma_{name}"), np.min)
    if "leg_lengths" in trajectory:
        extremes["leg_length_min"] = _extreme(trajectory["leg_lengths"], np.min)
        extremes["leg_length_max"] = _extreme(trajectory["leg_lengths"], np.max)
        extremes["peak_leg_speed"] = _extreme(np.abs(trajectory.get("u", np.nan)), np.max)
    return extremes


def _extreme(values: Any, pick: Callable[[Any], Any]) -> float | None:
    """The least or greatest finite value."""
    finite = np.ravel(np.asarray(values if values is not None else [], dtype=float))
    finite = finite[np.isfinite(finite)]
    return float(pick(finite)) if finite.size else None


def _finite(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
