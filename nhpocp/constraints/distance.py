"""Distances of bodies from obstacles and from each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nhpocp.bodies.surroundings import alone
from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind, opened
from nhpocp.systems.system import DISTANCE, System


class Distance(ConstraintKind):
    """d ≥ c [length] of every body that moves from every obstacle, and of bodies that do not touch by construction."""

    key = "distance"
    meaning = "least distance from obstacles, and between bodies that do not touch by construction"
    shape = "number"
    example = 0.01
    side = "min"

    def lacking(self, system: System) -> str:
        if not system.has_bodies:
            return f"the system {system.model} has no bodies; remove it"
        pairs = system.among(()).surroundings if system.surroundings is None else system.surroundings
        return "" if pairs is not None and pairs.pairs else alone(system.model)

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(self.key, DISTANCE, value)]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return opened(bounds[-1].lower)
