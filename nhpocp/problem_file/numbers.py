"""Numbers as a problem file may write them: 0.5, -pi/6, 2*pi/3, 75 deg. Nothing else is evaluated."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import isfinite, pi
from typing import Annotated, Any

from pydantic_core import CoreSchema, core_schema

from nhpocp.declared import LARGEST_COUNT

_DECIMAL = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_PI = re.compile(rf"(?P<sign>-)?(?:(?P<factor>{_DECIMAL})\*)?pi(?:/(?P<divisor>{_DECIMAL}))?")
_DEGREES = re.compile(rf"(?P<degrees>[-+]?{_DECIMAL}(?:[eE][-+]?[0-9]+)?) +deg")
_PATTERN = rf"^(-?({_DECIMAL}\*)?pi(/{_DECIMAL})?|[-+]?{_DECIMAL}([eE][-+]?[0-9]+)? +deg)$"

PLAUSIBLE = 1e-50, 1e50  # a unit's size: its squares and their products are still numbers


class Checked:
    """Annotation of a field: a validator and the JSON schema of what it accepts.

    pydantic's PlainValidator with WithJsonSchema says the same, but inspects the validator's signature at every use:
    10 ms of the third of a second that `nhpocp check` has.
    """

    def __init__(self, validate: Callable[[Any], Any], schema: dict[str, Any]) -> None:
        self.validate, self.schema = validate, schema

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        return dict(self.schema)


class Choice:
    """Annotation of a field: one of these names, those of a `Family` say."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.literal_schema(list(self.names))


def describe(value: Any) -> str:
    """A value from a file in plain words, for error messages."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return f"the truth value {str(value).lower()}"
    if isinstance(value, int | float):
        return f"the number {value:.12g}" if abs(value) < 1e300 else "a number too large"
    if isinstance(value, str):
        return f"the text {value!r}" if len(value) <= 40 else f"the text {value[:37]!r}…"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return "a mapping" if isinstance(value, dict) else f"a {type(value).__name__}"


def parse_number(value: Any) -> float:
    """The number that a value from a file stands for.

    Errors: ValueError in words fit for the user.
    """
    if isinstance(value, str):
        number = _from_text(value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, got {describe(value)}")
    else:
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
    if not isfinite(number):
        raise ValueError(f"{'NaN' if number != number else 'infinity'}; expected a finite number")
    return number


def _from_text(text: str) -> float:
    if found := _DEGREES.fullmatch(text):
        return float(found["degrees"]) * pi / 180
    if found := _PI.fullmatch(text):
        divisor = float(found["divisor"] or 1)
        if divisor == 0:
            raise ValueError(f"{text!r} divides by zero")
        number = float(found["factor"] or 1) * pi / divisor
        return -number if found["sign"] else number
    raise ValueError(f"expected a number, got {describe(text)}{_hint(text)}")


def _hint(text: str) -> str:
    """What to write instead, where the intention can be guessed."""
    squeezed = re.sub(r"\s+|_", "", text)
    if found := re.fullmatch(r"(.*?[0-9.])(deg|°|degrees?)", squeezed, re.IGNORECASE):
        return f"; write {found[1] + ' deg'!r}" if _DEGREES.fullmatch(found[1] + " deg") else ""
    if text != squeezed and _PI.fullmatch(squeezed):
        return f"; write {squeezed!r}"
    if re.fullmatch(rf"[-+]?{_DECIMAL}([eE][-+]?[0-9]+)?", squeezed):
        return f"; write {squeezed}" if squeezed != text else "; remove the quotes"
    if found := re.fullmatch(rf"([-+]?{_DECIMAL}(?:[eE][-+]?[0-9]+)?)([a-zA-Zµ/]+)", squeezed):
        if found[2] in ("rad", "radian", "radians"):
            return f"; radians are plain numbers: write {found[1]}"
        return f"; {found[2]!r} is no unit here, only deg is: write {found[1]}, in the unit of your other numbers"
    return "; numbers are written 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg" if re.search("pi|[0-9]", text) else ""


def _positive(value: Any) -> float:
    number = parse_number(value)
    if number <= 0:
        raise ValueError(f"{number:g} is not positive; expected a number > 0")
    return number


def _size(value: Any) -> float:
    number = _positive(value)
    least, most = PLAUSIBLE
    if not least <= number <= most:
        raise ValueError(f"{number:g} is out of range; expected a number from {least:g} to {most:g}")
    return number


def _not_negative(value: Any) -> float:
    number = parse_number(value)
    if number < 0:
        raise ValueError(f"{number:g} is negative; expected a number >= 0")
    return number


def _share(value: Any) -> float:
    number = parse_number(value)
    if not 0 < number < 1:
        raise ValueError(f"{number:g} is not inside the horizon; expected a share between 0 and 1")
    return number


def _whole(least: int, most: int | None) -> Callable[[Any], int]:
    """A validator of whole numbers between two limits."""
    span = f"from {least} to {most}" if most is not None else f">= {least}"

    def validate(value: Any) -> int:
        number = parse_number(value)
        if number != int(number):
            raise ValueError(f"{number:g} is not a whole number; expected one {span}")
        if number < least or (most is not None and number > most):
            raise ValueError(f"{number:.12g} is out of range; expected a whole number {span}")
        return int(number)

    return validate


def _auto_or_count(value: Any) -> int | str:
    if value == "auto":
        return "auto"
    if isinstance(value, str) and not re.search("[0-9]", value):
        raise ValueError(f"expected auto or a whole number, got {describe(value)}")
    return _whole(1, LARGEST_COUNT)(value)


def _integer_schema(least: int, most: int | None) -> dict[str, Any]:
    limits = {"minimum": least} if most is None else {"minimum": least, "maximum": most}
    return {"type": "integer", **limits}


def checked_whole(least: int, most: int | None) -> Checked:
    return Checked(_whole(least, most), _integer_schema(least, most))


NUMBER_SCHEMA: dict[str, Any] = {
    "type": ["number", "string"],
    "pattern": _PATTERN,  # of texts; limits are of numbers
    "patternErrorMessage": "expected a number such as 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg",  # editors show it
}

Number = Annotated[float, Checked(parse_number, NUMBER_SCHEMA)]
Positive = Annotated[float, Checked(_positive, {**NUMBER_SCHEMA, "exclusiveMinimum": 0})]
Size = Annotated[float, Checked(_size, {**NUMBER_SCHEMA, "minimum": PLAUSIBLE[0], "maximum": PLAUSIBLE[1]})]
NotNegative = Annotated[float, Checked(_not_negative, {**NUMBER_SCHEMA, "minimum": 0})]
Share = Annotated[
    float,
    Checked(_share, {**NUMBER_SCHEMA, "exclusiveMinimum": 0, "exclusiveMaximum": 1}),
]
Whole = Annotated[int, checked_whole(0, None)]
Count = Annotated[int, checked_whole(1, LARGEST_COUNT)]
AutoOrCount = Annotated[
    int | str, Checked(_auto_or_count, {"anyOf": [{"const": "auto"}, _integer_schema(1, LARGEST_COUNT)]})
]
Samples = Annotated[int, checked_whole(2, 1_000_000)]
