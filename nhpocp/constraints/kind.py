"""The contract of a constraint kind: one key of a problem file's `constraints`, and the bounds that it stands for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from nhpocp.constraints.bound import Bound
from nhpocp.errors import InvalidProblemError, refuse
from nhpocp.systems.system import System

# what may stand behind the key: a number ≥ 0; [lo, hi], null for an open side; a number or one pair per input;
# pairs, or lists of both sides, by name
Shape = Literal["number", "pair", "number or pairs", "pairs by name"]
Side = Literal["min", "max"]


class ConstraintKind(ABC):
    """A key, what it means, and how its value becomes bounds and is made of them again.

    Labels of its bounds are the key, or begin with it and a dot. names: those that pairs by name may have, where they
    are the same for every system. example: what `nhpocp init` shows. side: the one that a single number is, which
    {max: …} or {min: …} says as well.
    """

    key: ClassVar[str]
    meaning: ClassVar[str]
    shape: ClassVar[Shape]
    names: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[Any] = None
    side: ClassVar[Side] = "max"

    def lacking(self, system: System) -> str:
        """What a system lacks for which the key makes no sense, in words; empty where it does."""
        return ""

    def refuse_unknown(self, value: Any) -> None:
        """Errors: `InvalidProblemError` for every name in a value of whatever shape that is none of the ``names``."""
        given = value if self.names and isinstance(value, Mapping) else {}
        unknown = [str(name) for name in given if name not in self.names]
        refuse(
            [InvalidProblemError("unknown key", path=name, word=name, known=self.names) for name in unknown]
        )

    def misfit(self, value: Any, system: System) -> str:
        """What is wrong with a value of the right shape for a system; empty where nothing is."""
        return ""

    def shown(self, system: System, start: Mapping[str, Any]) -> Any:
        """An example for a system and a start as a file writes it; None for none."""
        return None if self.lacking(system) else self.example

    @abstractmethod
    def bounds(self, value: Any, system: System) -> list[Bound]:
        """What a value asks for."""

    @abstractmethod
    def value(self, bounds: Sequence[Bound], system: System) -> Any:
        """The value that asks for these bounds. Errors: `InvalidProblemError` where the key has no word for them."""


class LegKind(ConstraintKind):
    """A kind for machines with legs."""

    def lacking(self, system: System) -> str:
        known = system.known_outputs
        legless = known is not None and "leg_lengths" not in known
        return f"the system {system.model} has no legs; remove it" if legless else ""


def sides(pair: Sequence[Any]) -> tuple[Any, Any]:
    """Lower and upper bounds; an open side is infinite."""

    def closed(value: Any, infinite: float) -> Any:
        if isinstance(value, list):
            return [closed(x, infinite) for x in value]
        return infinite if value is None else value

    return closed(pair[0], -np.inf), closed(pair[1], np.inf)


def opened(side: Any) -> Any:
    """A side of a bound as plain data: null where it is infinite."""
    values = np.asarray(side, dtype=float)
    if values.ndim:
        return [opened(value) for value in values]
    return float(values) if np.isfinite(values) else None


def pair_of(bound: Bound) -> list[Any]:
    """[lo, hi], both lists as soon as one is."""
    low, high = opened(bound.lower), opened(bound.upper)
    if isinstance(low, list) != isinstance(high, list):
        length = len(low if isinstance(low, list) else high)
        return [side if isinstance(side, list) else [side] * length for side in (low, high)]
    return [low, high]


def symmetric(bound: Bound) -> float:
    """c of a bound -c … c."""
    low, high = opened(bound.lower), opened(bound.upper)
    if isinstance(low, list) or isinstance(high, list) or low is None or high is None or low != -high:
        raise InvalidProblemError(
            f"the bound {bound.label!r} is not -c … c; a problem file has no word for it", path="constraints"
        )
    return float(high)
