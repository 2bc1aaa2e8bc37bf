"""The constraint kinds by key: the file's block, its checks, starters and what is written follow from these lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from nhpocp.constraints.bound import Bound
from nhpocp.constraints.kind import ConstraintKind
from nhpocp.constraints.written import as_written, in_degrees
from nhpocp.errors import InvalidProblemError, refuse
from nhpocp.family import Family, Group
from nhpocp.systems.system import System

KINDS: Family[ConstraintKind] = Family(
    {
        "leg_length": "nhpocp.constraints.leg_length:LegLength",
        "leg_speed": "nhpocp.constraints.leg_speed:LegSpeed",
        "leg_acceleration": "nhpocp.constraints.leg_acceleration:LegAcceleration",
        "joint_angle": "nhpocp.constraints.joint_angle:JointAngle",
        "distance": "nhpocp.constraints.distance:Distance",
        "control": "nhpocp.constraints.control:ControlSize",
        "clearance": "nhpocp.constraints.clearance:Clearance",
        "state": "nhpocp.constraints.state:StateBox",
    },
    made=lambda cls: cls(),
    group=Group(
        "nhpocp.constraints", "nhpocp.constraints.kind:ConstraintKind", "key", "a constraint", ("given",)
    ),
)


def bounds_of(given: Mapping[str, Any], system: System) -> list[Bound]:
    """What the values of a `constraints` block ask for, by its keys.

    Errors: `InvalidProblemError` for what cannot be asked of the system, with the `others`.
    """
    wrong: list[InvalidProblemError] = []
    bounds: list[Bound] = []
    for key, value in given.items():
        path = f"constraints.{key}"
        if key not in KINDS:
            wrong.append(InvalidProblemError("unknown key", path=path, word=str(key), known=KINDS))
            continue
        try:
            bounds += _asked(KINDS[key], value, system)
        except InvalidProblemError as error:
            wrong += [each.under(path) for each in (error, *error.others)]
    refuse(wrong)
    return bounds


def _asked(kind: ConstraintKind, value: Any, system: System) -> list[Bound]:
    """What the value of one kind asks for. Errors: as `bounds_of`, their paths inside the value."""
    if words := kind.lacking(system):
        raise InvalidProblemError(words, at_key=True)
    kind.refuse_unknown(value)
    value = as_written(value, kind.shape, kind.side)
    if words := kind.misfit(value, system):
        raise InvalidProblemError(words)
    return [_as_said(bound, value) for bound in kind.bounds(value, system)]


def _as_said(bound: Bound, value: Any) -> Bound:
    """A bound that is told in degrees if its part of a kind's value was written so."""
    return replace(bound, degrees=True) if in_degrees(part_of(value, bound.label)) else bound


def part_of(value: Any, label: str) -> Any:
    """What of a kind's value a bound with this label stands for."""
    return value.get(label.partition(".")[2], value) if isinstance(value, dict) else value


def block_of(bounds: Sequence[Bound], system: System) -> dict[str, Any]:
    """The block that asks for these bounds. Errors: `InvalidProblemError` for those that a file has no word for."""
    own: dict[str, list[Bound]] = {}
    for bound in bounds:
        key = bound.label.partition(".")[0]
        if key not in KINDS:
            raise InvalidProblemError(
                f"a problem file has no word for the bound {bound.label!r}; expected one of {', '.join(KINDS)}, or "
                "such a word, a dot and a name",
                path="constraints",
            )
        own.setdefault(key, []).append(bound)
    return {key: _value_of(KINDS[key], bounds, system) for key, bounds in own.items()}


def _value_of(kind: ConstraintKind, bounds: Sequence[Bound], system: System) -> Any:
    """The value of a key, which asks for these bounds and for nothing else."""
    with suppress(
        InvalidProblemError, LookupError, TypeError, ValueError
    ):  # for what it has no word, it trips over
        value = kind.value(bounds, system)
        if _same(_asked(kind, value, system), bounds):
            return value
    words = f"a problem file has no word for {' and '.join(map(repr, bounds))} under `{kind.key}`"
    raise InvalidProblemError(f"{words}; write bounds as that key makes them", path="constraints")


def _same(some: Sequence[Bound], others: Sequence[Bound]) -> bool:
    """Whether bounds ask for the same, in whatever order, of all components at once or of each."""
    key = attrgetter("label", "quantity")
    return len(some) == len(others) and all(
        key(one) == key(other) and _equal(one.lower, other.lower) and _equal(one.upper, other.upper)
        for one, other in zip(sorted(some, key=key), sorted(others, key=key), strict=True)
    )


def _equal(side: Any, other: Any) -> bool:
    mine, its = np.broadcast_arrays(np.asarray(side, dtype=float), np.asarray(other, dtype=float))
    return np.array_equal(mine, its)
