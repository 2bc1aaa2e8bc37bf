"""Angles of the legs' joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind, opened, sides
from nhpocp.systems.system import System

NAMES = ("theta1", "theta2", "theta3", "theta4")
CONE = "cone"


class JointAngle(ConstraintKind):
    """lo ≤ θ_j ≤ hi [rad] in every leg: θ1 and θ2 of the rolling joint, θ3 and θ4 of the universal joint.

    cone: of the rolling joint, the angle between the leg and its direction at the start.
    """

    key = "joint_angle"
    meaning = "[lo, hi] of each leg's theta1, theta2, cone (base), theta3, theta4 (platform); 80 deg is a number, too"
    shape = "pairs by name"
    names = (*NAMES, CONE)
    example: ClassVar[Any] = {"theta4": (-1.5, 1.5)}

    def lacking(self, system: System) -> str:
        known = "joint_angles" in (system.known_outputs or ())
        return "" if known else f"the system {system.model} has no joint angles; remove it"

    def misfit(self, value: Any, system: System) -> str:
        lists = [name for name, pair in value.items() if any(isinstance(side, list) for side in pair)]
        return f"lists of bounds for {lists[0]}; expected [lo, hi], for every leg" if lists else ""

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [self._bound(name, *sides(pair)) for name, pair in value.items()]

    def _bound(self, name: str, low: float, high: float) -> Bound:
        if name == CONE:
            return Bound(f"{self.key}.{name}", "joint_cones", low, high)
        lower, upper = np.full(len(NAMES), -np.inf), np.full(len(NAMES), np.inf)
        place = NAMES.index(name)
        lower[place], upper[place] = low, high
        return Bound(f"{self.key}.{name}", "joint_angles", lower, upper)

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        named = {bound.label.partition(".")[2]: bound for bound in bounds}
        return {
            name: [
                opened(side) if name == CONE else opened(side)[NAMES.index(name)]
                for side in (bound.lower, bound.upper)
            ]
            for name, bound in named.items()
        }
