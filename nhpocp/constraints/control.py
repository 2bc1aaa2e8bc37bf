"""The size of the control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind, opened, sides
from nhpocp.systems.system import System


class ControlSize(ConstraintKind):
    """|v_i| ≤ c, or lo ≤ v_i ≤ hi input by input: one bound for each block of inputs."""

    key = "control"
    meaning = "greatest |control|, or one [lo, hi] per input"
    shape = "number or pairs"
    example = 10

    def misfit(self, value: Any, system: System) -> str:
        inputs = system.input_space.labels
        if not isinstance(value, list) or len(value) == len(inputs):
            return ""
        return f"{len(value)} pairs; expected {len(inputs)}, one [lo, hi] per input ({', '.join(inputs)})"

    def bounds(self, value: Any, system: System) -> list[Bound]:
        blocks, bounds, first = system.input_space.blocks, [], 0
        for block in blocks:
            label = self.key if len(blocks) == 1 else f"{self.key}.{block.name}"
            if isinstance(value, list):
                pairs = value[first : first + block.size]
                columns = [[pair[side] for pair in pairs] for side in (0, 1)]
                low, high = sides(columns if block.kind == "vector" else [column[0] for column in columns])
            else:
                low, high = -value, value
            bounds.append(Bound(label, block.name, low, high))
            first += block.size
        return bounds

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return [pair for bound in bounds for pair in self._pairs(bound, system)]

    def _pairs(self, bound: Bound, system: System) -> list[list[Any]]:
        block = next(block for block in system.input_space.blocks if block.name == bound.quantity)
        low, high = (
            side if isinstance(side, list) else [side] * block.size
            for side in (opened(bound.lower), opened(bound.upper))
        )
        return [list(pair) for pair in zip(low, high, strict=True)]
