"""Speeds of the legs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import LegKind, symmetric
from nhpocp.systems.system import System


class LegSpeed(LegKind):
    """|u_i| ≤ c [length/time], for every leg."""

    key = "leg_speed"
    meaning = "greatest |u_i|"
    shape = "number"
    example = 200

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(self.key, "u", -value, value)]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return symmetric(bounds[-1])
