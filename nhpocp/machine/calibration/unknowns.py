"""What of a robot may be fitted, by name: parameters of all its legs, or of each, and the places of its joints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import cos, hypot, sin
from typing import Any

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.calibration.measurements import motors_of
from nhpocp.state_space import Unit
from nhpocp.systems.legs import DIRECTIONS, FIELDS
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.system import System

PATH = "--fit"
OFFSET = "leg_offset"
PLACES = ("base", "platform")
TURNS = ("up", "side")  # of a direction: towards the third axis, and at a right angle to that
EACH = "each"


@dataclass(frozen=True)
class Unknown:
    """One number. name: such as base_radius, roller_tilt[2], base[1].x. leg: from 0, None for all alike.

    kind: what it is of. part: which number of that, where it is one of several. value: as the model has it [unit].
    """

    name: str
    kind: str
    leg: int | None
    part: int
    unit: Unit
    value: float


@dataclass(frozen=True)
class Unknowns:
    """Those that are fitted, in order. system: the model, as the problem has it."""

    system: ParallelRobot
    every: tuple[Unknown, ...]
    asked: tuple[str, ...] = field(default=())

    @classmethod
    def parsed(cls, text: str | Sequence[str] | None, system: System) -> Unknowns:
        """From "base_radius,roller_tilt[each],base[1].x"; None: the shape of the robot, or all its joints.

        NAME stands for all legs alike where it is a parameter, else for every leg's; NAME[2] for leg 2, from 1,
        NAME[each] for each of them. Errors: `InvalidProblemError` for a name that is none, is given twice, or for
        another system than a robot on legs.
        """
        if not isinstance(system, ParallelRobot) or "legs" not in system.declared:
            words = (
                f"{system.model} cannot be calibrated; expected a robot on legs: three_upu, parallel_robot"
            )
            raise InvalidProblemError(words, path="system.model")
        known = {unknown.name: unknown for unknown in _known(system)}
        if text is None:
            asked = list(system.shape) or [name for name in ("base", "platform", "r") if _chosen(name, known)]
        else:
            asked = [part.strip() for part in (text.split(",") if isinstance(text, str) else text)]
        if not [name for name in asked if name]:
            raise InvalidProblemError("nothing to fit; expected names such as base_radius", path=PATH)
        chosen: dict[str, Unknown] = {}
        for name in asked:
            new = _chosen(name, known)
            if not new:
                words = f"{name!r} is nothing of {system.model} that can be fitted"
                names = dict.fromkeys([*known, *(re.split(r"[\[.]", each)[0] for each in known)])
                raise InvalidProblemError(words, path=PATH, word=_meant(name, names), known=names)
            if twice := [each for each in new if each in chosen]:
                raise InvalidProblemError(f"{twice[0]} is given twice", path=PATH)
            chosen |= new
        made = cls(system, tuple(each for name, each in known.items() if name in chosen), tuple(asked))
        made._check_apart()
        return made

    def _check_apart(self) -> None:
        """Errors: `InvalidProblemError` for two unknowns that say the same."""
        shape = {"base_radius": "base", "platform_radius": "platform", "roller_tilt": "r"}
        for each in self.every:
            for other in self.every:
                same = each.leg is None or other.leg is None or each.leg == other.leg
                alike = each.kind == other.kind and (each.leg is None) != (other.leg is None)
                if same and (alike or shape.get(each.kind) == other.kind):
                    raise InvalidProblemError(f"{other.name} says what {each.name} says; fit one", path=PATH)

    # --- as arrays ---

    def __len__(self) -> int:
        return len(self.every)

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.every]

    @property
    def start(self) -> Array:
        """The model's values, (n,)."""
        return np.array([each.value for each in self.every], dtype=float)

    @property
    def scales(self) -> Array:
        """What counts as large: the mean length of the platform's arms, one radian, (n,)."""
        length = self.system.default_length_scale()
        return np.array([length if each.unit == "length" else 1.0 for each in self.every])

    # --- what they make of the robot ---

    def vectors(self, values: Array) -> list[dict[str, tuple[Array, Array, Array]]]:
        """The vectors of each leg that depend on the values (n,), numbers or symbols."""
        xp, given = (
            namespace(values),
            dict(zip(self.every, [values[i] for i in range(len(self))], strict=True)),
        )
        shape = self._model()
        legs = []
        for number, leg in enumerate(self.system.legs):
            own = {u: value for u, value in given.items() if u.leg in (None, number) and u.kind != OFFSET}
            shaped = {u.kind: value for u, value in own.items() if u.kind in self.system.shape}
            made: dict[str, Any] = dict(self.system.shaped(number, {**shape, **shaped})) if shaped else {}
            for name in {u.kind: None for u in own if u.kind not in self.system.shape}:
                parts = {u.part: value for u, value in own.items() if u.kind == name}
                vector = made.get(name) or getattr(leg, name)
                if name in PLACES:
                    made[name] = tuple(parts.get(i, vector[i]) for i in range(3))
                else:
                    made[name] = _turned(xp, vector, parts.get(0, 0.0), parts.get(1, 0.0))
            legs.append(made)
        return legs

    def offsets(self, values: Array) -> list[Any]:
        """What the encoder of each motor shows, less its leg's length [length]."""
        found: list[Any] = [0.0] * self.system.motors
        for i, each in enumerate(self.every):
            if each.kind == OFFSET and each.leg is not None:
                found[each.leg] = values[i]
        return found

    def fitted(self, values: Array) -> System:
        """The model with these values (n,). Errors: `InvalidProblemError` where there is no such robot."""
        return self.system.with_(**self.changes(values))

    def changes(self, values: Array) -> dict[str, Any]:
        """Parameters of the model that differ, plain data; of a robot of unlike legs all of those."""
        pairs = [(u, float(v)) for u, v in zip(self.every, values, strict=True) if u.kind != OFFSET]
        if all(u.leg is None for u, _ in pairs):
            return {u.kind: value for u, value in pairs}
        legs = []
        as_legs = self.system.declared["legs"].keys or {}
        for leg, made in zip(self.system.legs, self.vectors(np.asarray(values, dtype=float)), strict=True):
            plain: dict[str, Any] = {name: tuple(map(float, vector)) for name, vector in made.items()}
            now = replace(leg, **plain)
            data = {key: getattr(now, FIELDS.get(key, key)) for key in as_legs}
            legs.append({k: list(v) if isinstance(v, tuple) else v for k, v in data.items() if v is not None})
        return {"legs": legs}

    def _model(self) -> dict[str, float]:
        return {name: value for name, value in self.system.parameters().items() if name in self.system.shape}


def _meant(name: str, names: Iterable[str]) -> str:
    """A name for which a near one is looked for: of half a name, tilt, the whole."""
    return next((each for each in names if name and name in each), name)


def _chosen(name: str, known: Mapping[str, Unknown]) -> dict[str, Unknown]:
    """Those that a name stands for."""
    if name in known:
        return {name: known[name]}
    parts = re.fullmatch(rf"(\w+)(?:\[(\d+|{EACH})\])?", name)
    if parts is None:
        return {}
    kind, leg = parts[1], parts[2]
    return {
        each: unknown
        for each, unknown in known.items()
        if unknown.kind == kind and unknown.leg is not None and leg in (None, EACH, str(unknown.leg + 1))
    }


def _known(system: ParallelRobot) -> list[Unknown]:
    """All that can be fitted."""
    values = system.parameters()
    found = [
        Unknown(name, name, None, 0, system.declared[name].unit, float(values[name])) for name in system.shape
    ]
    for name in system.shape:
        unit = system.declared[name].unit
        found += [
            Unknown(f"{name}[{i + 1}]", name, i, 0, unit, float(values[name]))
            for i in range(len(system.legs))
        ]
    for place in PLACES:
        for i, leg in enumerate(system.legs):
            if not leg.pinned:
                vector = getattr(leg, place)
                found += [
                    Unknown(f"{place}[{i + 1}].{axis}", place, i, part, "length", float(vector[part]))
                    for part, axis in enumerate("xyz")
                ]
    for direction in DIRECTIONS:
        for i, leg in enumerate(system.legs):
            if getattr(leg, direction) is not None:
                found += [
                    Unknown(f"{direction}[{i + 1}].{turn}", direction, i, part, "angle", 0.0)
                    for part, turn in enumerate(TURNS)
                ]
    motors = motors_of(system)
    found += [Unknown(f"{OFFSET}[{motors[i] + 1}]", OFFSET, i, 0, "length", 0.0) for i in range(len(motors))]
    return found


def _turned(xp: Any, vector: Sequence[Any], up: Any, side: Any) -> tuple[Any, Any, Any]:
    """A direction turned by two small angles [rad], towards the third axis and at a right angle to that."""
    x, y, z = (float(each) for each in vector)
    across = hypot(x, y)
    if across < 1e-6:  # along the third axis: the first and the second stand for up and side
        first, second = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    else:
        first, second = (-z * x / across, -z * y / across, across), (-y / across, x / across, 0.0)
    functions = xp if not isinstance(up, float) or not isinstance(side, float) else None
    c, s = (functions.cos, functions.sin) if functions else (cos, sin)
    a, b, d = c(up) * c(side), s(up), c(up) * s(side)
    turned = [a * v + b * f + d * w for v, f, w in zip((x, y, z), first, second, strict=True)]
    return (turned[0], turned[1], turned[2])
