"""Boxes in the state and the outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind, pair_of, sides
from nhpocp.systems.system import System


class StateBox(ConstraintKind):
    """lo ≤ x ≤ hi, componentwise, for blocks of the state and outputs by name."""

    key = "state"
    meaning = "[lo, hi], or [[lo, …], [hi, …]], by the name of a state block or an output"
    shape = "pairs by name"

    def shown(self, system: System, start: Mapping[str, Any]) -> Any:
        for block in system.state_space.blocks:
            if block.kind != "rotation":
                value = start[block.name]
                numbers = value if isinstance(value, list) else [value]
                if all(isinstance(number, int | float) for number in numbers):  # and not "30 deg"
                    below, above = (3, 3) if block.unit == "angle" else (50, 100)
                    return {block.name: [min(numbers) - below, min(numbers) + above]}
        return None

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(f"{self.key}.{name}", name, *sides(pair)) for name, pair in value.items()]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return {bound.label.partition(".")[2]: pair_of(bound) for bound in bounds}
