"""Solutions as folders: written whole or not at all, read back without executing anything they contain.

problem.yaml, solution.json, trajectory.csv, arrays.npz, solver.log and the pictures.
"""

from __future__ import annotations

import csv
import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints import BoundReport
from nhpocp.controls.control import Control
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import control_from_json, dump_problem, parse_problem
from nhpocp.solution import Crossing, Outcome, Replay, Solution, Verdict

SCHEMA_VERSION = 1
MARGINS = ("sigma_", "det_")


def save_solution(
    solution: Solution,
    folder: str | os.PathLike[str],
    pictures: Callable[[Solution, Path], Any] | None = None,
) -> Path:
    """Writes a solution folder and returns its path.

    The files are written beside ``folder`` under another name and renamed when complete. A folder that exists is
    replaced only if it is empty or a solution folder. ``pictures(solution, folder)`` may add files; if it fails for
    lack of space the data are kept without them. Errors: `InvalidProblemError` for a folder that is something else or
    cannot be written.
    """
    target = Path(folder)
    check_target(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(target)) from error
    try:
        _write(solution, scratch)
        if pictures is not None:
            _add_pictures(solution, scratch, pictures)
        scratch.chmod(0o777 & ~_umask())
        _replace(scratch, target)
    except OSError as error:
        raise InvalidProblemError(f"cannot write here: {error.strerror}", file=str(target)) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return target


def check_target(folder: Path) -> None:
    """Raises `InvalidProblemError` where a solution folder may not be written."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InvalidProblemError("this is a file; choose another folder with -o", file=str(folder))
    if any(folder.iterdir()) and not is_solution_folder(folder):
        raise InvalidProblemError(
            "this folder was not written by nhpocp and is left alone; choose another with -o",
            file=str(folder),
        )


def is_solution_folder(folder: Path) -> bool:
    """Whether nhpocp wrote this folder."""
    try:
        head = (folder / "solution.json").read_text(encoding="utf-8")[:200]
    except (OSError, UnicodeDecodeError):
        return False
    return '"schema_version"' in head


def load_solution(folder: str | os.PathLike[str]) -> Solution:
    """The Solution that a folder holds.

    Errors: `UnreadableSolutionError` naming the file that is missing or damaged.
    """
    home = Path(folder)
    try:
        text = (home / "solution.json").read_text(encoding="utf-8")
        data = json.loads(text)
        problem = parse_problem(
            (home / "problem.yaml").read_text(encoding="utf-8"), file=str(home / "problem.yaml")
        )
        with np.load(home / "arrays.npz", allow_pickle=False) as arrays:
            trajectory = {name: arrays[name] for name in arrays.files}
        log = (home / "solver.log").read_text(encoding="utf-8") if (home / "solver.log").exists() else ""
        return _solution(data, problem, trajectory, log)
    except FileNotFoundError as error:
        missing = Path(error.filename).name if error.filename else "a file"
        raise UnreadableSolutionError(f"{home}: no solution folder: {missing} is missing") from error
    except (OSError, json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, InvalidProblemError):
            raise
        raise UnreadableSolutionError(f"{home}: damaged solution folder: {error}") from error


def to_json(solution: Solution) -> dict[str, Any]:
    """solution.json as plain data; NaN and infinities become None."""
    problem, verdict = solution.problem, solution.verdict
    trajectory = solution.trajectory
    data = {
        "schema_version": SCHEMA_VERSION,
        "name": problem.name,
        "solver": solution.solver,
        "system": {"model": problem.system.model, **problem.system.parameters()},
        "settings": dict(solution.settings),
        "tolerance": solution.tolerance,
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "message": solution.message,
        "warnings": [*solution.warnings, *(verdict.warnings if verdict else ())],
        "final_error": solution.final_error,
        "verified": verdict.to_json() if verdict else None,
        "objective": solution.objective,
        "effort": solution.control.effort,
        "leg_effort": None,
        "path_length": None,
        **solution.costs,
        "iterations": list(solution.iterations),
        "evaluations": solution.evaluations,
        "control": {"input": problem.system.input_label(), **solution.control.to_json()},
        "trajectory": {name: np.asarray(values).tolist() for name, values in trajectory.items()},
        "crossings": [crossing.to_json() for crossing in verdict.crossings] if verdict else [],
        "length_scale": problem.scale,
        "constraints": {r.bound.label: r.to_json() for r in verdict.bounds} if verdict else {},
        "details": dict(solution.details),
        "timing": dict(solution.timing),
        "environment": environment(),
    }
    return plain(data)


def environment() -> dict[str, Any]:
    """Versions that a result may depend on."""
    packages = {}
    for name in ("nhpocp", "casadi", "numpy", "scipy"):
        with suppress(PackageNotFoundError):
            packages[name] = version(name)
    return {**packages, "python": platform.python_version(), "platform": platform.platform(), "plugin": None}


def _write(solution: Solution, folder: Path) -> None:
    (folder / "problem.yaml").write_text(dump_problem(solution.problem), encoding="utf-8")
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


def _add_pictures(solution: Solution, folder: Path, pictures: Callable[[Solution, Path], Any]) -> None:
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


def _replace(scratch: Path, target: Path) -> None:
    """Puts a complete folder in place of what is there."""
    if not target.exists():
        scratch.rename(target)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}.old.", dir=target.parent)) / "old"
    target.rename(old)
    try:
        scratch.rename(target)
    except OSError:
        old.rename(target)
        raise
    finally:
        shutil.rmtree(old.parent, ignore_errors=True)


def plain(value: Any) -> Any:
    """The same value as strict JSON data: NaN and infinities become None, arrays become lists."""
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _solution(
    data: Mapping[str, Any], problem: PlanningProblem, trajectory: dict[str, Array], log: str
) -> Solution:
    if data["schema_version"] != SCHEMA_VERSION:
        raise UnreadableSolutionError(
            f"schema version {data['schema_version']!r}; this nhpocp reads version {SCHEMA_VERSION}"
        )
    control: Control = control_from_json(data["control"])
    verdict = _verdict(data, problem) if data["verified"] else None
    later = set(verdict.warnings) if verdict else set()
    return Solution(
        problem=problem,
        solver=data["solver"],
        settings=data["settings"],
        tolerance=data["tolerance"],
        outcome=Outcome(data["outcome"]),
        message=data["message"],
        final_error=_number(data["final_error"]),
        control=control,
        trajectory=trajectory,
        costs={
            name: data[name] for name in ("effort", "leg_effort", "path_length") if data[name] is not None
        },
        iterations=data["iterations"],
        evaluations=data["evaluations"],
        objective=data["objective"],
        warnings=[warning for warning in data["warnings"] if warning not in later],
        timing=data["timing"],
        log=log,
        details=data["details"],
        verdict=verdict,
    )


def _verdict(data: Mapping[str, Any], problem: PlanningProblem) -> Verdict:
    verified, bounds = dict(data["verified"]), {bound.label: bound for bound in problem.bounds}
    original = verified.pop("original")
    crossings = []
    for entry in data["crossings"]:
        place = {key: value for key, value in entry.items() if key not in ("which", "t", "returns")}
        crossings.append(Crossing(entry["which"], entry["t"], place, entry["returns"]))
    return Verdict(
        **verified,
        original=Replay(original["error"], original["reached_t"], original["ok"], original["agreement"])
        if original
        else None,
        crossings=crossings,
        bounds=[
            BoundReport(bounds[label], _number(r["worst"]), r["t"], tuple(r["component"]), r["ok"])
            for label, r in data["constraints"].items()
            if label in bounds
        ],
    )
