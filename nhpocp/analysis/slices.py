"""Singular surfaces on a slice of states: two coordinates vary, the others stay as they are at one state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nhpocp import so3
from nhpocp.analysis.minima import golden_section
from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import Block, StateSpace, Unit
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

ANGLES = ("roll", "pitch", "yaw")
AXES = ("x", "y", "z")
RESOLUTION = 161  # of a map, each way
VALLEY = 0.1  # of the largest σ_min: how low a valley has to be for its floor to be looked for
ZERO = 1e-6  # of the same: what counts as zero on the floor of a valley
MOST = 4 * RESOLUTION  # valleys in one direction that are gone into; more are rounding: the lowest tell
ROUNDING = 1e-10  # of the same: below this a sign means nothing
ROOM = {"length": 0.5, "angle": pi / 4, "": 0.5}  # left around start, goal and path; lengths of the mechanism


@dataclass(frozen=True)
class Coordinate:
    """One number of a state: an entry of a vector, a scalar, or one of the angles of R = Rz(yaw) Ry(pitch) Rx(roll)."""

    name: str
    block: Block
    place: int

    @property
    def unit(self) -> Unit:
        return self.block.unit

    def of(self, space: StateSpace, states: Array) -> Array:
        """Values (k,) at states (k, size); angles go on past ±π along the states."""
        values = states[:, space.point_slice(self.block.name)]
        if self.block.kind != "rotation":
            return np.asarray(values[:, self.place])
        return np.unwrap([float(so3.to_rpy(row.reshape(3, 3))[self.place]) for row in values])


def placed(space: StateSpace, base: Array, coordinates: Sequence[Coordinate], values: Array) -> Array:
    """A state (size,) with some coordinates replaced: (k, size) for values (k, coordinates)."""
    states = np.tile(base, (len(values), 1))
    for block in space.blocks:
        mine = [(i, c.place) for i, c in enumerate(coordinates) if c.block == block]
        part = space.point_slice(block.name)
        if not mine:
            continue
        if block.kind != "rotation":
            for i, place in mine:
                states[:, part.start + place] = values[:, i]
            continue
        # all at once: angles read back from a rotation may be another triple
        angles = np.tile(so3.to_rpy(base[part].reshape(3, 3)), (len(values), 1))
        for i, place in mine:
            angles[:, place] = values[:, i]
        turned = Rotation.from_euler("ZYX", angles[:, ::-1])  # R = Rz(yaw) Ry(pitch) Rx(roll)
        states[:, part] = turned.as_matrix().reshape(-1, 9)
    return states


def coordinates(space: StateSpace) -> dict[str, Coordinate]:
    """Every coordinate of a state by its name: theta, position[0] or x for short, orientation.yaw or yaw for short."""
    full, short = {}, []
    for block in space.blocks:
        count = 3 if block.kind == "rotation" else block.dimension
        for place in range(count):
            if block.kind == "scalar":
                name = brief = block.name
            elif block.kind == "rotation":
                name, brief = f"{block.name}.{ANGLES[place]}", ANGLES[place]
            else:
                name = f"{block.name}[{place}]"
                brief = AXES[place] if block.unit == "length" and count <= 3 else name
            full[name] = Coordinate(brief, block, place)
            short.append((brief, name))
    taken = [brief for brief, _ in short]
    unique = {brief: full[name] for brief, name in short if taken.count(brief) == 1}
    named = {
        name: coordinate
        if coordinate.name in unique
        else Coordinate(name, coordinate.block, coordinate.place)
        for name, coordinate in full.items()
    }
    return {**named, **unique}


@dataclass(frozen=True)
class Span:
    """A coordinate and where it goes, low to high; None: chosen from what there is to show."""

    coordinate: Coordinate
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class SingularityMap:
    """det and σ_min of every regularity matrix over a slice; arrays (second × first), NaN where there is none.

    signed: σ_min with the sign of det, which crosses zero where det does. touching: points (k, 2) of the slice where it
    comes down to zero and goes back with the same sign, as it does on an axis of symmetry; a line of such points is a
    singular surface that no change of sign shows.
    """

    system: System
    first: Coordinate
    second: Coordinate
    first_values: Array
    second_values: Array
    base: Array  # the state that the other coordinates are taken from
    at: str  # what that state is called
    determinants: Mapping[str, Array]
    margins: Mapping[str, Array]
    touching: Mapping[str, Array]

    def __repr__(self) -> str:
        names = ", ".join(f"det {name.upper()}" for name in self.determinants)
        return f"<SingularityMap of {names} over {self.first.name} and {self.second.name}, through {self.at}>"

    @property
    def signed(self) -> dict[str, Array]:
        return {
            name: np.sign(self.determinants[name])
            * np.where(margin > ROUNDING * _largest(margin), margin, 0.0)
            for name, margin in self.margins.items()
        }

    def fixed(self) -> dict[str, float]:
        """The coordinates that do not vary, with their values."""
        space = self.system.state_space
        known = {(c.block.name, c.place): c for c in coordinates(space).values()}
        varying = {(c.block.name, c.place) for c in (self.first, self.second)}
        return {
            c.name: float(c.of(space, self.base[None])[0]) for key, c in known.items() if key not in varying
        }

    def to_json(self) -> dict[str, Any]:
        spans = {
            c.name: [float(values[0]), float(values[-1])]
            for c, values in ((self.first, self.first_values), (self.second, self.second_values))
        }
        surfaces = {}
        for name, values in self.signed.items():
            known = values[np.isfinite(values)]
            surfaces[name] = {
                "changes_sign": bool((known > 0).any() and (known < 0).any()),
                "touches_zero": bool(len(self.touching[name])),
                "share_negative": float((known < 0).mean()) if known.size else None,
                "least_sigma": float(np.abs(known).min()) if known.size else None,
            }
        return {"coordinates": spans, "at": self.at, "fixed": self.fixed(), "matrices": surfaces}


def chosen(space: StateSpace, names: Sequence[str]) -> list[Coordinate]:
    """Coordinates by name. Errors: `InvalidProblemError` for a name that is none, or two that are one."""
    known, picked = coordinates(space), []
    for name in names:
        if name not in known:
            raise InvalidProblemError(
                f"slice: no coordinate {name!r}; there are {', '.join(_shortest(known))}"
            )
        picked.append(known[name])
    if len(picked) != 2 or picked[0] == picked[1]:
        raise InvalidProblemError(
            f"slice: takes two coordinates of {', '.join(_shortest(known))}; got {', '.join(names) or 'none'}"
        )
    return picked


def _shortest(known: Mapping[str, Coordinate]) -> list[str]:
    return list(dict.fromkeys(coordinate.name for coordinate in known.values()))


def livelier(space: StateSpace, states: Array, length: float) -> list[Coordinate]:
    """The two coordinates that move most over some states (k, size), lengths in units of the mechanism's."""
    known = list(dict.fromkeys(coordinates(space).values()))
    ranges = [np.ptp(c.of(space, states)) / (length if c.unit == "length" else 1.0) for c in known]
    order = sorted(range(len(known)), key=lambda i: -round(float(ranges[i]), 9))
    return [known[i] for i in sorted(order[:2])]


def singularity_map(
    system: System, spans: Sequence[Span], base: Array, at: str, shown: Array, length: float
) -> SingularityMap:
    """The map over two spans around ``base``; a span without ends goes round ``shown`` (k, size) with some room."""
    first, second = (span.coordinate for span in spans)
    plane = _Plane(system, base, (first, second), length)
    grids = [_grid(span, span.coordinate.of(system.state_space, shown), length) for span in spans]
    lines = [plane.points(np.column_stack([grids[0], np.full(RESOLUTION, value)])) for value in grids[1]]
    margins, determinants = (
        _stacked([of(line) for line in lines]) for of in (plane.sigmas, plane.determinants)
    )
    return SingularityMap(
        system,
        first,
        second,
        grids[0],
        grids[1],
        base,
        at,
        determinants,
        margins,
        {
            name: plane.touching(name, margin, determinants[name], grids[0], grids[1])
            for name, margin in margins.items()
        },
    )


def _stacked(rows: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _grid(span: Span, seen: Array, length: float) -> Array:
    room = ROOM[span.coordinate.unit] * (length if span.coordinate.unit == "length" else 1.0)
    room = max(room, 0.35 * float(np.ptp(seen)))
    low = float(seen.min()) - room if span.low is None else span.low
    high = float(seen.max()) + room if span.high is None else span.high
    if not low < high:
        raise InvalidProblemError(
            f"slice: {span.coordinate.name} from {low:g} to {high:g}; expected low < high"
        )
    return np.linspace(low, high, RESOLUTION)


def _largest(margin: Array) -> float:
    return float(np.nanmax(margin)) if np.isfinite(margin).any() else 0.0


class _Plane:
    """The margins on a slice."""

    def __init__(
        self, system: System, base: Array, coordinates: tuple[Coordinate, Coordinate], length: float
    ) -> None:
        self._numeric, self._space = numeric_system(system), system.state_space
        self._base, self._coordinates, self._length = base, coordinates, length

    def points(self, places: Array) -> Array:
        """The packed points (k, size) at places (k, 2) of the slice."""
        return placed(self._space, self._base, self._coordinates, places)

    def sigmas(self, points: Array) -> dict[str, Array]:
        with np.errstate(all="ignore"):
            return self._numeric.sigmas(points, self._length)

    def determinants(self, points: Array) -> dict[str, Array]:
        with np.errstate(all="ignore"):
            return self._numeric.determinants(points)

    def touching(self, name: str, margin: Array, determinant: Array, first: Array, second: Array) -> Array:
        """Zeros of σ_min on the grid's lines without a change of sign, by golden section from three neighbours."""
        largest = _largest(margin)
        low = np.nan_to_num(margin, nan=np.inf)
        touched = [np.empty((0, 2))]
        for axis, grid in ((1, first), (0, second)):
            across = second if axis == 1 else first
            values, signs = (np.moveaxis(array, axis, 1) for array in (low, np.sign(determinant)))
            before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
            same = signs[:, :-2] == signs[:, 2:]
            valley = (here <= before) & (here < after) & (here < VALLEY * largest)
            apart = np.minimum(before, after) > ZERO * largest  # else the line runs along a zero
            lines, places = np.nonzero(valley & apart & same)
            if not len(lines):
                continue
            if len(lines) > MOST:
                lowest = np.argpartition(here[lines, places], MOST)[:MOST]
                lines, places = lines[lowest], places[lowest]
            fixed = across[lines]

            def at(moving: Array, fixed: Array = fixed, axis: int = axis) -> Array:
                pair = (moving, fixed) if axis == 1 else (fixed, moving)
                return self.sigmas(self.points(np.column_stack(pair)))[name]

            where, least = golden_section(at, grid[places], grid[places + 2])
            sampled = here[lines, places]
            where, least = np.where(sampled < least, grid[places + 1], where), np.minimum(sampled, least)
            kept = least < ZERO * largest
            pair = (where, fixed) if axis == 1 else (fixed, where)
            touched.append(np.column_stack(pair)[kept])
        return np.vstack(touched)
