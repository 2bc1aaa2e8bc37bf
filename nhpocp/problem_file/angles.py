"""Angles that were probably meant in degrees: plain numbers are radians, and many turns are seldom meant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi
from typing import Any

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.document import dotted
from nhpocp.systems.system import System

TURN = 2 * pi
# turns above which an angle is doubted; coordinates such as a wheel's count theirs
ORIENTATION, COORDINATE = 1, 5


def probable_degrees(raw: Mapping[str, Any], system: System) -> Iterator[InvalidProblemError]:
    """A warning for every angle of the file, as it is written, that is a plain number too large for radians."""
    for path, value, turns in _angles(raw, system):
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if plain and abs(value) > turns * TURN:
            words = f"{value:g} radians are {abs(value) / TURN:.3g} turns; if degrees are meant, write {value:g} deg"
            yield InvalidProblemError(words, path=dotted(path))


def _angles(raw: Mapping[str, Any], system: System) -> Iterator[tuple[tuple[str | int, ...], Any, float]]:
    block = raw["system"]
    for name, parameter in system.declared.items():
        if parameter.unit == "angle" and name in block:
            yield ("system", name), block[name], ORIENTATION
    poses: list[tuple[tuple[str | int, ...], Any]] = [(("start",), raw["start"]), (("goal",), raw["goal"])]
    poses += [(("via", i), via) for i, via in enumerate(raw.get("via") or ())]
    for path, pose in poses:
        for part in system.state_space.blocks:
            value = pose.get(part.name)
            if part.kind == "rotation" and isinstance(value, Mapping):
                for name in ("rpy", "rotvec"):
                    for i, angle in enumerate(value.get(name) or ()):
                        yield (*path, part.name, name, i), angle, ORIENTATION
            elif part.unit == "angle" and isinstance(value, list):
                for i, angle in enumerate(value):
                    yield (*path, part.name, i), angle, COORDINATE
            elif part.unit == "angle":
                yield (*path, part.name), value, COORDINATE
