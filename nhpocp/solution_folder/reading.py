"""Files -> Solution. Everything is validated here, once: who gets a Solution need not doubt its shapes and types."""

from __future__ import annotations

import lzma
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import control_from_json
from nhpocp.problem_file.document import open_file
from nhpocp.problem_file.reading import build, read
from nhpocp.solution import Replay, Solution, Verdict
from nhpocp.solution_folder.stored import StoredSolution, StoredVerdict, parse_stored
from nhpocp.systems.numeric import numeric_system
from nhpocp.whole import sweep

LARGEST_FILE = 200_000_000  # bytes; 100 000 samples of a robot are 100 MB
LARGEST_TREE = 350_000_000  # bytes, as a tree of Python's values; those samples are 250 MB
# bytes that a value takes for each of its signs: a list or mapping, half a text, a number's or an entry's place
SIZES = {b"[": 80, b"{": 80, b'"': 50, b",": 40, b":": 40}
NEEDED = ("solution.json", "problem.yaml", "arrays.npz")
FORMER_STEP_RULE = "euler"  # what a file without one meant when folders of 0.1 were written
SAME = 1e-9  # relative, between the two copies of the trajectory
# what the zip and npy readers answer to damaged files; a header may also claim an array larger than the memory
DAMAGE = (
    *(ValueError, EOFError, LookupError, TypeError, AttributeError, RuntimeError, ArithmeticError),
    *(SyntaxError, MemoryError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, TokenError),
)


def load_solution(folder: str | os.PathLike[str]) -> Solution:
    """The Solution that a folder holds.

    Errors: `UnreadableSolutionError` naming the file that is missing or damaged.
    """
    home = Path(folder)
    if not os.path.exists(home):
        sweep(home.parent)  # brings it back where a killed run had moved it away
    for name in NEEDED:
        with _reading(home / name):
            if not (home / name).exists():
                raise UnreadableSolutionError(f"no solution folder: {_missing(home, name)}", file=str(home))
    with _reading(home / "solution.json"):
        stored = parse_stored(json_content(home / "solution.json"), str(home / "solution.json"))
    problem = _problem(home / "problem.yaml", stored)
    shapes = _shapes(problem)
    with _reading(home / "solution.json"):
        control = read_control(stored.control.model_dump(), problem)
        tables = {name: _table(name, value) for name, value in stored.trajectory.items()}
        _check_shapes(tables, shapes, problem)
    arrays = read_arrays(home / "arrays.npz", _room(tables))
    with _reading(home / "arrays.npz"):
        _check_shapes(arrays, shapes, problem)
        _check_same(arrays, tables)
    log = home / "solver.log"
    with _reading(log):
        text = content(log).decode("utf-8", errors="replace") if log.exists() else ""
    return _solution(stored, problem, control, arrays, text)


def _missing(home: Path, name: str) -> str:
    """What is there instead of a file that every solution folder has, and what may have been meant."""
    if not os.path.exists(home):
        return "there is nothing of this name"
    if not home.is_dir():
        return "this is a file; expected the folder that `nhpocp solve` wrote"
    inside = min((file.parent for file in home.glob("*/*/solution.json")), default=None)
    return f"{name} is missing" + (f"; did you mean {inside}?" if inside else "")


@contextmanager
def _reading(file: Path) -> Iterator[None]:
    """Whatever goes wrong within is the fault of this file."""
    try:
        yield
    except UnreadableSolutionError:
        raise
    except OSError as error:
        raise UnreadableSolutionError(
            f"cannot read this file: {error.strerror or error}", file=str(file)
        ) from error
    except InvalidProblemError as error:
        raise UnreadableSolutionError(error.message, file=str(file), path=error.path) from error
    except DAMAGE as error:
        reason = str(error) or type(error).__name__
        raise UnreadableSolutionError(f"damaged: {reason}", file=str(file)) from error


def _problem(file: Path, stored: StoredSolution) -> PlanningProblem:
    try:
        file_read = read(file)
        if "step_rule" not in file_read.data.solvers.jacobian.model_fields_set and (
            stored.solver == "jacobian" and stored.settings.get("step_rule") == FORMER_STEP_RULE
        ):
            file_read = read(file, [f"solvers.jacobian.step_rule={FORMER_STEP_RULE}"])
        return build(file_read)
    except InvalidProblemError as error:
        raise UnreadableSolutionError(
            error.message, file=str(file), line=error.line, column=error.column, path=error.path
        ) from error


def read_control(data: Mapping[str, Any], problem: PlanningProblem) -> Control:
    """The control that solution.json describes, if it drives this system.

    Errors: `InvalidProblemError` for another system's, or data that say anything else than what is read from them.
    """
    label, inputs = problem.system.input_label(), problem.system.input_space
    if data.get("input") != label:
        raise InvalidProblemError(f"expected {label!r}, the input of this system", path="control.input")
    control = control_from_json(data)
    if len(control.coefficients) != inputs.size:
        raise InvalidProblemError(
            f"rows for {len(control.coefficients)} inputs; the system has {inputs.size}", path="control"
        )
    if not np.isfinite(control.coefficients).all():
        raise InvalidProblemError("NaN or infinity; expected finite numbers", path="control")
    for name, value in control.to_json().items():
        if not _same(value, data.get(name)):
            raise InvalidProblemError(
                "contradicts the rest of the control, or is no number", path=f"control.{name}"
            )
    return control


def _same(expected: Any, stored: Any) -> bool:
    if isinstance(expected, Mapping):
        return isinstance(stored, Mapping) and all(
            _same(value, stored.get(name)) for name, value in expected.items()
        )
    if isinstance(expected, list) and any(isinstance(item, Mapping) for item in expected):
        # the pieces of a sequence
        return isinstance(stored, list) and len(stored) == len(expected) and all(map(_same, expected, stored))
    if isinstance(expected, list | float | int):
        table = _table("control", stored)
        return table.shape == np.shape(expected) and np.allclose(table, expected, rtol=SAME, atol=1e-12)
    return bool(expected == stored)


def _table(name: str, value: Any) -> Array:
    """Nested lists of numbers as an array; null is NaN."""
    table = np.array(value)
    numbers = table.dtype.kind in "iuf" or (
        table.dtype.kind == "O" and all(x is None or type(x) in (int, float) for x in table.flat)
    )
    if not numbers:
        raise InvalidProblemError("expected numbers", path=name)
    return table.astype(float)


def content(file: Path) -> bytes:
    """The bytes of a file, if they are not more than a solution can have."""
    with open_file(file) as stream:
        if os.fstat(stream.fileno()).st_size > LARGEST_FILE:
            raise InvalidProblemError(f"larger than {LARGEST_FILE // 10**6} MB; no solution is")
        return stream.read()


def json_content(file: Path) -> bytes:
    """The JSON text of a file, if neither it nor what is made of it is larger than a solution can be.

    Errors: `UnreadableSolutionError`.
    """
    with _reading(file):
        text = content(file)
        if sum(size * text.count(sign) for sign, size in SIZES.items()) > LARGEST_TREE:
            raise InvalidProblemError("holds more lists, texts and numbers than any solution does")
    return text


def _room(tables: Mapping[str, Array]) -> int:
    """Bytes that the arrays of a trajectory may take unpacked: two doubles a number, and a header each."""
    return 16 * sum(table.size for table in tables.values()) + 4096 * (len(tables) + 1)


def read_arrays(file: Path, room: int) -> dict[str, Array]:
    """The arrays of an npz file, which may take so many bytes; every member is read whole and its checksum checked."""
    arrays = {}
    with _reading(file), open_file(file) as stream, zipfile.ZipFile(stream) as archive:
        claimed = sum(member.file_size for member in archive.infolist())
        if claimed > room:
            raise InvalidProblemError(
                f"damaged: its arrays take {claimed} bytes; the trajectory in solution.json takes {room} at most"
            )
        for member in archive.infolist():
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InvalidProblemError("damaged: packed in a way that NumPy does not use")
            name = member.filename
            with archive.open(member) as packed:
                # asked for that many bytes it unpacks no more, whatever there is
                unpacked = packed.read(member.file_size + 1)
            array = np.lib.format.read_array(BytesIO(unpacked), allow_pickle=False)
            if array.dtype.kind not in "iuf":
                raise InvalidProblemError("expected numbers", path=name.removesuffix(".npy"))
            arrays[name.removesuffix(".npy")] = array.astype(float)
    return arrays


def _shapes(problem: PlanningProblem) -> dict[str, tuple[int, ...]]:
    """The shape of one sample of everything that a trajectory of this system may hold."""
    start, rest = problem.start_point[None], np.zeros((1, problem.system.input_space.size))
    sample = numeric_system(problem.system).trajectory(start, rest, problem.scale)
    return {"t": (), **{name: np.shape(values)[1:] for name, values in sample.items()}}


def _check_shapes(
    arrays: Mapping[str, Array], shapes: Mapping[str, tuple[int, ...]], problem: PlanningProblem
) -> None:
    """Raises unless time, states and inputs are there and every array has one row of the right shape per time."""
    for name in ("t", *problem.system.state_space.names, *problem.system.input_space.names):
        if name not in arrays:
            raise InvalidProblemError("this array is missing", path=name)
    times = arrays["t"]
    if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all():
        raise InvalidProblemError("expected two finite times or more", path="t")
    for name, values in arrays.items():
        expected = (times.size, *shapes.get(name, values.shape[1:]))
        if values.shape != expected:
            raise InvalidProblemError(f"shape {values.shape}; expected {expected}", path=name)


def _check_same(arrays: Mapping[str, Array], tables: Mapping[str, Array]) -> None:
    """Raises unless arrays.npz and the trajectory of solution.json agree."""
    for name in arrays.keys() & tables.keys():
        values = np.where(np.isfinite(arrays[name]), arrays[name], np.nan)
        if values.shape != tables[name].shape or not np.allclose(
            values, tables[name], rtol=SAME, atol=1e-12, equal_nan=True
        ):
            raise InvalidProblemError("differs from the trajectory in solution.json", path=name)


def _solution(
    stored: StoredSolution, problem: PlanningProblem, control: Control, arrays: dict[str, Array], log: str
) -> Solution:
    verdict = _verdict(stored, stored.verified, problem) if stored.verified else None
    later = verdict.warnings if verdict else ()
    as_stored = {
        part.name: getattr(stored, part.name) for part in fields(Solution) if hasattr(stored, part.name)
    }
    read: dict[str, Any] = {
        **as_stored,
        "problem": problem,
        "control": control,
        "trajectory": arrays,
        "iterations": [record.model_dump(exclude_unset=True) for record in stored.iterations],
        "warnings": [warning for warning in stored.warnings if warning not in later],
        "log": log,
        "verdict": verdict,
    }
    return Solution(**read)


def _verdict(stored: StoredSolution, verified: StoredVerdict, problem: PlanningProblem) -> Verdict:
    bounds, original = {bound.label: bound for bound in problem.bounds}, verified.original
    parts: dict[str, Any] = {
        **dict(verified),
        "original": Replay(**dict(original)) if original else None,
        "crossings": [crossing.crossing() for crossing in stored.crossings],
        "bounds": [r.report(bounds[k]) for k, r in stored.constraints.items() if k in bounds],
    }
    return Verdict(**parts)
