"""The effort."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nhpocp.arrays import Array
from nhpocp.objectives.objective import ControlObjective
from nhpocp.scales import Scales

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis
    from nhpocp.controls.control import Control
    from nhpocp.controls.table import Gram


class Effort(ControlObjective):
    """∫ |control|² dt: of v for the feedback-transformed robot, [Paper] eq. (7)."""

    name = "effort"
    symbol = "∫|{control}|² dt"
    formula = "∫|control|²"
    meaning = "∫|control|² dt"
    pace = -1

    def scale(self, scales: Scales) -> float:
        largest = float(max(scales.inputs, default=0.0))
        return float(scales.time) * largest * largest or 1.0  # no power: floats overflow to ∞ in silence

    def gram(self, basis: ControlBasis, horizon: float) -> Gram | Array:
        return basis.gram(horizon)

    def density(self, control: Control, times: Array) -> Array:
        return (control(times) ** 2).sum(axis=1)
