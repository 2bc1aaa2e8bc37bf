"""What the growth of brackets says of controllability, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from nhpocp.analysis.growth import Filtration

Kind = Literal["controllable", "strongly accessible", "accessible", "not controllable", "undecided"]


@dataclass(frozen=True)
class Controllability:
    """A verdict, the sentence that says why, and where the rank condition was not found to hold."""

    kind: Kind
    sentence: str
    failing: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {"verdict": self.kind, "sentence": self.sentence, "larc_fails_at": list(self.failing)}


def verdict(found: Filtration, names: Sequence[str], tolerance: float) -> Controllability:
    """The verdict on points of these names. Sources: `growth`."""
    failing = tuple(name for name, growth in zip(names, found.points, strict=True) if not growth.full)
    dimension = found.generic.dimension
    where = f"at each of the {len(names)} states looked at (relative tolerance {tolerance:g})"
    if not failing:
        return _holds(found, where)
    if found.settled and found.generic.spectra and not found.generic.full:
        leaf = f"{found.generic.rank}-dimensional sets in {dimension} dimensions"
        return Controllability(
            "not controllable",
            f"No bracket leads further: motions stay on {leaf} (relative tolerance {tolerance:g}).",
            failing,
        )
    missing = [name for name, one in zip(names, found.points, strict=True) if not one.spectra]
    if missing:
        sentence = f"The fields are not finite at {_some(missing)}; the rank condition cannot be tried there."
        return Controllability("undecided", sentence, failing)
    more = f"; {found.refused} would be too large" if found.refused else ""
    return Controllability(
        "undecided",
        f"The Lie algebra rank condition was not found to hold at {_some(failing)} "
        f"with brackets up to degree {found.limit}{more}.",
        failing,
    )


def _holds(found: Filtration, where: str) -> Controllability:
    condition = f"The Lie algebra rank condition holds {where}"
    if not found.drifting:
        return Controllability(
            "controllable", f"{condition}: small-time locally controllable there (Chow and Rashevskii)."
        )
    dimension = found.generic.dimension
    strong = min(growth.strong for growth in found.points)
    if strong == dimension:
        return Controllability(
            "strongly accessible",
            f"{condition}, without the drift itself too: what can be reached at one given time has inner points. "
            "With drift that does not yet mean controllable.",
        )
    return Controllability(
        "accessible",
        f"{condition}, but only with the drift itself: what can be reached at one given time has dimension {strong} "
        f"of {dimension}. That does not mean controllable.",
    )


def _some(names: Sequence[str], most: int = 3) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"
