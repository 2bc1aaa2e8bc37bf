"""The effort of the legs."""

from __future__ import annotations

from nhpocp.arrays import Array, dot
from nhpocp.objectives.objective import PathObjective
from nhpocp.objectives.quantity import quantity
from nhpocp.scales import Scales
from nhpocp.systems.system import System


class LegEffort(PathObjective):
    """∫ |u|² dt of the leg speeds u [length²/time]."""

    name = "leg_effort"
    symbol = "∫|u|² dt"
    formula = "∫|u|²"
    meaning = "∫|u|² dt"
    pace = -1

    def scale(self, scales: Scales) -> float:
        return scales.length * scales.length / scales.time

    def lacking(self, system: System) -> str:
        return "" if hasattr(system, "legs") else f"the system {system.model} has no legs, so no leg speeds"

    def integrand(self, system: System, state: Array, control: Array, length_scale: float) -> Array:
        speeds = quantity(system, "u", state, control)
        return dot(speeds, speeds)
