"""What counts as 1 in a problem: its own length, time and number, from which every other scale follows.

A problem in other units is the same problem, with lengths × s and times × τ. Its length and time here are then × s and
× τ exactly, so that whatever is divided by a scale is the same number in every unit. Solvers work on such numbers only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from nhpocp.state_space import Unit
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from nhpocp.arrays import Array

COARSE = 0.02  # of the motion: an error in position that is no longer a small one
LEAST = 1e-6  # of error_length, or of 1: what poses span is rounding below this
SMALLEST = 1e-4  # of its quantity's scale: the least that a limit counts for

Box = tuple[str, Any, Any]  # a bounded quantity, its lower and its upper limits


@dataclass(frozen=True)
class Scales:
    """The size of every number of one problem, in that problem's units.

    length, time: of the problem; number: of state components that have no unit; radius: the length by which an angle
    counts in `path_length`. An angle's scale is 1 rad, an input's that of its unit over the time.
    """

    system: System
    length: float
    time: float
    number: float
    radius: float

    def of(self, unit: Unit) -> float:
        """Of a quantity with this unit."""
        return {"length": self.length, "angle": 1.0, "": self.number}[unit]

    @property
    def states(self) -> Array:
        """One per tangent number of the state."""
        import numpy as np

        return np.array([self.of(unit) for unit in self.system.state_space.tangent_units])

    @property
    def inputs(self) -> Array:
        """One per input."""
        import numpy as np

        return np.array([self.of(unit) / self.time for unit in self.system.input_space.tangent_units])

    @property
    def points(self) -> Array:
        """One per number of a packed state; the entries of a rotation are numbers up to 1."""
        import numpy as np

        return np.array([self.of(b.unit) for b in self.system.state_space.blocks for _ in range(b.size)])


def natural_scales(
    system: System,
    poses: Sequence[Mapping[str, Any]],
    boxes: Iterable[Box],
    durations: Iterable[float | None],
    error_length: float,
    length_scale: float | None,
) -> Scales:
    """The scales of a problem's parts.

    The length is the mechanism's own; for a system that has none, what the ``poses`` (start, via, goal) are apart in
    any one component, else how wide its state is bounded, else error_length. The number likewise, else 1. The time is
    the first of the ``durations`` that is known.
    """
    boxes = list(boxes)
    length = system.own_length or _span(system, "length", poses, boxes, error_length)
    number = _span(system, "", poses, boxes, 1.0)
    time = next(duration for duration in durations if duration is not None)
    return Scales(system, length, float(time), number, length_scale or system.own_length or error_length)


def side_size(limit: float, other: float, scale: float, coordinate: bool) -> float:
    """What the tolerance of one side of a bound is a fraction of, with the ``other`` side's limit.

    The limit itself; one at 0 counts for as much as the bound is wide, at most for the quantity's own ``scale``, and
    none for less than `SMALLEST` of that. The zero of a ``coordinate`` lies anywhere, so that its limits count for no
    more than its scale and the bound's width.
    """
    width = abs(other - limit) or inf
    size = abs(limit) or min(width, scale)
    if coordinate:
        size = min(size, width, scale)
    return max(size, SMALLEST * scale)


def coarse(scales: Scales, poses: Sequence[Mapping[str, Any]], error_length: float, tolerance: float) -> str:
    """What is to be said of a tolerance on E that is large beside the motion between the poses; nothing if it is not.

    As where error_length, 1 by default, stands beside a robot in metres.
    """
    units = {block.unit for block in scales.system.state_space.blocks}
    motion = _span(scales.system, "length", poses, [], scales.system.own_length or 0.0)
    if "length" not in units or not tolerance * error_length > COARSE * motion > 0:
        return ""
    return (
        f"{error_length:g} is the length that counts as much as one radian in E, so that the tolerance {tolerance:g} "
        f"lets positions be off by {tolerance * error_length:.3g}, where the motion is {motion:.3g}; "
        f"write error_length: {min(scales.length, motion):.3g}"
    )


def _span(
    system: System, unit: Unit, poses: Sequence[Mapping[str, Any]], boxes: Iterable[Box], otherwise: float
) -> float:
    """The largest width of the state's components with this unit."""
    names = [block.name for block in system.state_space.blocks if block.unit == unit]
    apart = [
        max(component) - min(component)
        for name in names
        for component in zip(*(tuple(numbers(pose[name])) for pose in poses if name in pose), strict=True)
    ]
    wide = [
        high - low
        for name, lower, upper in boxes
        if name in names
        for low, high in _pairs(tuple(numbers(lower)), tuple(numbers(upper)))
        if isfinite(high - low)
    ]
    least = LEAST * otherwise
    return next((width for widths in (apart, wide) if (width := max(widths, default=0.0)) > least), otherwise)


def _pairs(lower: tuple[float, ...], upper: tuple[float, ...]) -> Iterator[tuple[float, float]]:
    """The limits of each component; one number stands for all."""
    count = max(len(lower), len(upper))
    for i in range(count):
        yield lower[i % len(lower)], upper[i % len(upper)]


def numbers(value: Any) -> Iterator[float]:
    """The numbers of a scalar, a nested list or an array, in order."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        for entry in value:
            yield from numbers(entry)
    else:
        yield float(value)
