"""Distances measured again along a replayed path, by another formula than the one that solvers differentiate.

That is the GJK algorithm of the Flexible Collision Library (python-fcl) on the convex hulls of corners. It may end too
early between bodies that stand square to each other, and then says too much: its answer counts only where the two lie
so far apart along the line of its nearest points. Else, and where it is not installed, it is the point of least norm in
the hull of all differences of corners, by non-negative least squares [Lawson & Hanson, ch. 23]. How deep overlapping
hulls are is the depth of zero in that hull of differences, by its facets (Qhull). Radii are taken off afterwards. From
a half space a hull is as far as its lowest corner, with the library and without.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.bodies.hull import HalfSpace, Hull
from nhpocp.bodies.surroundings import Surroundings
from nhpocp.calls import call, mapped
from nhpocp.constraints.bound import RELATIVE, Bound, BoundReport, check_bounds
from nhpocp.systems.system import DISTANCE, System

CURVED = 1.05  # of a straight line: how long a body's way from one sample to the next is at most
CERTAIN = 1e-9  # of the largest coordinate: what a distance may be more than a gap that proves it
TOUCHING = 1e-12  # of the largest coordinate: hulls so near are looked at as overlapping ones
PARTS, MOST = 8, 40_000  # into which an interval in doubt is cut, and samples that are added in all
Between = Callable[[Array, Array], Array]  # corners (n, d) and (m, d) ↦ the distance of their hulls


def measured_by(around: Surroundings) -> str:
    """What measures here, in words."""
    flat = any(isinstance(shape, HalfSpace) for shape in around.shapes().values())
    words = "distances by python-fcl"
    if _fcl() is None:
        words = 'distances by least squares, for python-fcl is missing (pip install "nhpocp[distances]")'
    return f"{words}, those from half spaces by the heights of corners" if flat else words


def _fcl() -> Any:
    try:
        import fcl
    except ImportError:
        return None
    return fcl


class Distances:
    """Measures the pairs of a system among its surroundings along paths."""

    def __init__(self, system: System, surroundings: Surroundings) -> None:
        self._system, self._surroundings = system, surroundings
        self._shapes = self._surroundings.shapes()
        x = ca.SX.sym("x", system.state_space.size)
        self._bodies: Mapping[str, Hull] = system.bodies(x)
        rows = [ca.vertcat(*[ca.SX(corner) for corner in body.corners]) for body in self._bodies.values()]
        self._function = ca.Function("corners", [x], [ca.densify(ca.vertcat(*rows))])

    @cached_property
    def _between(self) -> Between:
        fcl = _fcl()
        return by_fcl(fcl) if fcl is not None else by_least_squares

    def corners(self, states: Array) -> dict[str, Array]:
        """Of every body at samples, (k, corners, 2 or 3)."""
        (numbers,) = call(mapped(self._function, len(states)), states)
        numbers, first, places = numbers.reshape(len(states), -1), 0, {}
        for name, body in self._bodies.items():
            size = len(body.corners) * body.dimension
            places[name] = numbers[:, first : first + size].reshape(len(states), -1, body.dimension)
            first += size
        return places

    def measure(self, corners: Mapping[str, Array], pair: int) -> Array:
        """The distance of a pair at every sample, (k,); NaN where a body's place is none."""
        one, other = self._surroundings.pairs[pair]
        hull, mine = self._bodies[one], corners[one]
        good = np.isfinite(mine).all(axis=(1, 2))
        distances = np.full(len(mine), np.nan)
        shape = self._bodies.get(other) or self._shapes[other]
        if isinstance(shape, HalfSpace):
            distances[good] = ((mine[good] - shape.point) @ shape.normal).min(axis=1) - hull.radius
            return distances
        if other in corners:
            its = corners[other]
        else:
            its = np.broadcast_to(np.array(shape.corners), (len(mine), *np.shape(shape.corners)))
        for k in np.flatnonzero(good & np.isfinite(its).all(axis=(1, 2))):
            apart = self._between(mine[k], its[k])
            if apart <= TOUCHING * np.abs(mine[k]).max():
                apart = -way_out(mine[k], its[k])
            distances[k] = apart - hull.radius - shape.radius
        return distances

    def way(self, corners: Mapping[str, Array], pair: int) -> Array:
        """By how much a pair's distance can change between samples at most, (k - 1,)."""
        moved = [
            np.linalg.norm(np.diff(corners[name], axis=0), axis=2).max(axis=1)
            for name in self._surroundings.pairs[pair]
            if name in corners
        ]
        return CURVED * np.sum(moved, axis=0)

    def along(self, path: Callable[[Array], Array], times: Array, least: Array) -> tuple[Array, Array, bool]:
        """Times with more among them, the distances there (k, pairs), and whether what lies between was bounded too.

        least: of every pair, what its distance may not be below between the samples. A distance that was not looked at,
        at a time for another pair, is infinite.
        """
        corners = self.corners(path(times))
        count = len(self._surroundings.pairs)
        values = np.stack([self.measure(corners, pair) for pair in range(count)], axis=1)
        moments, rows, bounded = [times], [values], True
        for pair in map(int, np.flatnonzero(np.isfinite(least))):
            more, distances, done = self._between_samples(
                path, times, corners, values[:, pair], pair, least[pair]
            )
            row = np.full((len(more), count), np.inf)
            row[:, pair] = distances
            moments, rows, bounded = [*moments, more], [*rows, row], bounded and done
        return np.concatenate(moments), np.concatenate(rows), bounded

    def _between_samples(
        self, path: Any, times: Array, corners: Mapping[str, Array], values: Array, pair: int, least: float
    ) -> tuple[Array, Array, bool]:
        """Samples added until the distance between any two neighbours is seen to stay above ``least``."""
        added: list[Array] = []
        found: list[Array] = []
        starts, ends, low, high = times[:-1], times[1:], values[:-1], values[1:]
        way, budget = self.way(corners, pair), MOST
        while True:
            doubtful = (0.5 * (low + high - way) < least) & (np.minimum(low, high) >= least) & (ends > starts)
            if not doubtful.any():
                return np.concatenate([*added, []]), np.concatenate([*found, []]), True
            grid = np.linspace(starts[doubtful], ends[doubtful], PARTS + 1)  # parts + 1, intervals
            if (budget := budget - grid.size) < 0:
                return np.concatenate([*added, []]), np.concatenate([*found, []]), False
            inner = grid[1:-1]
            here = self.corners(path(grid.ravel()))
            shaped = {name: place.reshape(*grid.shape, *place.shape[1:]) for name, place in here.items()}
            flat = {name: place[1:-1].reshape(-1, *place.shape[2:]) for name, place in shaped.items()}
            distances = self.measure(flat, pair).reshape(inner.shape)
            added, found = [*added, inner.ravel()], [*found, distances.ravel()]
            table = np.vstack([low[doubtful][None], distances, high[doubtful][None]])
            way = np.stack(
                [
                    self.way({name: place[:, i] for name, place in shaped.items()}, pair)
                    for i in range(grid.shape[1])
                ],
                axis=1,
            ).ravel()
            starts, ends = grid[:-1].ravel(), grid[1:].ravel()
            low, high = table[:-1].ravel(), table[1:].ravel()


def distance_report(
    bound: Bound, system: Any, path: Callable[[Array], Array], times: Array
) -> tuple[BoundReport, bool]:
    """How a path keeps a bound on distances, and whether what lies between the times (k,), in order, was bounded too.

    system: among its surroundings. path: times (k,) ↦ states (k, size).
    """
    around = system.surroundings
    shape = (len(around.pairs),)
    lower, size = (
        np.broadcast_to(np.asarray(side, dtype=float), shape) for side in (bound.lower, bound.sizes[0])
    )
    moments, values, bounded = Distances(system, around).along(path, times, lower - 2 * RELATIVE * size)
    batch = {DISTANCE: values[:, 0] if shape == (1,) else values}
    return check_bounds([bound], moments, batch, RELATIVE)[0], bounded


def by_fcl(fcl: Any) -> Between:
    """The distance of two hulls by the Flexible Collision Library."""
    still = fcl.Transform()

    def made(corners: Array) -> Any:
        if corners.shape[1] == 2:  # a prism, whose distance from others as high is that in the plane
            corners = np.vstack([np.pad(corners, ((0, 0), (0, 1)), constant_values=z) for z in (-1.0, 1.0)])
        count = len(corners)
        # its algorithm asks for the farthest corner only; the faces are a formality
        faces = [[3, 0, i % count, (i + 1) % count] for i in range(1, max(2, count - 1))]
        return fcl.CollisionObject(
            fcl.Convex(np.ascontiguousarray(corners), len(faces), np.array(faces).ravel()), still
        )

    def between(first: Array, second: Array) -> float:
        if len(first) < len(second):  # the library is at its best so
            first, second = second, first
        found, asked = fcl.DistanceResult(), fcl.DistanceRequest(enable_nearest_points=True)
        apart = float(fcl.distance(made(first), made(second), asked, found))
        line = np.subtract(*found.nearest_points)[: first.shape[1]]
        heights, others = first @ line, second @ line
        gap = max(heights.min() - others.max(), others.min() - heights.max())  # times |line|
        length = float(np.linalg.norm(line))
        sure = apart <= 0 or gap >= (apart - CERTAIN * max(apart, np.abs(first).max())) * length > 0
        return max(0.0, apart) if sure else by_least_squares(first, second)

    return between


def by_least_squares(first: Array, second: Array) -> float:
    """The norm of the shortest of all convex combinations of differences of corners."""
    from scipy.optimize import nnls

    differences = _differences(first, second).T
    size = np.abs(differences).max()
    if size == 0:
        return 0.0
    rows = np.vstack([differences / size, np.ones(differences.shape[1])])
    weights, _ = nnls(rows, np.append(np.zeros(len(differences)), 1.0))
    return float(np.linalg.norm(differences @ (weights / weights.sum())))


def way_out(first: Array, second: Array) -> float:
    """The shortest way that takes a hull out of another [length]; 0 where they do not overlap."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        facets = ConvexHull(_differences(first, second)).equations
    except QhullError:  # all in one plane, out of which any step leads
        return 0.0
    return max(0.0, float(-facets[:, -1].max()))


def _differences(first: Array, second: Array) -> Array:
    """Of every two corners, (n·m, d)."""
    return np.array([a - b for a, b in product(first, second)])
