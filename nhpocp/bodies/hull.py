"""Convex bodies in space or in the plane: all points within a radius of the convex hull of some corners.

A point makes a ball or a disc, two a capsule, a polygon a plate with round rims, a box or prism stays sharp. Corners
are numbers or symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from nhpocp.arrays import Array, namespace

Pair = tuple[int, int]
FLAT = 1e-7  # of a body's size: what it is thick, or a corner stands out, by less is rounding, as of 32-bit numbers
MOST_CORNERS = 64  # of a polyhedron: its edges meet those of every body, in each of an NLP's intervals
ROUNDED = 8 * MOST_CORNERS  # with those that rounding adds: more of them are not looked at one by one
TINY = 1e-100  # keeps square roots and quotients, and two derivatives, finite where they do not count


@dataclass(frozen=True, eq=False)
class Hull:
    """The points within ``radius`` [length] of the convex hull of corners, (3,) each, or (2,) in the plane.

    edges: pairs of corners; faces: corners in order around. rank: dimension of the hull, from 0 for a point.
    directions: edges of which no two are parallel; sides: faces of which no two are. fixed: stands still whatever the
    state. touches: names of bodies that this one meets by construction. half: half lengths of a `box`, which has its
    corners in that function's order.
    """

    corners: tuple[Array, ...]
    rank: int
    edges: tuple[Pair, ...] = ()
    faces: tuple[tuple[int, ...], ...] = ()
    directions: tuple[Pair, ...] = ()
    sides: tuple[int, ...] = ()
    radius: float = 0.0
    fixed: bool = False
    touches: tuple[str, ...] = ()
    half: tuple[float, ...] = ()

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.corners[0].shape[0])

    def touching(self, *names: str) -> Hull:
        """With the names of bodies that it meets by construction."""
        return replace(self, touches=names)

    def moved(self, position: Array, rotation: Array) -> Hull:
        """Carried by a body from its own coordinates, with numbers, to those of the base."""
        xp = namespace(position, rotation)
        places = [xp.array(corner) for corner in self.corners]
        return replace(self, corners=tuple(position + rotation @ place for place in places))


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """All points x with normal · (x - point) ≤ 0; a half plane in the plane. normal: a unit vector, outwards."""

    point: Array
    normal: Array

    @property
    def dimension(self) -> int:
        return int(self.point.shape[0])


def ball(centre: Array, radius: float) -> Hull:
    """A ball, or a disc."""
    return Hull((centre,), 0, radius=radius)


def capsule(start: Array, end: Array, radius: float) -> Hull:
    """A round bar with round ends."""
    return Hull((start, end), 1, ((0, 1),), directions=((0, 1),), radius=radius)


def polygon(corners: Sequence[Array], radius: float = 0.0) -> Hull:
    """A convex polygon, its corners in order: in the plane, or a plate in space, ``radius`` to each side."""
    count = len(corners)
    if count < 3:
        return capsule(corners[0], corners[1], radius) if count == 2 else ball(corners[0], radius)
    around = tuple((i, (i + 1) % count) for i in range(count))
    return Hull(tuple(corners), 2, around, (tuple(range(count)),), around, (0,), radius)


def box(centre: Array, rotation: Array, half: Sequence[float]) -> Hull:
    """A box with these half lengths along its own axes, the columns of its rotation; in the plane a rectangle."""
    if len(half) == 2:
        ahead, left = half[0] * rotation[:, 0], half[1] * rotation[:, 1]
        corners = [centre + a * ahead + b * left for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        return replace(polygon(corners), half=tuple(map(float, half)))
    first, second = half[0] * rotation[:, 0], half[1] * rotation[:, 1]
    outline = [centre + a * first + b * second for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return replace(
        prism(outline, half[2] * rotation[:, 2]),
        directions=((0, 1), (1, 2), (0, 4)),
        sides=(0, 2, 3),
        half=tuple(map(float, half)),
    )


def prism(outline: Sequence[Array], half: Array) -> Hull:
    """The body between a polygon moved by ``half`` and by ``-half``."""
    count = len(outline)
    corners = [corner + half for corner in outline] + [corner - half for corner in outline]
    around = [(i, (i + 1) % count) for i in range(count)]
    edges = (*around, *((count + i, count + j) for i, j in around), *((i, count + i) for i in range(count)))
    walls = tuple((i, j, count + j, count + i) for i, j in around)
    faces = (tuple(range(count)), tuple(range(count, 2 * count)), *walls)
    return Hull(tuple(corners), 3, edges, faces, (*around, (0, count)), (0, *range(2, 2 + count)))


def polyhedron(points: Any, radius: float = 0.0) -> Hull:
    """The convex hull of points with numbers, (n, 3), that do not lie in a plane.

    Errors: `ValueError` where it has more than `MOST_CORNERS` corners.
    """
    import numpy as np
    from scipy.spatial import ConvexHull

    points = np.asarray(points, dtype=float)
    hull = ConvexHull((points - points.mean(axis=0)) / np.ptp(points, axis=0).max())
    outer = _standing_out(hull) if len(hull.vertices) <= ROUNDED else hull.vertices
    if len(outer) > MOST_CORNERS:
        raise ValueError(
            f"the convex hull has {len(outer)} corners; at most {MOST_CORNERS} can be kept clear of. "
            "Export a coarser mesh"
        )
    if len(outer) < len(hull.vertices):
        return hull_of(points[outer], 2 * radius)  # which may be flat
    used = {int(old): new for new, old in enumerate(hull.vertices)}
    planes = hull.equations
    members: dict[int, set[int]] = {}
    firsts = _first_alike(np.abs(planes[:, None] - planes).max(axis=2))
    for simplex, k in zip(hull.simplices, firsts, strict=True):
        members.setdefault(k, set()).update(used[int(i)] for i in simplex)
    corners = points[hull.vertices]
    faces = tuple(_around(corners, sorted(face), planes[k, :3]) for k, face in members.items())
    pairs = {
        (min(i, j), max(i, j)) for face in faces for i, j in zip(face, (*face[1:], face[0]), strict=True)
    }
    edges = tuple(sorted(pairs))
    lines = np.array([corners[j] - corners[i] for i, j in edges])
    directions = tuple(edges[k] for k in _unlike(lines))
    sides = tuple(_unlike(planes[list(members), :3]))
    return Hull(tuple(corners), 3, edges, faces, directions, sides, radius)


def hull_of(points: Any, thickness: float = 0.0) -> Hull:
    """The convex hull of points with numbers, (n, 3): a ball, a bar or a plate of a thickness, or a polyhedron.

    Corners that stand out by less than `FLAT` are left out, for the faces beside them would have any normal.
    """
    import numpy as np

    points = np.unique(np.asarray(points, dtype=float), axis=0)
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    places = (points - middle) @ axes.T
    extents = np.ptp(places, axis=0)
    rank = int(np.sum(extents > FLAT * max(float(extents[0]), TINY)))
    radius = 0.5 * thickness
    if rank == 0:
        return ball(middle, radius)
    if rank == 1:
        return capsule(points[np.argmin(places[:, 0])], points[np.argmax(places[:, 0])], radius)
    if rank == 3:
        return polyhedron(points, radius)
    around = range(3)
    if len(points) > 3:
        from scipy.spatial import ConvexHull

        around = _standing_out(ConvexHull(places[:, :2] / extents[0]))
    return polygon([points[i] for i in around], radius)


def solid(points: Any) -> Hull:
    """The polyhedron around points with numbers, (n, 3).

    Errors: `ValueError` where they lie in a plane, or it has more than `MOST_CORNERS` corners.
    """
    hull = hull_of(points)
    if hull.rank < 3:
        raise ValueError("the points lie in a plane, and bound no body")
    return hull


def _standing_out(hull: Any) -> Array:
    """The corners of Qhull's hull of a body of size 1, in its order, less those within `FLAT` of the others' hull."""
    import numpy as np
    from scipy.optimize import nnls

    points, kept = hull.points, hull.vertices
    for k in hull.vertices:
        others = kept[kept != k]
        rows = np.vstack([(points[others] - points[k]).T, np.ones(len(others))])
        _, away = nnls(rows, np.eye(len(rows))[-1])  # [Lawson & Hanson, ch. 23]
        if away < FLAT:  # how far it is, of what is near
            kept = others
    return kept


def _around(corners: Array, face: Sequence[int], normal: Array) -> tuple[int, ...]:
    """Corners of a face in order about its normal."""
    import numpy as np

    places = corners[list(face)] - corners[list(face)].mean(axis=0)
    first = places[0] / np.linalg.norm(places[0])
    angles = np.arctan2(places @ np.cross(normal, first), places @ first)
    return tuple(face[k] for k in np.argsort(angles))


def _unlike(vectors: Array) -> list[int]:
    """Places of vectors of which no two are parallel."""
    import numpy as np

    units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    firsts = _first_alike(np.linalg.norm(np.cross(units[:, None], units), axis=2))
    return [k for k, first in enumerate(firsts) if first == k]


def _first_alike(differences: Array) -> list[int]:
    """Of each, by their differences (n, n), the first that it is alike among those that are unlike each other."""
    chosen: list[int] = []
    firsts: list[int] = []
    for k, alike in enumerate(differences < 1e-9):
        first = next((i for i in chosen if alike[i]), k)
        if first == k:
            chosen.append(k)
        firsts.append(first)
    return firsts
