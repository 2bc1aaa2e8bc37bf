"""What a problem file may set of a dataclass: fields that say what they mean and which values they take.

From these lines the schema, `nhpocp init`, choices and messages are derived; pydantic stays on the files' floor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any, Literal

LARGEST_COUNT = 100_000  # intervals, steps
LARGEST_DEGREE = 1000  # harmonics
Kind = Literal["whole", "auto or whole", "positive", "choice", "truth"]


@dataclass(frozen=True)
class Declared:
    """One field. least, most: of whole numbers, None for no limit; choices: names."""

    kind: Kind
    meaning: str
    default: Any
    least: int = 0
    most: int | None = None
    choices: tuple[str, ...] = ()


def declared(kind: Kind, default: Any, meaning: str, **limits: Any) -> Any:
    """A dataclass field that a file may set."""
    return field(default=default, metadata={"declared": Declared(kind, meaning, default, **limits)})


def count(default: int, meaning: str) -> Any:
    """Of intervals, steps or tries."""
    return declared("whole", default, meaning, least=1, most=LARGEST_COUNT)


def degree(default: int, meaning: str) -> Any:
    """Of polynomials or harmonics."""
    return declared("whole", default, meaning, most=LARGEST_DEGREE)


def whole(default: int, meaning: str) -> Any:
    """A whole number ≥ 0."""
    return declared("whole", default, meaning)


def positive(default: float, meaning: str) -> Any:
    """A number > 0."""
    return declared("positive", default, meaning)


def choice(default: str, names: Iterable[str], meaning: str) -> Any:
    """One of some names, those of a `Family` say."""
    return declared("choice", default, meaning, choices=tuple(names))


def declarations(cls: type[Any]) -> dict[str, Declared]:
    """The declared fields of a dataclass, in order."""
    return {f.name: f.metadata["declared"] for f in fields(cls) if "declared" in f.metadata}
