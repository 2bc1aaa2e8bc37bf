"""The signed distance of two convex bodies, for numbers and symbols alike: what solvers differentiate.

Outside it is exact: the least distance of two corners, a corner and an edge, two edges, or a corner and a face. Where
the hulls overlap it is minus the shortest way out, by the separating axes [Ericson, ch. 5], less both radii. It is
smooth but where two features are equally near, two edges are parallel, or two legs' axes meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from nhpocp.arrays import Array, Namespace, cross, dot, namespace
from nhpocp.bodies.hull import TINY, HalfSpace, Hull

FAR = 1e30  # squared, of what is no candidate
# of the distance of two features, which is no more than the way out where hulls overlap: less is rounding, as of plates
# that lie in one plane
SHALLOW = 0.5
PARALLEL = 1e-14  # sin² of the angle below which two directions make no axis


def distance(first: Hull, second: Hull | HalfSpace) -> Array:
    """The signed distance [length] of two bodies; negative where they overlap."""
    xp = namespace(*first.corners, *(() if isinstance(second, HalfSpace) else second.corners))
    if isinstance(second, HalfSpace):
        point, normal = xp.array(second.point), xp.array(second.normal)
        return least([dot(normal, corner - point) for corner in first.corners]) - first.radius
    first, second = (replace(hull, corners=tuple(map(_of(xp), hull.corners))) for hull in (first, second))
    squared = least([*_of_edges(first, second), *_of_corners(first, second), *_of_corners(second, first)])
    apart = xp.sqrt(xp.maximum(squared, TINY))
    if first.rank + second.rank >= first.dimension:
        gap = greatest(list(_gaps(first, second)))
        apart = xp.where(gap > -SHALLOW * apart, apart, gap)
    return apart - (first.radius + second.radius)


def _of(xp: Namespace) -> Callable[[Array], Array]:
    """Makes numbers those of CasADi where symbols are among the operands."""
    return lambda corner: xp.array(corner) if namespace(corner) is not xp else corner


def least(values: list[Array]) -> Array:
    """The least of several numbers or symbols, two by two."""
    xp = namespace(*values)
    while len(values) > 1:
        rest = values[-1:] if len(values) % 2 else []
        values = [xp.minimum(a, b) for a, b in zip(values[0::2], values[1::2], strict=False)] + rest
    return values[0]


def greatest(values: list[Array]) -> Array:
    """The greatest of several."""
    return -least([-value for value in values])


def _of_edges(first: Hull, second: Hull) -> Iterator[Array]:
    """Squared distances of edges, those of a point being itself; in the plane of corners and edges, which suffice."""
    if first.dimension == 2:
        for one, other in ((first, second), (second, first)):
            for corner in one.corners:
                for i, j in other.edges:
                    yield _of_point(corner, other.corners[i], other.corners[j])
        if not (first.edges or second.edges):
            yield _squared(first.corners[0] - second.corners[0])
        return
    for a, b in first.edges or ((0, 0),):
        for c, d in second.edges or ((0, 0),):
            p, q, r, s = first.corners[a], first.corners[b], second.corners[c], second.corners[d]
            if a == b:
                yield _squared(p - r) if c == d else _of_point(p, r, s)
            else:
                yield _of_point(r, p, q) if c == d else _of_segments(p, q, r, s)


def _squared(vector: Array) -> Array:
    return dot(vector, vector)


def _of_point(point: Array, start: Array, end: Array) -> Array:
    """The squared distance of a point from a segment."""
    along = end - start
    share = _clamped(dot(point - start, along) / namespace(along, point).maximum(_squared(along), TINY))
    return _squared(point - start - share * along)


def _of_segments(p: Array, q: Array, r: Array, s: Array) -> Array:
    """The squared distance of two segments. [Ericson, section 5.1.9]"""
    u, v, w = q - p, s - r, p - r
    xp = namespace(u, v)
    a, e, b = _squared(u), _squared(v), dot(u, v)
    c, f = dot(u, w), dot(v, w)
    safe_a, safe_e = xp.maximum(a, TINY), xp.maximum(e, TINY)
    turned = a * e - b * b
    crossing = turned > PARALLEL * a * e
    wanted = b * f - c * e
    ends = xp.where(wanted > 0, 1.0, 0.0)  # of parallel segments
    along = xp.where(crossing, _clamped(wanted / xp.where(crossing, turned, 1.0)), ends)
    across = (b * along + f) / safe_e
    below, above = across < 0, across > 1
    along = xp.where(below, _clamped(-c / safe_a), xp.where(above, _clamped((b - c) / safe_a), along))
    return _squared(w + along * u - _clamped(across) * v)


def _clamped(share: Array) -> Array:
    xp = namespace(share)
    return xp.minimum(xp.maximum(share, 0.0), 1.0)


def _of_corners(hull: Hull, other: Hull) -> Iterator[Array]:
    """Squared distances of corners from the insides of the other's faces; far where they do not lie over them."""
    if hull.dimension == 2:
        return
    for face in other.faces:
        places = [other.corners[i] for i in face]
        normal = cross(places[1] - places[0], places[2] - places[1])
        xp = namespace(normal)
        size = xp.maximum(_squared(normal), TINY)
        walls = [
            cross(normal, end - start) for start, end in zip(places, (*places[1:], places[0]), strict=True)
        ]
        for corner in hull.corners:
            over = least([dot(wall, corner - start) for wall, start in zip(walls, places, strict=True)])
            height = dot(normal, corner - places[0])
            yield namespace(height, over).where(over >= 0, height * height / size, FAR)


def _gaps(first: Hull, second: Hull) -> Iterator[Array]:
    """How far the hulls are apart along each axis that may separate them; negative where their shadows overlap."""
    for axis, scale in _axes(first, second):
        xp = namespace(axis, *first.corners, *second.corners)
        squared = _squared(axis)
        counts = squared > PARALLEL * scale
        mine = [dot(axis, corner) for corner in first.corners]
        its = [dot(axis, corner) for corner in second.corners]
        gap = greatest([least(mine) - greatest(its), least(its) - greatest(mine)])
        yield xp.where(counts, gap / xp.sqrt(xp.where(counts, squared, 1.0)), -FAR)


def _axes(first: Hull, second: Hull) -> Iterator[tuple[Array, Array]]:
    """Normals of sides and common normals of edges, with what their squared length is at most."""
    if first.dimension == 2:
        for hull in (first, second):
            for i, j in hull.directions:
                along = hull.corners[j] - hull.corners[i]
                yield namespace(along).vector([-along[1], along[0]]), _squared(along)
        return
    edges: list[list[Array]] = []
    for hull in (first, second):
        lines = [hull.corners[j] - hull.corners[i] for i, j in hull.directions]
        for k in hull.sides:
            a, b, c = (hull.corners[i] for i in hull.faces[k][:3])
            normal = cross(b - a, c - b)
            yield normal, _squared(b - a) * _squared(c - b)
        edges.append(lines)
    for one in edges[0]:
        for other in edges[1]:
            yield cross(one, other), _squared(one) * _squared(other)
