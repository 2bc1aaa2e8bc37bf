"""The duration, where a solver may choose it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nhpocp.objectives.objective import Objective
from nhpocp.scales import Scales

if TYPE_CHECKING:
    from nhpocp.controls.control import Control


class Duration(Objective):
    """T [time]."""

    name = "time"
    symbol = "duration T"
    pace = 1
    of_motion = False

    def scale(self, scales: Scales) -> float:
        return scales.time

    def of_control(self, control: Control) -> float:
        return control.horizon
