"""A run's measurements from a CSV file, with the columns that `nhpocp simulate`, `export` and `solve` write."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError, suggestion
from nhpocp.machine.calibration.measurements import Measurements, measured, motors_of
from nhpocp.problem_file.document import open_file
from nhpocp.state_space import Block
from nhpocp.systems.parallel_robot import ParallelRobot

LARGEST = 200_000_000  # bytes
ANGLES = ("roll", "pitch", "yaw")  # [rad], of the one rotation of a state
QUATERNION = tuple(f"orientation_quaternion_{i}" for i in range(1, 5))  # w, x, y, z
OFF_UNIT = 0.05  # how far the norm of a measured quaternion may be from 1


def read_measurements(file: Path, system: ParallelRobot) -> Measurements:
    """A run: t, leg_lengths_1 … of the legs with a motor, and the pose, position_1 … and one writing of the rotation.

    The rotation as orientation_1_1 … orientation_3_3, as orientation_quaternion_1 … 4 (w, x, y, z), or as roll, pitch,
    yaw [rad]; a pose is not measured in rows where a cell of it is empty. Further columns do not matter.
    Errors: `InvalidProblemError` with file and line, naming the columns that are missing.
    """
    names, lines, table = _read(file)
    column = {name: table[:, i] for i, name in enumerate(names)}
    motors = [f"leg_lengths_{i + 1}" for i in motors_of(system)]
    _require(["t", *motors], column, file)
    run = {"t": column["t"], "leg_lengths": np.column_stack([column[name] for name in motors])}
    for block in system.state_space.blocks:
        run[block.name] = (
            _rotations(block, column, file, lines)
            if block.kind == "rotation"
            else _block(block, column, file)
        )
    for name in ("t", *motors):
        if (lost := ~np.isfinite(column[name])).any():
            words = f"{name}: nothing here; expected a number (only poses may be missing)"
            raise InvalidProblemError(words, file=str(file), line=lines[int(np.argmax(lost))])
    if len(table) > 1 and (back := np.diff(column["t"]) <= 0).any():
        k = int(np.argmax(back))
        words = f"t: {column['t'][k + 1]:.9g} after {column['t'][k]:.9g}; expected times that rise"
        raise InvalidProblemError(words, file=str(file), line=lines[k + 1])
    try:
        return measured(run, system, file.name)
    except InvalidProblemError as error:
        raise error.changed(
            file=str(file), path=(error.path or "").removeprefix(file.name).strip(".") or None
        ) from None


def _block(block: Block, column: dict[str, Array], file: Path) -> Array:
    names = [block.name] if block.kind == "scalar" else [f"{block.name}_{i + 1}" for i in range(block.size)]
    _require(names, column, file)
    return np.column_stack([column[name] for name in names])


def _rotations(block: Block, column: dict[str, Array], file: Path, lines: list[int]) -> Array:
    """(k, 9), NaN where a cell is empty."""
    entries = [f"{block.name}_{i}_{j}" for i in range(1, 4) for j in range(1, 4)]
    quaternion = [name.replace("orientation", block.name) for name in QUATERNION]
    ways = [names for names in (entries, quaternion, list(ANGLES)) if any(name in column for name in names)]
    if not ways:
        words = (
            f"no column of the rotation {block.name!r}; expected {entries[0]} … {entries[-1]}, {quaternion[0]} … "
            f"{quaternion[-1]} (w, x, y, z), or roll, pitch, yaw [rad]"
        )
        raise InvalidProblemError(words, file=str(file), line=1)
    names = next((names for names in ways if all(name in column for name in names)), ways[0])
    _require(names, column, file)
    table = np.column_stack([column[name] for name in names])
    if names is entries:
        return table
    there = np.isfinite(table).all(axis=1)
    matrices = np.full((len(table), 9), np.nan)
    for k in np.flatnonzero(there):
        row = table[k]
        if names is quaternion:
            size = float(np.linalg.norm(row))
            if abs(size - 1) > OFF_UNIT:
                words = f"{names[0]} …: its norm is {size:.6g}; expected a unit quaternion w, x, y, z"
                raise InvalidProblemError(words, file=str(file), line=lines[k])
            row = row / size
        matrices[k] = np.ravel((so3.from_quaternion if names is quaternion else so3.from_rpy)(row))
    return matrices


def _require(names: Sequence[str], column: dict[str, Array], file: Path) -> None:
    missing = [name for name in names if name not in column]
    if not missing:
        return
    near = suggestion(
        missing[0], column, none="expected the columns that `nhpocp simulate` and `export` write"
    )
    words = f"no column {', '.join(missing)}; {near}"
    raise InvalidProblemError(words, file=str(file), line=1)


def _read(file: Path) -> tuple[list[str], list[int], Array]:
    """Header, the line of each row, and the numbers; NaN for empty cells."""
    name = str(file)
    try:
        with open_file(file) as stream:
            raw = stream.read(LARGEST + 1)
    except FileNotFoundError:
        raise InvalidProblemError("no such file; expected a table of measurements (CSV)", file=name) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidProblemError(f"cannot read this file: {reason}", file=name) from None
    if len(raw) > LARGEST:
        raise InvalidProblemError("larger than 200 MB; expected the table of one run", file=name)
    try:
        reader = csv.reader(raw.decode("utf-8-sig").splitlines(), strict=True)
        header = [cell.strip() for cell in next(reader, [])]
        lines, rows = [], []
        for row in reader:
            if row and any(cell.strip() for cell in row):
                lines.append(reader.line_num)
                rows.append(_numbers(row, header, name, reader.line_num))
    except UnicodeDecodeError as error:
        raise InvalidProblemError(
            f"this is no text in UTF-8 ({error.reason}); expected CSV", file=name
        ) from None
    except csv.Error as error:
        raise InvalidProblemError(f"this is no CSV: {error}", file=name, line=reader.line_num) from None
    if twice := [each for each in header if header.count(each) > 1]:
        raise InvalidProblemError(f"two columns are called {twice[0]!r}", file=name, line=1)
    if not rows:
        raise InvalidProblemError("no row of measurements; expected a header and a row a sample", file=name)
    return header, lines, np.array(rows)


def _numbers(row: list[str], header: list[str], file: str, line: int) -> list[float]:
    if len(row) != len(header):
        words = f"{len(row)} cells; expected {len(header)}, as in the header"
        raise InvalidProblemError(words, file=file, line=line)
    numbers = []
    for column, cell in zip(header, row, strict=True):
        try:
            numbers.append(float(cell) if cell.strip() else float("nan"))
        except ValueError:
            raise InvalidProblemError(
                f"{column}: {cell!r}; expected a number", file=file, line=line
            ) from None
    return numbers
