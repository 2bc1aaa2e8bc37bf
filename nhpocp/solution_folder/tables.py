"""Tables of a solution as CSV: the trajectory by time, the iterations by evaluation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.csv_writer import write_table
from nhpocp.errors import MissingDependencyError
from nhpocp.solution import Solution
from nhpocp.solution_folder.columns import columns

# what a reader looks for first; further keys follow in the order in which the records name them
FIRST = ("k", "attempt", "error", "objective", "step", "gamma", "rank", "sigma_jacobian")
LAST = ("accepted",)


def write_trajectory(solution: Solution, file: Path) -> None:
    """A row per sample: time, then every number of every quantity, then what follows from them."""
    every = columns(solution)
    table = np.column_stack([column.values for column in every])
    _write(file, [column.name for column in every], table.tolist())


def write_columns(solution: Solution, file: Path) -> None:
    """A row per column of that table: its unit, where its numbers stand in arrays.npz, and what they are."""
    rows = [(column.name, column.unit, column.entry, column.meaning) for column in columns(solution)]
    _write(file, ("column", "unit", "entry", "meaning"), rows)


def data_frame(solution: Solution) -> Any:
    """That table as a pandas DataFrame. Errors: `MissingDependencyError` without pandas."""
    try:
        import pandas
    except ImportError as error:
        words = "a data frame needs pandas, which is not installed here; it comes with "
        raise MissingDependencyError(
            f'{words}pip install "nhpocp[notebook]", or pip install pandas'
        ) from error
    return pandas.DataFrame({column.name: column.values for column in columns(solution)})


def write_iterations(solution: Solution, file: Path) -> None:
    """A row per record of the solve, in the order in which the controls were evaluated."""
    names = record_names(solution.iterations)
    _write(file, names, ([record.get(name) for name in names] for record in solution.iterations))


def record_names(records: Iterable[Mapping[str, Any]]) -> list[str]:
    """The keys of all records together, as they stand in the header; of no record, the one that every record has."""
    there = dict.fromkeys(name for record in records for name in record) or {"k": None}
    first = [name for name in FIRST if name in there]
    last = [name for name in LAST if name in there]
    return [*first, *(name for name in there if name not in FIRST + LAST), *last]


def _write(file: Path, names: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        write_table(stream, names, rows)
