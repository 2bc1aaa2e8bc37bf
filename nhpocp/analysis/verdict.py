"""What the growth of brackets says of controllability, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from nhpocp.analysis.growth import Filtration
from nhpocp.problem import PlanningProblem
from nhpocp.systems.system import System

# operations that join pieces of functions, at which brackets say nothing of what lies beyond
PIECES = {
    getattr(ca, f"OP_{name}"): word
    for name, word in {
        "FABS": "|·|",
        "SIGN": "sign",
        "FMIN": "min",
        "FMAX": "max",
        "FLOOR": "floor",
        "CEIL": "ceil",
        "FMOD": "remainder",
        "COPYSIGN": "copysign",
        "IF_ELSE_ZERO": "if",
    }.items()
}

Kind = Literal["controllable", "strongly accessible", "accessible", "not controllable", "undecided"]


@dataclass(frozen=True)
class Controllability:
    """A verdict, the sentence that says why, and where the rank condition was not found to hold."""

    kind: Kind
    sentence: str
    failing: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {"verdict": self.kind, "sentence": self.sentence, "larc_fails_at": list(self.failing)}


@dataclass(frozen=True)
class Reserve:
    """What the brackets do not know of a problem, and the verdict hence does not cover."""

    pieces: tuple[str, ...] = ()  # of which the fields are joined: words of `PIECES`
    one_way: tuple[str, ...] = ()  # inputs whose bounds do not let them change their sign
    held: tuple[str, ...] = ()  # inputs whose bounds leave them one value

    @classmethod
    def of(cls, problem: PlanningProblem) -> Reserve:
        one_way, held = [], []
        for bound in problem.bounds:
            blocks = [b for b in problem.system.input_space.blocks if b.name == bound.quantity]
            for index in np.ndindex(*blocks[0].shape) if blocks else ():
                low, high = bound.limits(tuple(index))
                label = bound.quantity + "".join(f"[{i}]" for i in index)
                if not low < high:
                    held.append(label)
                elif not low < 0 < high:
                    one_way.append(label)
        return cls(pieces_of(problem.system), tuple(one_way), tuple(held))

    def qualified(self, said: Controllability) -> Controllability:
        """A verdict with its limits, and no more than they allow."""
        kind, words = said.kind, [said.sentence]
        if self.pieces:
            words.append(
                f"The fields are joined of pieces ({', '.join(self.pieces)}), which need not be analytic: this holds "
                "on the piece of each state, and says nothing of what lies beyond its edge."
            )
            kind = "undecided" if kind == "not controllable" else kind
        if self.held:
            words.append(
                f"The bounds hold {', '.join(self.held)} at one value, which the brackets do not know."
            )
            kind = "undecided"
        elif self.one_way:
            words.append(
                f"The bounds on {', '.join(self.one_way)} exclude going back, which Chow's theorem needs: what can be "
                "reached has inner points, and no more is said."
            )
            kind = "accessible" if kind == "controllable" else kind
        return Controllability(kind, " ".join(words), said.failing)


def pieces_of(system: System) -> tuple[str, ...]:
    """The operations in a system's equations that are not analytic everywhere."""
    x = ca.SX.sym("x", system.state_space.size)
    fields = [ca.SX(system.vector_fields(x))] + ([] if system.driftless else [ca.SX(system.drift(x))])
    function = ca.Function("fields", [x], fields)
    used = {function.instruction_id(k) for k in range(function.n_instructions())}
    return tuple(word for operation, word in PIECES.items() if operation in used)


def verdict(
    filtration: Filtration, names: Sequence[str], tolerance: float, reserve: Reserve | None = None
) -> Controllability:
    """The verdict on points of these names, with its reserve. Sources: `growth`."""
    said = _verdict(filtration, names, tolerance)
    return reserve.qualified(said) if reserve else said


def _verdict(filtration: Filtration, names: Sequence[str], tolerance: float) -> Controllability:
    failing = tuple(name for name, growth in zip(names, filtration.points, strict=True) if not growth.full)
    generic = filtration.generic
    dimension = generic.dimension
    where = f"at each of the {len(names)} states looked at (relative tolerance {tolerance:g})"
    if not failing:
        return _holds(filtration, where)
    if filtration.settled and generic.spectra and not generic.full and generic.doubtful:
        gap = generic.spectra[-1]
        return Controllability(
            "undecided",
            f"The brackets seem to span {generic.rank} of {dimension} dimensions, but not by a clear margin: "
            f"σ/σ₁ falls to {gap.least_kept:.2g}, then {gap.largest_dropped:.2g} (relative tolerance {tolerance:g}).",
            failing,
        )
    if filtration.settled and generic.spectra and not generic.full:
        leaf = f"{generic.rank}-dimensional sets in {dimension} dimensions"
        return Controllability(
            "not controllable",
            f"No bracket leads further: motions stay on {leaf} (relative tolerance {tolerance:g}).",
            failing,
        )
    missing = [name for name, one in zip(names, filtration.points, strict=True) if not one.spectra]
    if missing:
        sentence = f"The fields are not finite at {_some(missing)}; the rank condition cannot be tried there."
        return Controllability("undecided", sentence, failing)
    more = f"; {filtration.refused} would be too large" if filtration.refused else ""
    return Controllability(
        "undecided",
        f"The Lie algebra rank condition was not found to hold at {_some(failing)} "
        f"with brackets up to degree {filtration.limit}{more}.",
        failing,
    )


def _holds(filtration: Filtration, where: str) -> Controllability:
    condition = f"The Lie algebra rank condition holds {where}"
    if not filtration.drifting:
        return Controllability(
            "controllable", f"{condition}: small-time locally controllable there (Chow and Rashevskii)."
        )
    dimension = filtration.generic.dimension
    strong = min(growth.strong for growth in filtration.points)
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
