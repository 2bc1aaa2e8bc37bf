"""A steering as a folder: steer.json, steer.csv, the picture, and every cycle's plan as a solution folder."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from nhpocp.csv_writer import write_table
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.feedback.fleet import QUANTILES, Fleet
from nhpocp.machine.feedback.steering import Steered
from nhpocp.provenance import environment
from nhpocp.solution import Solution
from nhpocp.solution_folder import is_solution_folder, plain, save_solution, unwritable
from nhpocp.solution_folder.pictures import drawn
from nhpocp.solution_folder.stored import StoredBound
from nhpocp.solution_folder.target import remove_own, require_own
from nhpocp.whole import bench, write_text

SCHEMA_VERSION = 1
DATA, TABLE = "steer.json", "steer.csv"
CYCLE = "cycle_{}"
MOST = 1000  # cycles that a folder is looked through for, where an earlier steering has left more

Pictures = Callable[[Any, Path], Any]


def check_home(home: Path) -> None:
    """Errors: `InvalidProblemError` where the folder cannot be written to, or something of others stands in it."""
    try:
        with bench(home):
            pass
    except OSError as error:
        raise unwritable(home, error) from error
    for name in (DATA, TABLE):
        require_own(home / name)
    for folder in _cycle_folders(home):
        if not is_solution_folder(folder):
            words = "this was not written by nhpocp and is left alone; choose another folder with -o"
            raise InvalidProblemError(words, file=str(folder))


def save_steering(
    steered: Steered, home: Path, facts: Mapping[str, Any], pictures: Pictures | None = None
) -> list[str]:
    """Writes a steering; ``facts`` of the machine go into steer.json. What is missing is returned, in words.

    Plans stand in cycle_1, …; the one that failed, if one did, after them. Errors: `InvalidProblemError`.
    """
    check_home(home)
    plans = [cycle.plan for cycle in steered.cycles if cycle.plan is not None]
    plans += [steered.refused] if steered.refused else []
    folders = _save_plans(plans, home)
    rows = [{"cycle": k, **cycle.to_json()} for k, cycle in enumerate(steered.cycles)]
    for row, cycle, folder in zip(rows[1:], steered.cycles[1:], folders, strict=False):
        row["folder"] = folder
        if cycle.path is not None:
            row["constraints"] = {r.bound.label: StoredBound.written(r) for r in cycle.path.bounds}
    data = {
        **_head(steered.problem.name, steered.tolerance),
        "outcome": steered.outcome.value,
        "message": steered.message,
        "warnings": steered.warnings,
        "error": steered.error,
        **facts,
        "cycles": rows,
    }
    names = ["cycle", *_numbers(rows)]
    return _write(steered, home, data, names, ([row.get(name) for name in names] for row in rows), pictures)


def save_fleet(
    fleet: Fleet, home: Path, facts: Mapping[str, Any], pictures: Pictures | None = None
) -> list[str]:
    """Writes what many machines did, a row each; as `save_steering`, without their plans."""
    check_home(home)
    _save_plans([], home)
    rows: list[dict[str, Any]] = []
    for number, machine in enumerate(fleet.machines):
        steered, errors = machine.steered, {}
        for key, cycle in (("without", machine.opened), ("with", machine.closed)):
            for name in ("error", "position_error", "angle_error"):
                errors[f"{name}_{key}"] = getattr(cycle, name) if cycle else None
        cycles = [cycle.to_json() for cycle in steered.cycles]
        rows.append(
            {
                "machine": number,
                "outcome": steered.outcome.value,
                "runs": max(len(cycles) - 1, 0),
                **errors,
                "broken": len({report.bound for _, report in steered.broken}),
                "wrong": machine.wrong,
                "message": steered.message,
                "warnings": steered.warnings,
                "cycles": [
                    {k: c[k] for k in ("error", "position_error", "angle_error", "plan_s")} for c in cycles
                ],
            }
        )
    data = {
        **_head(fleet.problem.name, fleet.tolerance),
        "outcome": fleet.outcome,
        "reached": fleet.reached,
        "warnings": fleet.warnings,
        "runs": fleet.runs,
        "plan_s": fleet.plan_s,
        "errors": fleet.errors.words,
        **facts,
        "quantiles": list(QUANTILES),
        "table": fleet.table(),
        "machines": rows,
    }
    wrong = [error.name for error in fleet.errors.errors]
    names = [
        "machine",
        "outcome",
        "runs",
        *(name for name in _numbers(rows) if name not in ("machine", "runs")),
    ]
    cells = ([*(row[name] for name in names), *(_flat(row["wrong"][name]) for name in wrong)] for row in rows)
    return _write(fleet, home, data, [*names, *wrong], cells, pictures)


def _head(name: str, tolerance: float) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "name": name,
        "tolerance": tolerance,
        "environment": environment(None),
    }


def _numbers(rows: list[dict[str, Any]]) -> list[str]:
    """Columns that hold a number, or nothing, in every row."""
    names = dict.fromkeys(name for row in rows for name in row)
    plain_numbers = (int, float, type(None))
    return [
        name
        for name in names
        if name not in ("cycle", "folder") and all(isinstance(row.get(name), plain_numbers) for row in rows)
    ]


def _flat(value: Any) -> Any:
    return " ".join(map(repr, value)) if isinstance(value, list) else value


def _cycle_folders(home: Path) -> list[Path]:
    """Folders of cycles that are there, whoever wrote them."""
    found = []
    for k in range(1, MOST):
        folder = home / CYCLE.format(k)
        if not folder.exists():
            break
        found.append(folder)
    return found


def _save_plans(plans: list[Solution], home: Path) -> list[str]:
    """Their folders' names; those of an earlier steering go."""
    for folder in _cycle_folders(home)[len(plans) :]:
        remove_own(folder)
    names = [CYCLE.format(k) for k in range(1, len(plans) + 1)]
    for name, plan in zip(names, plans, strict=True):
        save_solution(plan, home / name)
    return names


def _write(
    subject: Steered | Fleet,
    home: Path,
    data: Mapping[str, Any],
    names: list[str],
    rows: Iterable[list[Any]],
    pictures: Pictures | None,
) -> list[str]:
    stream = io.StringIO()
    write_table(stream, names, rows)
    text = json.dumps(plain(data), indent=1, allow_nan=False, ensure_ascii=False)
    try:
        write_text(home / DATA, text + "\n")
        write_text(home / TABLE, stream.getvalue())
    except OSError as error:
        raise unwritable(home, error) from error
    missing = drawn(lambda folder: pictures(subject, folder), home) if pictures else ""
    return [missing] if missing else []
