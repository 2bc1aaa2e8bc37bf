"""What the cells of a store may hold: checked when rows are read, since the file may have met others."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from nhpocp.errors import InvalidProblemError, describe
from nhpocp.outcome import Outcome

KINDS: dict[str, tuple[type, ...]] = {"INTEGER": (int,), "REAL": (float, int), "TEXT": (str,)}
NAMES = {"INTEGER": "a whole number", "REAL": "a number", "TEXT": "text"}
# columns whose text is JSON, and of what
SHAPES: dict[str, type] = {
    **dict.fromkeys(("parameters", "margins", "limits", "settings", "solved_control"), dict),
    "warnings": list,
}
EXPORTED = ("parameters", "margins")  # small, and read of every row
OUTCOMES = frozenset(outcome.value for outcome in Outcome)


def check_row(row: Mapping[str, Any], columns: Mapping[str, str]) -> None:
    """Errors: `InvalidProblemError` for a cell of another kind than its column's; long JSON is left to `parsed`."""
    for name, declared in columns.items():
        value, kind = row[name], declared.split()[0]
        if value is None and "NOT NULL" not in declared and "KEY" not in declared:
            continue
        if not isinstance(value, KINDS[kind]):
            raise _error(row, name, f"expected {NAMES[kind]}, got {describe(value)}")
    if row["outcome"] not in OUTCOMES:
        raise _error(row, "outcome", f"{describe(row['outcome'])} is no outcome")
    for name in EXPORTED:
        parsed(row, name)


def parsed(row: Mapping[str, Any], name: str) -> Any:
    """What a column of JSON holds; an empty mapping or list where it holds nothing. Errors: `InvalidProblemError`."""
    shape = SHAPES[name]
    if row[name] is None:
        return shape()
    try:
        value: Any = json.loads(row[name])
    except (ValueError, RecursionError) as error:
        raise _error(row, name, f"this is not JSON ({type(error).__name__})") from None
    fits = isinstance(value, shape)
    if not fits:
        wanted = "a mapping" if shape is dict else "a list"
        raise _error(row, name, f"expected {wanted}, got {describe(value)}")
    if name == "margins" and not all(isinstance(each, float | int | None) for each in value.values()):
        raise _error(row, name, "expected numbers")
    return value


def check_whole(row: Mapping[str, Any], axes: Sequence[str]) -> None:
    """Errors: `InvalidProblemError` for JSON that is none, or values that are not those of the axes."""
    for name in SHAPES:
        parsed(row, name)
    given = parsed(row, "parameters")
    if given.keys() != set(axes):
        raise _error(row, "parameters", f"expected values of {', '.join(axes)}, got {describe(given)}")


def _error(row: Mapping[str, Any], name: str, words: str) -> InvalidProblemError:
    return InvalidProblemError(f"damaged: {words}", path=f"run {row['run']}: {name}")
