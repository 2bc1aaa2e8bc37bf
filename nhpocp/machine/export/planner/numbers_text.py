"""Numbers as C declarations."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

WIDTH = 116


def number(value: Any) -> str:
    """One number, from which the same one is read; a text stands as it is."""
    if isinstance(value, str):
        return value
    if isinstance(value, float | np.floating):
        text = repr(float(value))
        return {"inf": "HUGE_VAL", "-inf": "-HUGE_VAL"}.get(text, text)
    return str(int(value))


def array(kind: str, name: str, values: Any, shape: str = "[]") -> str:
    """`static const kind name[] = {…};`, all dimensions but the first said by ``shape``."""
    return f"static const {kind} {name}{shape} = {braced(values)};"


def braced(values: Any) -> str:
    """{…}, row by row, in lines."""
    given = values.tolist() if isinstance(values, np.ndarray) else list(values)
    if given and isinstance(given[0], list):
        return "{\n" + ",\n".join(braced(row) for row in given) + "}"
    return textwrap.fill(
        "{" + ", ".join(map(number, given)) + "}", WIDTH, break_long_words=False, break_on_hyphens=False
    )


def enumerated(sizes: Mapping[str, int]) -> str:
    """An enum of sizes."""
    body = ", ".join(f"{name} = {size}" for name, size in sizes.items())
    return textwrap.fill(f"enum {{ {body} }};", WIDTH, break_long_words=False, subsequent_indent="       ")


def defined(constants: Mapping[str, Any]) -> str:
    """#defines, each with its own value in parentheses where that is negative."""
    return "\n".join(f"#define {name} {number(value)}" for name, value in constants.items())


def lines(parts: Iterable[str]) -> str:
    return "\n".join(part for part in parts if part)
