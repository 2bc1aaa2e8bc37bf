"""What a problem file may set of a dataclass: fields that say what they mean and which values they take.

From these lines the schema, `nhpocp init`, choices and messages are derived; pydantic stays on the files' floor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, is_dataclass
from math import isfinite
from numbers import Real
from typing import Any, Literal

from nhpocp.errors import InvalidProblemError, describe, suggestion

LARGEST_COUNT = 100_000  # intervals, steps
LARGEST_DEGREE = 1000  # harmonics
Kind = Literal["whole", "auto or whole", "positive", "choice", "truth"]


class Degrees(float):
    """An angle [rad] that was written in degrees, in which messages say it again; so is a multiple of it."""

    def __mul__(self, factor: Any) -> Any:
        product = float(self) * factor
        return Degrees(product) if isinstance(product, float) else product

    __rmul__ = __mul__


@dataclass(frozen=True)
class Declared:
    """One field. least, most: of whole numbers, None for no limit; choices: names."""

    kind: Kind
    meaning: str
    default: Any
    least: int = 0
    most: int | None = None
    choices: tuple[str, ...] = ()

    def checked(self, value: Any, path: str) -> Any:
        """A value for this field as plain data; any kind of number will do.

        Errors: `InvalidProblemError` at the path, with what came and what was expected.
        """
        if self.kind == "choice":
            if value not in self.choices:
                came = value if isinstance(value, str) else ""
                words = f"expected one of {', '.join(self.choices)}, got {describe(value)}"
                near = suggestion(came, self.choices)
                raise InvalidProblemError(f"{words}; {near}" if "did you" in near else words, path=path)
            return value
        if self.kind == "truth":
            if value not in (True, False) or isinstance(value, str):
                raise InvalidProblemError(f"expected True or False, got {describe(value)}", path=path)
            return bool(value)
        if self.kind == "auto or whole" and (value is None or value == "auto"):
            return value
        if self.kind == "positive":
            number = real(value, path, "a number > 0")
            if number <= 0:
                raise InvalidProblemError(f"{number:g} is not positive; expected a number > 0", path=path)
            return number
        least = 1 if self.kind == "auto or whole" else self.least
        return whole_number(value, path, least, self.most)


def real(value: Any, path: str | None, wanted: str = "a number") -> float:
    """A finite number as Python's own, of whatever library it is.

    Errors: `InvalidProblemError` at the path; a text is told how degrees are written.
    """
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InvalidProblemError(f"expected {wanted}, got {describe(value)}{degrees_hint(value)}", path=path)
    try:
        number = value if isinstance(value, Degrees) else float(value)
    except OverflowError:
        number = float("inf")
    if not isfinite(number):
        came = "NaN" if number != number else "infinity"
        raise InvalidProblemError(f"{came}; expected a finite number", path=path)
    return number


def whole_number(value: Any, path: str | None, least: int = 0, most: int | None = None) -> int:
    """A whole number between limits, as `real`."""
    span = f"from {least} to {most}" if most is not None else f">= {least}"
    number = real(value, path, f"a whole number {span}")
    if number != int(number):
        raise InvalidProblemError(f"{number:g} is not a whole number; expected one {span}", path=path)
    if number < least or (most is not None and number > most):
        words = f"{number:.12g} is out of range; expected a whole number {span}"
        raise InvalidProblemError(words, path=path)
    return int(number)


def degrees_hint(value: Any) -> str:
    """How angles are written in Python, where a text says degrees."""
    texts = [value] if isinstance(value, str) else value if isinstance(value, list | tuple) else []
    written = any(isinstance(text, str) and ("deg" in text or "°" in text) for text in texts)
    return "; in Python write 30 deg as 30 * nhpocp.deg" if written else ""


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
    """The declared fields of a dataclass, in order; none of another class."""
    of = fields(cls) if is_dataclass(cls) else ()
    return {f.name: f.metadata["declared"] for f in of if "declared" in f.metadata}


def check(made: Any) -> None:
    """Holds the fields of a frozen dataclass against what is declared of them.

    Errors: `InvalidProblemError` at `Class.field`.
    """
    for name, one in declarations(type(made)).items():
        object.__setattr__(made, name, one.checked(getattr(made, name), f"{type(made).__name__}.{name}"))
