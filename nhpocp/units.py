"""What a problem's lengths and times are counted in: words for labels and tables; nothing is converted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from nhpocp.constructed import Constructed
from nhpocp.errors import InvalidProblemError, describe, expect
from nhpocp.state_space import Unit

LONGEST = 12  # characters
WANTED = "expected a unit's name, such as m or s: letters, digits, µ, °, %, /, · or ^"


def unit_name(value: Any) -> str:
    """A unit as it stands in labels. Errors: `InvalidProblemError` for what is none."""
    if not isinstance(value, str):
        raise InvalidProblemError(f"expected a text such as m, got {describe(value)}")
    if len(value) > LONGEST or not re.fullmatch(r"[^\W_][\w%°µ/·^]*|[°%]\w*", value):
        raise InvalidProblemError(f"{describe(value)}; {WANTED}")
    return value


@dataclass(frozen=True)
class Units(Constructed):
    """The words for a problem's units; nothing is converted by them.

    length: "m" or "mm", say; time: "s", say; None where nobody says: labels then call them length and unit time. Angles
    are in [rad]. A problem takes a mapping too, as a file does: {"length": "m", "time": "s"}.
    Errors: `InvalidProblemError` for what is no name of a unit.
    """

    length: str | None = None
    time: str | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            try:
                if value is not None:
                    unit_name(value)
            except InvalidProblemError as error:
                raise error.under(f"units.{field.name}") from None

    @classmethod
    def of(cls, given: Any) -> Units:
        """Units as Python or a file writes them."""
        if isinstance(given, Units):
            return given
        expect(given, Mapping, "a mapping such as {'length': 'm', 'time': 's'}", "units")
        known = [field.name for field in fields(cls)]
        for name in given:
            if name not in known:
                raise InvalidProblemError("unknown key", path=f"units.{name}", word=str(name), known=known)
        return cls(**given)

    def stated(self) -> dict[str, str]:
        """Those that somebody said."""
        known = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: words for name, words in known.items() if words is not None}

    def words(self, unit: Unit, rate: int = 0) -> str:
        """A unit as axes name it, "m/s" or "length per unit time"; "" for a number that has none.

        rate: the power of time that divides it.
        """
        words = {"length": self.length or "length", "angle": "rad", "": ""}[unit]
        if not rate or not words:
            return words
        square = {1: "", 2: "²"}[int(rate)]
        return f"{words}/{self.time}{square}" if self.time else f"{words} per unit time{square}"
