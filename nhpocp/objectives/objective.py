"""The contract of an objective: what a motion over [0, T] costs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from nhpocp.arrays import Array
from nhpocp.scales import Scales
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis
    from nhpocp.controls.control import Control
    from nhpocp.controls.table import Gram


class Objective(ABC):
    """A cost of motions, ≥ 0. Derive from one of the two kinds below, of the control alone or along the path.

    symbol: the cost as mathematics, ``{control}`` standing for the input. formula: of the file's schema, as "∫|u|²".
    meaning: of a reference value. pace: the power of T by which the cost of one path grows when all of it is
    run evenly slower. digits: that reports show. softenings: speeds below which searches take the cost for something
    smooth, one after another, as fractions of its scale over the duration; 0 where it is smooth itself.
    """

    name: ClassVar[str]
    symbol: ClassVar[str]
    formula: ClassVar[str] = ""
    meaning: ClassVar[str] = ""
    pace: ClassVar[int]
    digits: ClassVar[int] = 6
    softenings: ClassVar[tuple[float, ...]] = (0.0,)
    # whether motions of one duration differ in it: only then it is stored, and searched for at a fixed horizon
    of_motion: ClassVar[bool] = True

    @abstractmethod
    def scale(self, scales: Scales) -> float:
        """What counts as 1 in it, > 0, in the problem's own units."""

    def lacking(self, system: System) -> str:
        """What a system lacks that has no such cost, in words; empty where it has it."""
        return ""

    def lacking_control(self, basis: ControlBasis) -> str:
        """What controls over a basis lack that have no such cost, in words; empty where they have it."""
        return ""

    def of_control(self, control: Control) -> float | None:
        """The cost, where the control alone tells it exactly and has it; else None."""
        return None


class ControlObjective(Objective):
    """∫ |D u|² dt with a linear D: Σ λᵀ M λ over the rows λ of Λ, exactly and without a path."""

    @abstractmethod
    def gram(self, basis: ControlBasis, horizon: float) -> Gram | Array:
        """M, size × size; T^(pace + 2) times that of T = 1."""

    @abstractmethod
    def density(self, control: Control, times: Array) -> Array:
        """|D u|² at times inside the control's smooth pieces, (k,) → (k,); not by `gram`."""

    def of_control(self, control: Control) -> float | None:
        if self.lacking_control(control.basis):
            return None
        image = self.gram(control.basis, control.horizon) @ control.coefficients.T
        return float((control.coefficients.T * image).sum())


class PathObjective(Objective):
    """∫ c(x, u) dt along the path."""

    @abstractmethod
    def integrand(self, system: System, state: Array, control: Array, length_scale: float) -> Array:
        """c(x, u), for numbers and symbols; angles count by ``length_scale``."""

    def searched(
        self, system: System, state: Array, control: Array, length_scale: float, rest: Array
    ) -> Array:
        """What a solver differentiates for c, smooth everywhere; ``rest``: the speed of a softening, in units of c."""
        return self.integrand(system, state, control, length_scale)
