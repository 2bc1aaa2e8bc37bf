"""Solution -> files."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.problem_file import dump_problem
from nhpocp.solution import Solution
from nhpocp.solution_folder.plain_data import to_json
from nhpocp.solution_folder.target import check_target, real_target, replace, scratch_folder, unwritable
from nhpocp.solvers.interruption import Interruption

Pictures = Callable[[Solution, Path], Any]


def save_solution(
    solution: Solution, folder: str | os.PathLike[str], pictures: Pictures | None = None
) -> Path:
    """Writes a solution folder and returns its path.

    The files are written beside ``folder`` under another name and renamed when complete; Ctrl-C waits for that. A
    folder that exists is replaced only if every file in it is one that nhpocp writes. ``pictures(solution, folder)``
    may add files; if it fails for lack of space the data are kept without them. Errors: `InvalidProblemError` for a
    folder that is something else or cannot be written.
    """
    target = Path(folder)
    check_target(target)
    with Interruption(patient=True) as interruption:
        try:
            _save(solution, target, pictures)
        except OSError as error:
            raise unwritable(target, error) from error
    if interruption.outermost:
        interruption.check()
    return target


def _save(solution: Solution, target: Path, pictures: Pictures | None) -> None:
    home = real_target(target)
    scratch = scratch_folder(home)
    try:
        _write(solution, scratch)
        if pictures is not None:
            _add_pictures(solution, scratch, pictures)
        scratch.chmod(0o777 & ~_umask())
        replace(scratch, home, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _write(solution: Solution, folder: Path) -> None:
    problem = dump_problem(solution.problem, {solution.solver: solution.settings})
    (folder / "problem.yaml").write_text(problem, encoding="utf-8")
    text = json.dumps(to_json(solution), indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "solution.json").write_text(text + "\n", encoding="utf-8")
    arrays: dict[str, Any] = {name: np.asarray(values) for name, values in solution.trajectory.items()}
    np.savez_compressed(folder / "arrays.npz", **arrays)
    _write_csv(solution, folder / "trajectory.csv")
    (folder / "solver.log").write_text(solution.log or _log(solution), encoding="utf-8")


def _write_csv(solution: Solution, path: Path) -> None:
    names, columns = [], []
    for name, values in solution.trajectory.items():
        table = np.asarray(values).reshape(len(values), -1)
        shape = np.asarray(values).shape[1:]
        names += [name + "".join(f"[{i}]" for i in index) for index in np.ndindex(*shape)]
        columns.append(table)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(
            [repr(float(x)) if math.isfinite(x) else "" for x in row] for row in np.hstack(columns)
        )


def _log(solution: Solution) -> str:
    """A line per iteration, for solvers that keep no log of their own."""
    lines = [f"{solution.solver}: {solution.problem.name}"]
    for record in solution.iterations:
        lines.append(
            "  ".join(f"{k}={v:.6g}" if isinstance(v, float) else f"{k}={v}" for k, v in record.items())
        )
    return "\n".join([*lines, f"{solution.outcome.value}: {solution.message}", ""])


def _add_pictures(solution: Solution, folder: Path, pictures: Pictures) -> None:
    before = set(folder.iterdir())
    try:
        pictures(solution, folder)
    except OSError:
        # no room for pictures: the numbers matter more, and `nhpocp plot` can draw them later
        for path in set(folder.iterdir()) - before:
            path.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
