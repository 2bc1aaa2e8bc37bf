"""The distance from singularities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind, opened
from nhpocp.systems.system import System


class Clearance(ConstraintKind):
    """σ_min ≥ c of every regularity matrix, its rotation columns divided by length_scale."""

    key = "clearance"
    meaning = "least singular value of S and W, rotation columns divided by length_scale"
    shape = "number"
    example = 0.01
    side = "min"

    def lacking(self, system: System) -> str:
        regular = type(system).regularity is System.regularity
        words = f"the system {system.model} has no legs, or what else becomes singular; remove it"
        return words if regular else ""

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(f"{self.key}.sigma_{name}", f"sigma_{name}", value) for name in _matrices(system)]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return opened(bounds[-1].lower)


def _matrices(system: System) -> list[str]:
    """Names of the regularity matrices."""
    with np.errstate(all="ignore"):
        return list(system.regularity(system.somewhere))
