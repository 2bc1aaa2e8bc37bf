"""Values of the `constraints` block as Python or a file writes them, brought into the shapes that kinds take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nhpocp.constraints.kind import Shape, Side
from nhpocp.declared import Degrees, real
from nhpocp.errors import InvalidProblemError, describe

PAIR = "[lo, hi], or {min: …, max: …} with one or both"


def as_written(value: Any, shape: Shape, side: Side = "max") -> Any:
    """A value of a kind's shape as plain lists and numbers, None for an open side.

    Tuples and arrays are lists, {"max": 3} is [None, 3], an infinite side an open one. side: which one a single number
    of the kind is, so that {"max": 3} is 3.
    Errors: `InvalidProblemError`, its path inside the value.
    """
    value = _plain(value)
    if shape == "number":
        return _size(value, side)
    if shape == "pair":
        return _pair(value)
    if shape == "number or pairs":
        if isinstance(value, list):
            return [_inside(pair, f"[{i}]", _pair) for i, pair in enumerate(value)]
        return _size(value, side)
    if not isinstance(value, dict):
        raise InvalidProblemError(f"expected {PAIR} by name, got {describe(value)}")
    return {name: _inside(pair, str(name), _sides) for name, pair in value.items()}


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _inside(value: Any, path: str, read: Any) -> Any:
    try:
        return read(value)
    except InvalidProblemError as error:
        raise error.under(path) from None


def in_degrees(value: Any) -> bool:
    """Whether any number in a value was written in degrees."""
    if isinstance(value, dict | list):
        return any(map(in_degrees, value.values() if isinstance(value, dict) else value))
    return isinstance(value, Degrees)


def _size(value: Any, side: Side) -> float:
    if isinstance(value, dict):
        if set(value) != {side}:
            other = "".join(f" {name}" for name in value if name != side)
            raise InvalidProblemError(f"expected a number, or {{{side}: …}}; got{other or ' no side'}")
        value = value[side]
    number = real(value, None, "a number >= 0")
    if number < 0:
        raise InvalidProblemError(f"{number:g} is negative; expected a number >= 0")
    return number


def _pair(value: Any) -> list[Any]:
    return [_side(side) for side in _both(value)]


def _sides(value: Any) -> list[Any]:
    """A pair, or lists of both sides."""
    return [[_side(x) for x in side] if isinstance(side, list) else _side(side) for side in _both(value)]


def _both(value: Any) -> list[Any]:
    if isinstance(value, dict) and value and set(value) <= {"min", "max"}:
        low, high = value.get("min"), value.get("max")
        length = next((len(side) for side in (low, high) if isinstance(side, list)), None)
        return [[None] * length if side is None and length is not None else side for side in (low, high)]
    if not isinstance(value, list) or len(value) != 2:
        raise InvalidProblemError(f"expected {PAIR}, got {describe(value)}")
    return value


def _side(value: Any) -> float | None:
    return None if value is None or value in (float("inf"), -float("inf")) else real(value, None)
