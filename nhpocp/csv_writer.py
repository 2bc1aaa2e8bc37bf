"""Tables as CSV, for every file: numbers read back as they were, and no text is one that a spreadsheet executes."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable
from typing import Any, TextIO

FORMULA = tuple("=+-@＝＋－＠")  # what a spreadsheet executes, after spaces too


def write_table(
    stream: TextIO, names: Iterable[str], rows: Iterable[Iterable[Any]], truth: tuple[str, str] = ("0", "1")
) -> None:
    """A header and rows; ``truth``: how False and True are spelt."""
    writer = csv.writer(stream)  # lines end in \r\n: with another end a \r within a text would go unquoted
    writer.writerow([as_text(name) for name in names])
    writer.writerows([_cell(value, truth) for value in row] for row in rows)


def identifiers(names: Iterable[str]) -> list[str]:
    """Names that are identifiers, each once: what is none is written with underscores, what is taken gets a number."""
    taken: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        base = other = plain if re.match("[A-Za-z]", plain) else f"x{plain}"
        count = 1
        while other in taken:
            count += 1
            other = f"{base}_{count}"
        taken.append(other)
    return taken


def as_text(text: str) -> str:
    """A text for a cell: with an apostrophe before it, it is one to a spreadsheet."""
    return f"'{text}" if text[:1] in ("\t", "\r", "\n") or text.lstrip().startswith(FORMULA) else text


def _cell(value: Any, truth: tuple[str, str]) -> Any:
    """A value as text that reads back as the same number; what is missing or not finite as nothing."""
    if type(value) is float:  # most are
        return repr(value) if math.isfinite(value) else ""
    if isinstance(value, str):
        return as_text(value)
    if hasattr(value, "item"):  # NumPy's
        value = value.item()
    if isinstance(value, bool):
        return truth[value]
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ""
    return value  # csv writes None as nothing
