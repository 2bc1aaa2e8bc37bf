"""One leg of a parallel robot as built: two joints and what there is between them."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import hypot, isfinite
from numbers import Real
from typing import Any

from nhpocp.arrays import Array, cross, namespace, norm, unit
from nhpocp.constructed import Constructed
from nhpocp.errors import InvalidProblemError, describe, expect
from nhpocp.systems.joints import (
    BASE_JOINTS,
    BaseJoint,
    Extent,
    LegPose,
    Pinned,
    Prismatic,
    Rigid,
    Row,
    Vector3,
)
from nhpocp.systems.system import Parameter

DIRECTIONS = ("r", "w1", "w2", "w4")
FIELDS = {"base_joint": "joint"}  # of keys that are called otherwise
MIDDLE: Vector3 = (0.0, 1.0, 0.0)  # w2 = w3: the universal joints of an ordinary leg are parallel


@dataclass(frozen=True)
class Leg(Constructed):
    """One leg as built: two joints, and what there is between them.

    base, platform: the joints' centres a in base and b̂ in platform coordinates, (3,) [length]. joint: at the base,
    veselova, suslov, universal or spherical.

    r: about which the base joint cannot turn; of the veselova joint in base coordinates, of the suslov joint along
    g, w3, g × w3. w1, w2: axes of an ordinary universal base joint, in base coordinates and along g, w3, g × w3 (if
    not said, w2 = w3). w4: axis of the platform's universal joint, platform coordinates; without it that joint is
    spherical. Directions become unit vectors. length: None for a prismatic leg, "fixed" for a bar as long as at the
    start, a number for a bar of that length [length], 0 where the base joint holds the platform itself (suslov r and
    w2 then in platform coordinates). actuated: whether a motor drives the length; of a prismatic leg, unless said.
    Errors: `InvalidProblemError` naming what does not go together.
    """

    base: Vector3
    platform: Vector3
    r: Vector3 | None = None
    w4: Vector3 | None = None
    joint: str = "veselova"
    w1: Vector3 | None = None
    w2: Vector3 | None = None
    length: float | str | None = None
    actuated: bool | None = None

    def __post_init__(self) -> None:
        for name in ("base", "platform", *DIRECTIONS):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _vector(name, getattr(self, name), name in DIRECTIONS))
        if self.joint not in BASE_JOINTS:
            raise _bad(f"joint {self.joint!r} is none of {', '.join(BASE_JOINTS)}")
        if self.actuated is None:
            object.__setattr__(self, "actuated", self.length is None)
        self._check_length()
        self._check_directions()

    def _check_length(self) -> None:
        if isinstance(self.length, str):
            if self.length != "fixed":
                raise _bad(f"length {self.length!r} of a leg; expected fixed, or a number >= 0")
        elif self.length is not None:
            if (
                isinstance(self.length, bool)
                or not isinstance(self.length, Real)
                or not (isfinite(self.length) and self.length >= 0)
            ):
                raise _bad(f"length {self.length!r} of a leg; expected fixed, or a number >= 0")
            object.__setattr__(self, "length", float(self.length))
        if self.actuated and self.length is not None:
            raise _bad("a leg is actuated and of fixed length; a motor needs a length to change")

    def _check_directions(self) -> None:
        """Every direction that this leg's joints need, and no other."""
        wanted = {field.name for field in fields(BASE_JOINTS[self.joint])}  # type: ignore[arg-type]
        if self.joint == "universal" and self.w4 is None and not self.pinned:
            wanted = set()  # between universal and spherical joint a leg spins as it likes
        if "w2" in wanted and self.w2 is None:
            object.__setattr__(self, "w2", MIDDLE)
        if self.joint in ("veselova", "suslov") and self.w4 is None and not self.pinned:
            raise _bad(
                f"a leg with a {self.joint} joint has no w4; expected the axis of a universal joint in the platform, "
                "for with a spherical one the leg spins as it likes, and joint constrains nothing"
            )
        for name in ("r", "w1", "w2"):
            given = getattr(self, name) is not None
            if given and name not in wanted:
                raise _bad(f"{name} of a leg with a {self.joint} base joint has no meaning here; remove it")
            if not given and name in wanted:
                raise _bad(f"a leg with a {self.joint} base joint needs {name}, a direction")
        if self.pinned and self.w4 is not None:
            raise _bad("a leg of length 0 is the base joint alone; remove its w4")

    @property
    def pinned(self) -> bool:
        """Whether the base joint holds the platform itself."""
        return self.length == 0

    @property
    def base_joint(self) -> BaseJoint:
        kind = BASE_JOINTS[self.joint]
        directions = {field.name: getattr(self, field.name) for field in fields(kind)}  # type: ignore[arg-type]
        return kind(**directions)

    @property
    def extent(self) -> Extent:
        if self.length is None:
            return Prismatic(bool(self.actuated))
        return Pinned() if self.pinned else Rigid(None if self.length == "fixed" else float(self.length))

    @property
    def holds_a_turn(self) -> bool:
        """Whether the base joint's constraint reaches the platform: a leg that spins as it likes passes none on."""
        return self.joint != "spherical" and (self.w4 is not None or self.pinned)

    def pose(self, position: Array, rotation_platform_to_base: Array) -> LegPose:
        """Its vectors at a pose of the platform."""
        xp = namespace(position, rotation_platform_to_base)
        a = xp.vector(self.base)
        b = position + rotation_platform_to_base @ xp.vector(self.platform)
        span = b - a
        if self.pinned:
            g, w3 = rotation_platform_to_base[:, 0], rotation_platform_to_base[:, 1]
            r = self.base_joint.normal(g, w3)
            return LegPose(a, b, span, xp.array(0.0), g, r, w3, None, None)
        length = norm(span)
        g = span / length
        if self.w4 is None:
            return LegPose(a, b, span, length, g, None, None, None, None)
        w4 = rotation_platform_to_base @ xp.vector(self.w4)
        w3 = unit(cross(g, w4))
        return LegPose(a, b, span, length, g, self.base_joint.normal(g, w3), w3, w4, cross(w3, w4))

    def actuators(self, pose: LegPose, arm: Array) -> list[Row]:
        """Rows whose value is this leg's input; ``arm`` = b - p."""
        return self.extent.actuators(pose, arm)

    def constraints(self, pose: LegPose, arm: Array) -> list[Row]:
        """Rows whose value is zero."""
        turning = [self.extent.turning(pose, arm)] if self.holds_a_turn else []
        return [*self.extent.constraints(pose, arm), *turning]

    @property
    def constraint_kinds(self) -> list[str]:
        """ "holonomic" or "non-holonomic" for each row of `constraints`."""
        held = 3 if self.pinned else 0 if self.length is None else 1
        turning = ["holonomic" if self.base_joint.holonomic else "non-holonomic"]
        return ["holonomic"] * held + turning * self.holds_a_turn

    def invariants(self, pose: LegPose) -> dict[str, tuple[Array, float | None]]:
        """What holonomic joints keep as it is, by its name in messages; with the value that it must have, if any."""
        held: dict[str, tuple[Array, float | None]] = {}
        if self.holds_a_turn and (turn := self.base_joint.invariant(pose.g, pose.w3)) is not None:
            held["w1·w2"] = turn, 0.0
        if self.pinned:
            held |= {f"b - a along {axis}": (pose.span[k], 0.0) for k, axis in enumerate("xyz")}
        elif self.length is not None:
            held["length"] = pose.length, None if self.length == "fixed" else float(self.length)
        return held

    def describe(self) -> str:
        """Its joints and what they do, in words."""
        between = "prismatic" if self.length is None else "no length" if self.pinned else "fixed length"
        joints = [self.joint, between]
        if not self.pinned:
            joints.append("universal at the platform" if self.w4 else "spherical at the platform")
        kinds = [*["motor"] * bool(self.actuated), *self.constraint_kinds]
        rows = [f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)]
        return f"{', '.join(joints)}: {' + '.join(rows) or 'no row'}"

    def in_symbols(self, vectors: Mapping[str, Sequence[Array]]) -> Leg:
        """A twin for formulas, some of whose vectors, by the field's name, are three symbols; nothing is checked."""
        twin = copy.copy(self)
        for name, vector in vectors.items():
            object.__setattr__(twin, name, tuple(vector))
        return twin

    @classmethod
    def of(cls, leg: Leg | Mapping[str, Any], declared: Mapping[str, Parameter]) -> Leg:
        """A leg from plain data with the ``declared`` keys. Errors: `InvalidProblemError` naming the keys."""
        if isinstance(leg, Leg):
            return leg
        needed = {key for key, parameter in declared.items() if parameter.default is ...}
        if not needed <= set(leg) <= set(declared):
            raise _bad(f"a leg with {', '.join(leg)}; expected {', '.join(declared)}")
        return cls(**{FIELDS.get(key, key): value for key, value in leg.items()})


def several(legs: Any) -> list[Leg | Mapping[str, Any]]:
    """Legs as they are given. Errors: `InvalidProblemError` for what is no list of them."""
    if isinstance(legs, Leg | Mapping | str) or not isinstance(legs, Sequence):
        raise _bad(f"expected a list of legs, got {describe(legs)}")
    for leg in legs:
        expect(leg, (Leg, Mapping), "a leg, such as Leg(base=…, platform=…) or {'base': …}", "system.legs")
    return list(legs)


def numbered(number: int, leg: Leg | Mapping[str, Any], declared: Mapping[str, Parameter]) -> Leg:
    """A leg as `Leg.of`, whose errors say which of several it is."""
    try:
        return Leg.of(leg, declared)
    except InvalidProblemError as error:
        raise InvalidProblemError(f"leg {number}: {error.message}", path="system.legs") from None


def miscounted(legs: Sequence[Leg], rows: int, motors: int) -> str:
    """Why these legs do not determine the platform's motion, leg by leg."""
    each = "; ".join(f"leg {i} ({leg.describe()})" for i, leg in enumerate(legs, 1))
    if rows == 6 and not motors:
        remedy = "none of them a motor: the platform cannot move"
    else:
        more = rows - 6
        remedy = (
            f"{more} too many: leave out motors or constraints"
            if more > 0
            else f"{-more} missing: actuate a leg, fix its length, or give it a joint that constrains it"
        )
    return (
        f"motors and constraints give {rows} rows, and a platform in space needs 6, {remedy}. "
        f"Rows: {each or 'no leg'}"
    )


def _vector(name: str, given: Any, is_direction: bool) -> Vector3:
    given = given.tolist() if hasattr(given, "tolist") else given
    if not isinstance(given, list | tuple):
        raise _bad(f"{name} of a leg: expected 3 numbers, got {describe(given)}")
    values = tuple(_number(name, value) for value in given)
    if len(values) != 3:
        raise _bad(f"{name} of a leg has {len(values)} numbers; expected 3")
    if not all(isfinite(value) for value in values):
        raise _bad(f"{name} of a leg is {values}; expected finite numbers")
    if is_direction:
        length = hypot(*values)
        if length < 1e-9:
            raise _bad(f"{name} of a leg is the zero vector; expected a direction")
        if abs(length - 1) > 1e-15:  # else as it came: parameters() must round-trip exactly
            values = tuple(value / length for value in values)
    return (values[0], values[1], values[2])


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _bad(f"{name} of a leg: expected 3 numbers, got {describe(value)} among them")
    return float(value)


def _bad(message: str) -> InvalidProblemError:
    return InvalidProblemError(message, path="system.legs")
