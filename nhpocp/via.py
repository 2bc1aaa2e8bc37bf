"""What a motion has to meet on its way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.declared import real
from nhpocp.errors import expect
from nhpocp.frozen import ByValue


@dataclass(frozen=True, eq=False)
class Via(ByValue, Constructed):
    """A pose to pass on the way.

    share: when, as a fraction of the horizon between 0 and 1. goal: what to meet then, written like a problem's goal,
    "position" (3,) [length] say.
    A problem takes a file's {"at": 0.5, "position": [0, 0, 30]} too.
    Errors: `InvalidProblemError`, by the problem, for a share or a pose that is none.
    """

    share: float
    goal: Mapping[str, Array]

    @classmethod
    def of(cls, given: Any, path: str) -> Via:
        """A via pose as Python or a file writes it."""
        if isinstance(given, Mapping) and "at" in given:
            given = cls(given["at"], {name: value for name, value in given.items() if name != "at"})
        expect(given, Via, "Via(0.5, {…}) or {'at': 0.5, …}", path)
        return cls(real(given.share, f"{path}.at", "a share between 0 and 1"), given.goal)
