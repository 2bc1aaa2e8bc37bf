"""Values as one line of plain text: what a prompt shows of an object, and nothing that a terminal would obey."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sized
from itertools import islice
from typing import Any

LONGEST = 130  # characters, beyond which what stands at its default is left out
FEW = 9  # numbers of an array that are shown: a rotation matrix
ENTRIES = 6  # of a list or mapping
# all but tab and newline; then what turns the direction of writing round, and other ends of lines
CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """A text with its control sequences spelt out: read from a file they would be the file's to command with."""
    return CONTROLS.sub(lambda match: ascii(match[0])[1:-1], text)


def brief(value: Any) -> str:
    """A value in a few words of one line: numbers with six digits, of what is large its shape."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, type):
        return value.__name__
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and hasattr(value, "tolist"):  # NumPy's
        return brief(value.tolist()) if value.size <= FEW else f"<array {' × '.join(map(str, shape))}>"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key!r}: {brief(entry)}" for key, entry in islice(value.items(), ENTRIES))
        return f"{{{visible(inner)}}}" if _short(value, inner) else f"<mapping of {len(value)}>"
    if isinstance(value, list | tuple):
        inner = ", ".join(map(brief, value[:ENTRIES]))
        if not _short(value, inner):
            return f"<{'list' if isinstance(value, list) else 'tuple'} of {len(value)}>"
        return f"[{inner}]" if isinstance(value, list) else f"({inner}{',' if len(value) == 1 else ''})"
    text = visible(" ".join(repr(value).split()))
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def _short(entries: Sized, text: str) -> bool:
    return len(entries) <= ENTRIES and len(text) <= LONGEST


def as_call(name: str, arguments: Iterable[tuple[str, Any, Any]]) -> str:
    """The call that makes an object, in one line: arguments by name with their values and defaults.

    All of them where the line holds them, but for those that are absent; else the first and what differs.
    """
    every = [(key, value, _equal(value, default)) for key, value, default in arguments]
    whole = [(key, value) for key, value, same in every if not (same and value is None)]
    first = [(key, value) for i, (key, value, same) in enumerate(every) if i == 0 or not same]
    for shown in (whole, first):
        line = f"{name}({', '.join(f'{key}={brief(value)}' for key, value in shown)})"
        if len(line) <= LONGEST:
            break
    return line


def _equal(value: Any, default: Any) -> bool:
    alike = type(value) is type(default) and not hasattr(value, "shape")
    return value is default or (alike and bool(value == default))
