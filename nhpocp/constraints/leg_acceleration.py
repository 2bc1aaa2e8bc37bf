"""Accelerations of the legs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import LegKind, symmetric
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis


class LegAcceleration(LegKind):
    """|u̇_i| ≤ c [length/time²], for every leg; of controls that do not jump."""

    key = "leg_acceleration"
    meaning = "greatest |du_i/dt|; of controls that do not jump"
    shape = "number"
    example = 2000

    def bounds(self, value: Any, system: System) -> list[Bound]:
        return [Bound(self.key, LEG_ACCELERATIONS, -value, value)]

    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        return symmetric(bounds[-1])


def lacking_derivative(bounds: Sequence[Bound], basis: ControlBasis) -> str:
    """The bound that asks for a derivative which controls over a basis lack, in words; empty where none does."""
    from nhpocp.controls.jumps import may_jump

    labels = [bound.label for bound in bounds if bound.quantity == LEG_ACCELERATIONS]
    if not labels or not may_jump(basis):
        return ""
    return f"{labels[0]} asks for a derivative, and {basis.kind} controls jump"
