"""Solution -> files."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.interruption import Interruption
from nhpocp.problem_file import dump_problem
from nhpocp.solution import Solution
from nhpocp.solution_folder.pictures import drawn
from nhpocp.solution_folder.plain_data import as_text, to_json
from nhpocp.solution_folder.tables import write_columns, write_iterations, write_trajectory
from nhpocp.solution_folder.target import check_target, unwritable, write_whole
from nhpocp.whole import write_text

Pictures = Callable[[Solution, Path], Any]


def save_solution(
    solution: Solution,
    folder: str | os.PathLike[str],
    pictures: Pictures | None = None,
    *,
    trace: bool = False,
) -> Path:
    """Writes a solution folder and returns its path.

    The files are written beside ``folder`` under another name and renamed when complete; Ctrl-C waits for that. A
    folder that exists is replaced only if every file in it is one that nhpocp writes. ``trace`` adds iterations.csv to
    the data. ``pictures(solution, folder)`` may add files; where it fails for lack of room or permission, or Ctrl-C
    arrives, the data are kept without them, with a warning. Errors: `InvalidProblemError` for a folder that is
    something else or cannot be written.
    """
    store_solution(solution, folder, pictures, trace=trace)
    return Path(folder)


def store_solution(
    solution: Solution,
    folder: str | os.PathLike[str],
    pictures: Pictures | None = None,
    *,
    trace: bool = False,
) -> Solution:
    """The solution as `save_solution` has written it: its warnings name what is missing."""
    target = Path(folder)
    check_target(target)
    with Interruption(patient=True) as interruption:
        try:
            written = _save(solution, target, pictures, trace)
        except OSError as error:
            raise unwritable(target, error) from error
    if interruption.outermost:
        interruption.check()
    return written


def _save(solution: Solution, target: Path, pictures: Pictures | None, trace: bool) -> Solution:
    written = solution

    def write(scratch: Path) -> None:
        nonlocal written
        _write(solution, scratch, trace)
        missing = drawn(partial(pictures, solution), scratch) if pictures is not None else ""
        if missing:
            warning = f"{missing}; `nhpocp plot {target}` draws them"
            written = replace(solution, warnings=[*solution.warnings, warning])
            with suppress(OSError):  # else the caller alone is told
                _write_json(written, scratch)

    write_whole(target, write)
    return written


def _write(solution: Solution, folder: Path, trace: bool) -> None:
    problem = dump_problem(solution.problem, {solution.solver: solution.settings})
    (folder / "problem.yaml").write_text(problem, encoding="utf-8")
    _write_json(solution, folder)
    arrays: dict[str, Any] = {name: np.asarray(values) for name, values in solution.trajectory.items()}
    np.savez_compressed(folder / "arrays.npz", **arrays)
    write_trajectory(solution, folder / "trajectory.csv")
    write_columns(solution, folder / "columns.csv")
    if trace:
        write_iterations(solution, folder / "iterations.csv")
    (folder / "solver.log").write_text(solution.log or _log(solution), encoding="utf-8")


def _write_json(solution: Solution, folder: Path) -> None:
    write_text(folder / "solution.json", as_text(to_json(solution)))


def _log(solution: Solution) -> str:
    """A line per iteration, for solvers that keep no log of their own."""
    lines = [f"{solution.solver}: {solution.problem.name}"]
    for record in solution.iterations:
        lines.append(
            "  ".join(f"{k}={v:.6g}" if isinstance(v, float) else f"{k}={v}" for k, v in record.items())
        )
    return "\n".join([*lines, f"{solution.outcome.value}: {solution.message}", ""])
