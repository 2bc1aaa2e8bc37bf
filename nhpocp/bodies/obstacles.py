"""The obstacles that a problem file names: a line for each kind, from which its schema and its checks follow."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import hypot
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from nhpocp import so3
from nhpocp.bodies.hull import TINY, HalfSpace, Hull, ball, box, capsule, hull_of, polygon, solid
from nhpocp.bodies.stl import convex_corners
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError, describe, expect, refuse
from nhpocp.frozen import ByValue, Frozen
from nhpocp.written_numbers import numbers_in

NAME = re.compile(r"\w([\w -]{0,38}\w)?")
FLAT = 1e-9  # [rad], and of a polygon's length: what is rounding
CROSSED = "the sides cross; write the corners in order around the polygon"
DENTED = "the polygon is not convex; write several convex ones, each with its corners in order"
Value = Literal["place", "direction", "size", "sizes", "angles", "angle", "places", "file"]


@dataclass(frozen=True)
class Entry:
    """A number, or a list of them, of an obstacle. needed: whether it has to be given; else its ``default``."""

    kind: Value
    meaning: str
    needed: bool = True
    default: Any = None


@dataclass(frozen=True)
class Kind:
    """A kind of obstacle. dimension: 2 in the plane, 3 in space. shape: what its entries make."""

    dimension: int
    meaning: str
    entries: Mapping[str, Entry]
    shape: Callable[..., Hull | HalfSpace]


def _box(centre: Any, size: Any, rpy: Any) -> Hull:
    return box(centre, so3.from_mapping({"rpy": list(rpy)}), 0.5 * size)


def _rectangle(centre: Any, size: Any, angle: float) -> Hull:
    import numpy as np

    c, s = np.cos(angle), np.sin(angle)
    return box(centre, np.array([[c, -s], [s, c]]), 0.5 * size)


def _bar(start: Any, end: Any, radius: float) -> Hull:
    """A capsule; a ball where both ends are one, for the distance of two edges asks for edges of some length."""
    along = end - start
    return capsule(start, end, radius) if along @ along > TINY else ball(start, radius)


def _convex(points: Any, file: Any) -> Hull:
    try:
        return solid(points)
    except ValueError as error:
        raise InvalidProblemError(str(error), path="points") from None


def _outline(corners: Any) -> Hull:
    """A polygon around its corners, of which those at one place count once, and those inside a side not at all.

    Errors: where it is not convex.
    """
    import numpy as np

    length, width = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if width <= FLAT * length:
        raise InvalidProblemError("the corners lie on one line, and bound no area", path="corners")
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    around = corners[apart > FLAT * length]
    around = around[np.abs(_turns(around)) > FLAT]
    turns = _turns(around)
    if not ((turns > 0).all() or (turns < 0).all()):
        crossed = len(hull_of(around).corners) == len(np.unique(around, axis=0))
        raise InvalidProblemError(CROSSED if crossed else DENTED, path="corners")
    if abs(abs(turns.sum()) - 2 * np.pi) > 1e-6:  # more than once around
        raise InvalidProblemError(CROSSED, path="corners")
    return polygon(list(around))


def _turns(corners: Any) -> Any:
    """By which angle the sides of a polygon turn at each corner, from -π to π."""
    import numpy as np

    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    crosses = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.arctan2(crosses, (before * after).sum(axis=1))


def _half(point: Any, normal: Any) -> HalfSpace:
    return HalfSpace(point, normal)


CENTRE, RADIUS = Entry("place", "centre [length]"), Entry("size", "radius [length]")
POINT = Entry("place", "a point of the surface [length]")
NORMAL = Entry("direction", "out of the obstacle, towards what is free")
KINDS: Mapping[str, Kind] = {
    "sphere": Kind(3, "a ball", {"centre": CENTRE, "radius": RADIUS}, ball),
    "capsule": Kind(
        3,
        "a round bar with round ends",
        {
            "from": Entry("place", "one end of its axis [length]"),
            "to": Entry("place", "the other end"),
            "radius": RADIUS,
        },
        _bar,
    ),
    "box": Kind(
        3,
        "a box",
        {
            "centre": CENTRE,
            "size": Entry("sizes", "lengths along its own axes"),
            "rpy": Entry("angles", "roll, pitch, yaw [rad]", needed=False, default=(0.0, 0.0, 0.0)),
        },
        _box,
    ),
    "half_space": Kind(3, "all behind a plane: a floor or a wall", {"point": POINT, "normal": NORMAL}, _half),
    "mesh": Kind(
        3,
        "a convex body from an STL file, or the convex hull of points",
        {
            "points": Entry("places", "its corners; what a file is read into", needed=False),
            "file": Entry("file", "an STL file, from the problem file's folder on", needed=False),
        },
        _convex,
    ),
    "disc": Kind(2, "a disc", {"centre": CENTRE, "radius": RADIUS}, ball),
    "rectangle": Kind(
        2,
        "a rectangle",
        {
            "centre": CENTRE,
            "size": Entry("sizes", "lengths along its own axes"),
            "angle": Entry("angle", "by which it is turned [rad]", needed=False, default=0.0),
        },
        _rectangle,
    ),
    "polygon": Kind(
        2, "a convex polygon", {"corners": Entry("places", "its corners in order [length]")}, _outline
    ),
    "half_plane": Kind(2, "all behind a line: a kerb or a wall", {"point": POINT, "normal": NORMAL}, _half),
}


@dataclass(frozen=True, eq=False)
class Obstacle(ByValue, Frozen):
    """An obstacle as a file writes it: `Obstacle("sphere", {"centre": [8, 0, 30], "radius": 2})`.

    kind: in space sphere, capsule, box, half_space or mesh, in the plane disc, rectangle, polygon or half_plane.
    entries: its place and size [length], angles [rad], by the names that a file has for them. name: in messages; none:
    the kind, and in a problem its number among those of that kind. The file of a mesh is read at once.
    Errors: `InvalidProblemError` for a kind, or an entry, that is none.
    """

    kind: str
    entries: Mapping[str, Any]
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InvalidProblemError("unknown obstacle", word=str(self.kind), known=KINDS)
        if not isinstance(self.entries, Mapping):
            words = f"expected {{{', '.join(KINDS[self.kind].entries)}}}, got {describe(self.entries)}"
            raise InvalidProblemError(words, path=self.kind)
        kind = KINDS[self.kind]
        unknown = [name for name in self.entries if name not in kind.entries]
        if unknown:
            path = f"{self.kind}.{unknown[0]}"
            raise InvalidProblemError("unknown key", path=path, word=str(unknown[0]), known=kind.entries)
        for name, entry in kind.entries.items():
            if entry.needed and name not in self.entries:
                raise InvalidProblemError(f"missing; {entry.meaning}", path=f"{self.kind}.{name}")
        if self.kind == "mesh" and not self.entries:
            raise InvalidProblemError("missing; or file, an STL file", path="mesh.points")
        given = {
            name: _checked(kind, name, self.entries[name], self.kind)
            for name in kind.entries
            if name in self.entries
        }
        if self.kind == "mesh" and "points" not in given:
            given["points"] = _corners_in(given["file"])
        object.__setattr__(self, "entries", given)
        object.__setattr__(self, "name", self.name or self.kind)
        try:
            self.__dict__["shape"] = self._shape()
        except InvalidProblemError as error:
            raise error.under(self.kind) from None

    @property
    def dimension(self) -> int:
        return KINDS[self.kind].dimension

    @cached_property
    def shape(self) -> Hull | HalfSpace:
        """What it takes up."""
        return self._shape()

    def _shape(self) -> Hull | HalfSpace:
        import numpy as np

        kind = KINDS[self.kind]
        values = [self.entries.get(name, entry.default) for name, entry in kind.entries.items()]
        return kind.shape(*(np.array(value) if isinstance(value, tuple) else value for value in values))

    @property
    def own_name(self) -> str:
        """The name that was given to it; empty where its kind, and a number, stand for one."""
        return self.name if _is_own(self.name, self.kind) else ""

    def as_data(self) -> dict[str, Any]:
        """As a file writes it."""
        plain = {name: _listed(value) for name, value in self.entries.items()}
        return ({"name": self.own_name} if self.own_name else {}) | {self.kind: plain}

    @classmethod
    def several(cls, given: Any) -> tuple[Obstacle, ...]:
        """Obstacles as Python or a file gives them, with names. Errors: `InvalidProblemError` for all that are none."""
        if isinstance(given, Mapping | str) or not isinstance(given, Sequence):
            words = f"expected a list such as [{{sphere: {{centre: …, radius: …}}}}], got {describe(given)}"
            raise InvalidProblemError(words, path="obstacles")
        made: list[Obstacle] = []
        wrong: list[InvalidProblemError] = []
        for i, each in enumerate(given):
            try:
                made.append(_one(each))
            except InvalidProblemError as error:
                wrong.append(error.under(f"obstacles[{i}]"))
        if wrong:
            wrong[0].others = tuple(wrong[1:])
            raise wrong[0]
        count: dict[str, int] = {}
        named = []
        for each in made:
            if not each.own_name:
                count[each.kind] = count.get(each.kind, 0) + 1
            name = each.own_name or f"{_words(each.kind)} {count[each.kind]}"
            named.append(each if each.name == name else cls(each.kind, each.entries, name=name))
        names = [each.name for each in named]
        refuse(
            [
                InvalidProblemError("another obstacle is called so", path=f"obstacles[{i}].name")
                for i, name in enumerate(names)
                if name in names[:i]
            ]
        )
        return tuple(named)


def _words(kind: str) -> str:
    return kind.replace("_", " ")


def _is_own(name: str, kind: str) -> bool:
    """Whether a name is none that obstacles of a kind have without one."""
    return not re.fullmatch(rf"{kind}|{_words(kind)}( \d+)?", name)


def _one(given: Any) -> Obstacle:
    if isinstance(given, Obstacle):
        return given
    entries = (
        {key: value for key, value in given.items() if key != "name"} if isinstance(given, Mapping) else {}
    )
    if len(entries) != 1:
        words = f"expected one of {', '.join(KINDS)}, and its entries; got {describe(given)}"
        raise InvalidProblemError(words)
    ((kind, numbers),) = entries.items()
    obstacle = Obstacle(kind, numbers)
    return obstacle if given.get("name") is None else replace(obstacle, name=_name(given["name"]))


def _name(given: Any) -> str:
    """A name as it may stand in a message beside those of bodies."""
    if not isinstance(given, str) or not NAME.fullmatch(given):
        words = f"expected a name of letters, digits, blanks, '_' and '-', got {describe(given)}"
        raise InvalidProblemError(words, path="name")
    if any(not _is_own(given, kind) for kind in KINDS):
        words = f"{given!r} is what an obstacle without a name is called; choose another, or leave it out"
        raise InvalidProblemError(words, path="name")
    return given


def among_bodies(obstacles: Sequence[Obstacle], model: str, bodies: Mapping[str, Hull]) -> None:
    """Errors: `InvalidProblemError` for those in the plane around bodies in space, or the other way round, and for
    those that are called like a body.
    """
    wanted = next(iter(bodies.values())).dimension
    wrong = [i for i, obstacle in enumerate(obstacles) if obstacle.dimension != wanted]
    known = ", ".join(name for name, kind in KINDS.items() if kind.dimension == wanted)
    place = {2: "in the plane", 3: "in space"}[wanted]
    words = f"the bodies of {model} are {place}; expected one of {known}"
    refuse([InvalidProblemError(words, path=f"obstacles[{i}]", at_key=True) for i in wrong])
    alike = [i for i, obstacle in enumerate(obstacles) if obstacle.name in bodies]
    words = f"a body of {model} is called so; choose a name other than {', '.join(bodies)}"
    refuse([InvalidProblemError(words, path=f"obstacles[{i}].name") for i in alike])


def _checked(kind: Kind, name: str, value: Any, called: str) -> Any:
    """An entry as plain numbers."""
    path, entry = f"{called}.{name}", kind.entries[name]
    if entry.kind == "file":
        expect(value, (str, PathLike), "the name of an STL file", path)
        return str(value)
    value = value.tolist() if hasattr(value, "tolist") else value
    try:
        value = numbers_in(value)
    except ValueError as error:
        raise InvalidProblemError(str(error), path=path) from None
    if entry.kind in ("size", "angle"):
        number = real(value, path)
        if entry.kind == "size" and not number > 0:
            raise InvalidProblemError(f"{number:g}; expected a length > 0", path=path)
        return number
    if entry.kind == "places":
        if not isinstance(value, list | tuple) or len(value) < kind.dimension + 1:
            words = f"{describe(value)}; expected {kind.dimension + 1} or more points"
            raise InvalidProblemError(words, path=path)
        return tuple(_vector(each, kind.dimension, f"{path}[{i}]") for i, each in enumerate(value))
    numbers = _vector(value, 3 if entry.kind == "angles" else kind.dimension, path)
    if entry.kind == "sizes" and not all(number > 0 for number in numbers):
        raise InvalidProblemError("expected lengths > 0", path=path)
    if entry.kind == "direction":
        length = hypot(*numbers)
        if length < 1e-9:
            raise InvalidProblemError("the zero vector; expected a direction", path=path)
        return numbers if abs(length - 1) < 1e-15 else tuple(number / length for number in numbers)
    return numbers


def _vector(value: Any, size: int, path: str) -> tuple[float, ...]:
    if not isinstance(value, list | tuple):
        raise InvalidProblemError(f"expected {size} numbers, got {describe(value)}", path=path)
    if len(value) != size:
        raise InvalidProblemError(f"{len(value)} numbers; expected {size}", path=path)
    return tuple(real(number, path) for number in value)


def _corners_in(file: str) -> tuple[tuple[float, ...], ...]:
    """The corners of the mesh in an STL file, as an entry."""
    try:
        corners = convex_corners(Path(file))
    except InvalidProblemError as error:
        raise error.under("mesh.file") from None
    return tuple(tuple(corner) for corner in corners.tolist())


def _listed(value: Any) -> Any:
    return [_listed(each) for each in value] if isinstance(value, tuple | list) else value
