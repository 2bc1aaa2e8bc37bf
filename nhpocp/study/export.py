"""The rows of a store as a table for other programs."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nhpocp.csv_writer import write_table
from nhpocp.errors import MissingDependencyError
from nhpocp.study.store import COLUMNS, Row, Store
from nhpocp.whole import write_file

CHUNK = 1000  # rows of a Parquet file at a time
LEFT_OUT = ("parameters", "margins", "solved_control", "settings", "extremes", "limits", "warnings")  # JSON


def write_csv(store: Store, file: Path) -> None:
    """A CSV file, a row a run: number, axes, ending, costs, margins. Memory does not grow with the rows."""

    def write(scratch: Path) -> None:
        margins = _margins(store)
        names = _names(store, margins)
        with scratch.open("w", encoding="utf-8", newline="") as stream:
            write_table(stream, names, (list(row.values()) for row in _table(store, margins)))

    write_file(file, write)


def write_parquet(store: Store, file: Path) -> None:
    """A Parquet file of the same rows. Errors: `MissingDependencyError` without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        words = 'Parquet needs pyarrow; install it with: pip install "nhpocp[parquet]"'
        raise MissingDependencyError(words) from None

    def write(scratch: Path) -> None:
        margins = _margins(store)
        kinds = {"INTEGER": pa.int64(), "REAL": pa.float64(), "TEXT": pa.string()}
        types = {name: kinds[kind.split()[0]] for name, kind in COLUMNS.items()}
        types |= dict.fromkeys(margins, pa.float64())
        numeric = set(store.axes)
        for row in _table(store, margins):
            numeric -= {path for path in numeric if not isinstance(row[path], int | float | None)}
        types |= {path: pa.float64() if path in numeric else pa.string() for path in store.axes}
        schema = pa.schema([(name, types[name]) for name in _names(store, margins)])
        with pq.ParquetWriter(scratch, schema) as writer:
            for rows in _chunks(_table(store, margins)):
                for row in rows:
                    row |= {path: _text(row[path]) for path in store.axes if path not in numeric}
                    row |= {name: _number(row[name]) for name in [*numeric, *margins]}
                writer.write_table(pa.Table.from_pylist(rows, schema))

    write_file(file, write)


FORMATS = {"csv": write_csv, "parquet": write_parquet}


def _names(store: Store, margins: list[str]) -> list[str]:
    ours = [name for name in COLUMNS if name not in LEFT_OUT]
    place = ours.index("outcome")
    return [*ours[:place], *store.axes, *ours[place:], *margins]


def _margins(store: Store) -> list[str]:
    """The margins that some run knows."""
    names: dict[str, None] = {}
    for row in store.rows("margins IS NOT NULL"):
        names |= dict.fromkeys(json.loads(row["margins"]))
    return list(names)


def _table(store: Store, margins: list[str]) -> Iterator[Row]:
    names = _names(store, margins)
    for row in store.rows():
        values = row | json.loads(row["parameters"]) | json.loads(row["margins"] or "{}")
        yield {name: _cell(values.get(name)) for name in names}


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


def _number(value: int | float | None) -> float | None:
    """Of any size: Arrow takes no whole number that a double does not hold."""
    try:
        return None if value is None else float(value)
    except OverflowError:
        return math.inf if value and value > 0 else -math.inf


def _text(value: Any) -> str | None:
    return value if value is None or isinstance(value, str) else json.dumps(value)


def _chunks(rows: Iterator[Row]) -> Iterator[list[Row]]:
    part: list[Row] = []
    for row in rows:
        part.append(row)
        if len(part) == CHUNK:
            yield part
            part = []
    if part:
        yield part
