"""A parameter of a system as a user writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError, describe
from nhpocp.state_space import UNIT_WORDS, Unit


@dataclass(frozen=True)
class Parameter:
    """A parameter of a system as a user writes it: what kind of value, its default, what it means.

    kind: "number", "positive", "integer", "numbers", "vector" (3,), "flag", "choice", … default: its value where none
    is given; ... where one has to be. meaning: a few words, without the unit. choices: of a "choice". unit: "length",
    "angle" [rad], or "" for none. replaces: names of parameters that it stands for. keys: the parameters of each of
    several mappings, such as legs. of_motion: whether the equations know it; False for sizes of bodies. Raises nothing;
    `checked(name, value)` raises `InvalidProblemError` for a value that is none.
    """

    kind: Literal[
        "number",
        "positive",
        "integer",
        "numbers",
        "vector",
        "length",
        "flag",
        "choice",
        "legs",
        "jointed legs",
    ]
    default: Any  # ... where a value has to be given
    meaning: str
    choices: tuple[str, ...] = ()
    unit: Unit = ""
    replaces: tuple[str, ...] = ()  # parameters that it stands for: never given beside it
    keys: Mapping[str, Parameter] | None = None  # of each of several mappings, such as legs
    of_motion: bool = True

    @property
    def described(self) -> str:
        """The meaning with its unit."""
        return f"{self.meaning} {UNIT_WORDS[self.unit]}".rstrip()

    def checked(self, name: str, value: Any) -> Any:
        """A value for this parameter as plain data. Errors: `InvalidProblemError` naming what came."""
        if self.kind == "choice":
            if value not in self.choices:
                raise InvalidProblemError(
                    f"{value!r} is none of {', '.join(self.choices)}", path=f"system.{name}"
                )
            return value
        path = f"system.{name}"
        if self.kind == "flag":
            if value not in (True, False):
                raise InvalidProblemError(f"expected True or False, got {describe(value)}", path=path)
            return bool(value)
        if self.kind in ("numbers", "vector"):
            entries = value.tolist() if hasattr(value, "tolist") else value
            if not isinstance(entries, list | tuple) or (self.kind == "vector" and len(entries) != 3):
                wanted = "3 numbers" if self.kind == "vector" else "a list of numbers"
                raise InvalidProblemError(f"expected {wanted}, got {describe(value)}", path=path)
            return tuple(real(entry, path) for entry in entries)
        number = real(value, path)
        if self.kind == "positive" and not number > 0:
            raise InvalidProblemError(f"{number:g}; expected a number > 0", path=f"system.{name}")
        if self.kind != "integer":
            return number
        if number != int(number):
            raise InvalidProblemError(f"{number:g}; expected a whole number", path=f"system.{name}")
        return int(number)
