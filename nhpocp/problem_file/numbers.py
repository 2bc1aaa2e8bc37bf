"""Types of the numbers in a problem file, and the JSON schema of each."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any

from pydantic_core import CoreSchema, core_schema

from nhpocp.declared import LARGEST_COUNT
from nhpocp.errors import describe
from nhpocp.written_numbers import PATTERN, parse_number

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


class AtLeast:
    """Annotation of a list: so many items or more. A `Field` with min_length alone would name one length."""

    def __init__(self, count: int, items: str) -> None:
        self.count, self.items = count, items

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._validated, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        return {**handler(schema), "minItems": self.count}

    def _validated(self, value: list[Any]) -> list[Any]:
        if len(value) < self.count:
            raise ValueError(f"a list of {len(value)}; expected {self.count} or more {self.items}")
        return value


class Choice:
    """Annotation of a field: one of these names, those of a `Family` say."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.literal_schema(list(self.names))


NUMBER_SCHEMA: dict[str, Any] = {
    "type": ["number", "string"],
    "pattern": PATTERN,  # of texts; limits are of numbers
    "patternErrorMessage": "expected a number such as 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg",  # editors show it
}


def _limited(holds: Callable[[float], bool], fault: str, **limits: float) -> Checked:
    """Numbers for which something holds; else what is wrong is said, as in "-1 is not positive"."""

    def validate(value: Any) -> float:
        number = parse_number(value)
        if not holds(number):
            raise ValueError(f"{number:g} {fault}")
        return number

    return Checked(validate, {**NUMBER_SCHEMA, **limits})


def checked_whole(least: int, most: int | None) -> Checked:
    """Whole numbers between two limits."""
    span = f"from {least} to {most}" if most is not None else f">= {least}"

    def validate(value: Any) -> int:
        number = parse_number(value)
        if number != int(number):
            raise ValueError(f"{number:g} is not a whole number; expected one {span}")
        if number < least or (most is not None and number > most):
            raise ValueError(f"{number:.12g} is out of range; expected a whole number {span}")
        return int(number)

    limits = {"minimum": least} if most is None else {"minimum": least, "maximum": most}
    return Checked(validate, {"type": "integer", **limits})


def _word_or(word: str, number: Checked, what: str) -> Checked:
    """One word, or a number."""

    def validate(value: Any) -> Any:
        if value == word:
            return word
        if isinstance(value, str) and not re.search("[0-9]", value):
            raise ValueError(f"expected {word} or {what}, got {describe(value)}")
        return number.validate(value)

    return Checked(validate, {"anyOf": [{"const": word}, number.schema]})


_NOT_NEGATIVE = _limited(lambda x: x >= 0, "is negative; expected a number >= 0", minimum=0)
_COUNT = checked_whole(1, LARGEST_COUNT)

Number = Annotated[float, Checked(parse_number, NUMBER_SCHEMA)]
Positive = Annotated[
    float, _limited(lambda x: x > 0, "is not positive; expected a number > 0", exclusiveMinimum=0)
]
Size = Annotated[
    float,
    _limited(
        lambda x: PLAUSIBLE[0] <= x <= PLAUSIBLE[1],
        f"is out of range; expected a number from {PLAUSIBLE[0]:g} to {PLAUSIBLE[1]:g}",
        minimum=PLAUSIBLE[0],
        maximum=PLAUSIBLE[1],
    ),
]
NotNegative = Annotated[float, _NOT_NEGATIVE]
Share = Annotated[
    float,
    _limited(
        lambda x: 0 < x < 1,
        "is not inside the horizon; expected a share between 0 and 1",
        exclusiveMinimum=0,
        exclusiveMaximum=1,
    ),
]
Whole = Annotated[int, checked_whole(0, None)]
Count = Annotated[int, _COUNT]
AutoOrCount = Annotated[int | str, _word_or("auto", _COUNT, "a whole number")]
Length = Annotated[float | str, _word_or("fixed", _NOT_NEGATIVE, "a length >= 0")]  # of a robot's leg
Samples = Annotated[int, checked_whole(2, 1_000_000)]
