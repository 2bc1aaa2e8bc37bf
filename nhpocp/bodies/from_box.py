"""How far a convex hull is from a box, looked at along the box's own axes, where its shadow and its inside are short
formulas."""

from __future__ import annotations

from collections.abc import Iterator

from nhpocp.arrays import Array, cross, dot, namespace
from nhpocp.bodies.features import FAR, PARALLEL, clamped, greatest, least, of_point, size_squared
from nhpocp.bodies.hull import TINY, Hull

Half = tuple[float, ...]


def from_box(hull: Hull, box: Hull) -> tuple[Array, Array]:
    """The squared distance of two hulls, radii apart, and how far the axes that may separate them hold them apart.

    box: one that `hull.box` made, wherever it was moved. The second is negative where they overlap, [Ericson, ch. 5].
    """
    corners, half = _seen(hull, box), box.half
    placed = Hull(corners, hull.rank, hull.edges, hull.faces, hull.directions, hull.sides)
    candidates = _in_the_plane(placed, half) if hull.dimension == 2 else _in_space(placed, half)
    return least(list(candidates)), greatest(list(_gaps(placed, half)))


def _seen(hull: Hull, box: Hull) -> tuple[Array, ...]:
    """The hull's corners along the box's axes from its middle."""
    c, half = box.corners, box.half
    pairs = [(0, 1), (1, 2), (0, 4)][: len(half)]
    xp = namespace(*c)
    axes = xp.rows([(c[i] - c[j]) / (2 * h) for (i, j), h in zip(pairs, half, strict=True)])
    middle = 0.5 * (c[0] + c[2 if len(half) == 2 else 6])
    return tuple(axes @ (corner - middle) for corner in hull.corners)


def _in_the_plane(hull: Hull, half: Half) -> Iterator[Array]:
    """Of corners from the rectangle, and of its corners from edges."""
    yield from (_of_corner(corner, half) for corner in hull.corners)
    xp = namespace(*hull.corners)
    for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        corner = xp.array([a * half[0], b * half[1]])
        yield from (of_point(corner, hull.corners[i], hull.corners[j]) for i, j in hull.edges)


def _in_space(hull: Hull, half: Half) -> Iterator[Array]:
    """Of edges from the box, and of its corners from faces."""
    if not hull.edges:
        yield from (_of_corner(corner, half) for corner in hull.corners)
    yield from (_of_edge(hull.corners[i], hull.corners[j], half) for i, j in hull.edges)
    for face in hull.faces:
        yield _of_face([hull.corners[i] for i in face], half)


def _of_corner(corner: Array, half: Half) -> Array:
    outside = [_outside(corner[k], h) for k, h in enumerate(half)]
    return _sum([each * each for each in outside])


def _outside(place: Array, half: float) -> Array:
    """By how much a coordinate is beyond the box; 0 within."""
    xp = namespace(place)
    return place - xp.minimum(xp.maximum(place, -half), half)


def _sum(values: list[Array]) -> Array:
    total = values[0]
    for value in values[1:]:
        total = total + value
    return total


def _of_edge(start: Array, end: Array, half: Half) -> Array:
    """Of a segment x(t), 0 ≤ t ≤ 1: where the slope of the convex function d²(t) is zero, or an end.

    The slope is piecewise linear, and its knots are where a coordinate passes ± half: it is zero between the last knot
    at which it is not positive and the first at which it is not negative.
    """
    along = end - start
    xp = namespace(along, start)
    terms = [(start[k], along[k], h) for k, h in enumerate(half)]

    def slope(t: Array) -> Array:
        return _sum([d * _outside(p + t * d, h) for p, d, h in terms])

    first, last = xp.minimum(slope(0.0), 0.0), xp.maximum(slope(1.0), 0.0)
    below: list[Array] = [0.0]
    above: list[Array] = [1.0]
    rising, falling = [last], [first]
    for p, d, h in terms:
        inverse = 1.0 / xp.where(d * d > TINY, d, 1.0)
        for side in (-h, h):
            knot = clamped((side - p) * inverse)
            value = slope(knot)
            below.append(xp.where(value <= 0, knot, 0.0))
            falling.append(xp.where(value <= 0, value, first))
            above.append(xp.where(value >= 0, knot, 1.0))
            rising.append(xp.where(value >= 0, value, last))
    low, high, down, up = greatest(below), least(above), greatest(falling), least(rising)
    t = low + (high - low) * down / xp.minimum(down - up, -TINY)
    return _of_corner(start + t * along, half)


def _of_face(places: list[Array], half: Half) -> Array:
    """Of the corner that is nearest to the plane of a face; far where it does not lie over the face."""
    normal = cross(places[1] - places[0], places[2] - places[1])
    xp = namespace(normal)
    height = dot(normal, places[0])
    side = xp.where(height > 0, 1.0, -1.0)
    corner = xp.vector([side * xp.sign(normal[k]) * h for k, h in enumerate(half)])
    walls = [cross(normal, end - start) for start, end in zip(places, (*places[1:], places[0]), strict=True)]
    over = least([dot(wall, corner - start) for wall, start in zip(walls, places, strict=True)])
    above = dot(normal, corner) - height
    return xp.where(over >= 0, above * above / xp.maximum(size_squared(normal), TINY), FAR)


def _gaps(hull: Hull, half: Half) -> Iterator[Array]:
    """How far the shadows are apart along each axis that may separate the two; negative where they overlap."""
    for k, h in enumerate(half):
        places = [corner[k] for corner in hull.corners]
        yield greatest([least(places), -greatest(places)]) - h
    for axis, scale in _axes(hull):
        xp, squared = namespace(axis), size_squared(axis)
        places = [dot(axis, corner) for corner in hull.corners]
        shadow = _sum([h * xp.abs(axis[k]) for k, h in enumerate(half)])
        gap = greatest([least(places), -greatest(places)]) - shadow
        counts = squared > PARALLEL * scale
        yield xp.where(counts, gap / xp.sqrt(xp.where(counts, squared, 1.0)), -FAR)


def _axes(hull: Hull) -> Iterator[tuple[Array, Array]]:
    """Normals of the hull's sides, and of its edges and the box's, with what their squared length is at most."""
    lines = [hull.corners[j] - hull.corners[i] for i, j in hull.directions]
    if hull.dimension == 2:
        yield from ((namespace(line).vector([-line[1], line[0]]), size_squared(line)) for line in lines)
        return
    for k in hull.sides:
        a, b, c = (hull.corners[i] for i in hull.faces[k][:3])
        yield cross(b - a, c - b), size_squared(b - a) * size_squared(c - b)
    for line in lines:
        xp, scale = namespace(line), size_squared(line)
        yield xp.vector([0.0, -line[2], line[1]]), scale
        yield xp.vector([line[2], 0.0, -line[0]]), scale
        yield xp.vector([-line[1], line[0], 0.0]), scale
