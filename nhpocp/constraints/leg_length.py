"""Lengths of the legs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import LegKind, pair_of, sides
from nhpocp.systems.system import System


class LegLength(LegKind):
    """lo ≤ l_i ≤ hi [length], for every leg."""

    key = "leg_length"
    meaning = "[shortest, longest] leg"
    shape = "pair"
    example = (5, 100)

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(self.key, "leg_lengths", *sides(value))]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return pair_of(bounds[-1])
