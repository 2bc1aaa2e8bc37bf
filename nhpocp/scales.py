"""What counts as 1 in a problem: its own length, time and number, from which every other scale follows.

A problem in other units is the same problem, with lengths × s and times × τ. Its length and time here are then × s and
× τ exactly, so that whatever is divided by a scale is the same number in every unit. Solvers work on such numbers only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints import Bound
from nhpocp.state_space import StateSpace, Unit
from nhpocp.systems.system import System

LEAST = 1e-6  # of error_length, or of 1: what poses span is rounding below this


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
        return np.array([self.of(block.unit) for block in _by_number(self.system.state_space)])

    @property
    def inputs(self) -> Array:
        """One per input."""
        return np.array([self.of(block.unit) / self.time for block in _by_number(self.system.input_space)])

    def objective(self, name: str) -> float:
        """Of one of `INTEGRANDS`, integrated over the motion, or of the time."""
        if name == "time":
            return self.time
        if name == "effort":
            return self.time * float(np.max(self.inputs, initial=0.0)) ** 2 or 1.0
        if name == "leg_effort":
            return self.length**2 / self.time
        units = {block.unit for block in self.system.state_space.blocks}
        return max(self.radius if unit == "angle" else self.of(unit) for unit in units)


def natural_scales(
    system: System,
    poses: Sequence[Mapping[str, Any]],
    bounds: Iterable[Bound],
    durations: Iterable[float | None],
    error_length: float,
    length_scale: float | None,
) -> Scales:
    """The scales of a problem's parts.

    The length is the mechanism's own; for a system that has none, what the ``poses`` (start, via, goal) are apart in
    any one component, else how wide its state is bounded, else error_length. The number likewise, else 1. The time is
    the first of the ``durations`` that is known.
    """
    bounds = list(bounds)
    length = system.own_length or _span(system, "length", poses, bounds, error_length)
    number = _span(system, "", poses, bounds, 1.0)
    time = next(duration for duration in durations if duration is not None)
    radius = length_scale or system.own_length or error_length
    return Scales(system, length, float(time), number, radius)


def _span(
    system: System, unit: Unit, poses: Sequence[Mapping[str, Any]], bounds: Iterable[Bound], otherwise: float
) -> float:
    """The largest width of the state's components with this unit."""
    names = [block.name for block in system.state_space.blocks if block.unit == unit]
    apart = [float(np.ptp(found, axis=0).max()) for name in names if len(found := _values(name, poses))]
    wide = [_width(bound) for bound in bounds if bound.quantity in names]
    least = LEAST * otherwise
    return next((width for widths in (apart, wide) if (width := max(widths, default=0.0)) > least), otherwise)


def _values(name: str, poses: Sequence[Mapping[str, Any]]) -> Array:
    return np.array([np.atleast_1d(pose[name]) for pose in poses if name in pose], dtype=float)


def _width(bound: Bound) -> float:
    widths = np.atleast_1d(np.asarray(bound.upper, dtype=float) - np.asarray(bound.lower, dtype=float))
    return float(np.max(widths[np.isfinite(widths)], initial=0.0))


def _by_number(space: StateSpace) -> list[Any]:
    return [block for block in space.blocks for _ in range(block.dimension)]
