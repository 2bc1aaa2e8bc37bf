"""The signed distance of two convex bodies, for numbers and symbols alike: what solvers differentiate.

Outside it is exact: the least distance of two corners, a corner and an edge, two edges, or a corner and a face. Where
the hulls overlap it is minus the shortest way out, by the separating axes [Ericson, ch. 5], less both radii. It is
smooth but where two features are equally near, two edges are parallel, or two legs' axes meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from nhpocp.arrays import Array, Namespace, cross, dot, namespace
from nhpocp.bodies.features import FAR, PARALLEL, clamped, greatest, least, of_point, size_squared
from nhpocp.bodies.from_box import from_box
from nhpocp.bodies.hull import TINY, HalfSpace, Hull

# of the distance of two features, which is no more than the way out where hulls overlap: less is rounding, as of plates
# that lie in one plane
SHALLOW = 0.5


def distance(first: Hull, second: Hull | HalfSpace) -> Array:
    """The signed distance [length] of two bodies; negative where they overlap."""
    xp = namespace(*first.corners, *(() if isinstance(second, HalfSpace) else second.corners))
    if isinstance(second, HalfSpace):
        point, normal = xp.array(second.point), xp.array(second.normal)
        return least([dot(normal, corner - point) for corner in first.corners]) - first.radius
    first, second = (replace(hull, corners=tuple(map(_of(xp), hull.corners))) for hull in (first, second))
    radius = first.radius + second.radius
    if first.half and not second.half:
        first, second = second, first
    if second.half:
        squared, gap = from_box(first, second)
    else:
        squared = least([*_of_edges(first, second), *_of_corners(first, second), *_of_corners(second, first)])
        meeting = first.rank + second.rank >= first.dimension
        gap = greatest(list(_gaps(first, second))) if meeting else None
    apart = xp.sqrt(xp.maximum(squared, TINY))
    return (apart if gap is None else xp.where(gap > -SHALLOW * apart, apart, gap)) - radius


def _of(xp: Namespace) -> Callable[[Array], Array]:
    """Makes numbers those of CasADi where symbols are among the operands."""
    return lambda corner: xp.array(corner) if namespace(corner) is not xp else corner


def _of_edges(first: Hull, second: Hull) -> Iterator[Array]:
    """Squared distances of edges, those of a point being itself; in the plane of corners and edges, which suffice."""
    if first.dimension == 2:
        for one, other in ((first, second), (second, first)):
            for corner in one.corners:
                for i, j in other.edges:
                    yield of_point(corner, other.corners[i], other.corners[j])
        if not (first.edges or second.edges):
            yield size_squared(first.corners[0] - second.corners[0])
        return
    for a, b in first.edges or ((0, 0),):
        for c, d in second.edges or ((0, 0),):
            p, q, r, s = first.corners[a], first.corners[b], second.corners[c], second.corners[d]
            if a == b:
                yield size_squared(p - r) if c == d else of_point(p, r, s)
            else:
                yield of_point(r, p, q) if c == d else _of_segments(p, q, r, s)


def _of_segments(p: Array, q: Array, r: Array, s: Array) -> Array:
    """The squared distance of two segments. [Ericson, section 5.1.9]"""
    u, v, w = q - p, s - r, p - r
    xp = namespace(u, v)
    a, e, b = size_squared(u), size_squared(v), dot(u, v)
    c, f = dot(u, w), dot(v, w)
    safe_a, safe_e = xp.maximum(a, TINY), xp.maximum(e, TINY)
    turned = a * e - b * b
    crossing = turned > PARALLEL * a * e
    wanted = b * f - c * e
    ends = xp.where(wanted > 0, 1.0, 0.0)  # of parallel segments
    along = xp.where(crossing, clamped(wanted / xp.where(crossing, turned, 1.0)), ends)
    across = (b * along + f) / safe_e
    below, above = across < 0, across > 1
    along = xp.where(below, clamped(-c / safe_a), xp.where(above, clamped((b - c) / safe_a), along))
    return size_squared(w + along * u - clamped(across) * v)


def _of_corners(hull: Hull, other: Hull) -> Iterator[Array]:
    """Squared distances of corners from the insides of the other's faces; far where they do not lie over them."""
    if hull.dimension == 2:
        return
    for face in other.faces:
        places = [other.corners[i] for i in face]
        normal = cross(places[1] - places[0], places[2] - places[1])
        xp = namespace(normal)
        size = xp.maximum(size_squared(normal), TINY)
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
        squared = size_squared(axis)
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
                yield namespace(along).vector([-along[1], along[0]]), size_squared(along)
        return
    edges: list[list[Array]] = []
    for hull in (first, second):
        lines = [hull.corners[j] - hull.corners[i] for i, j in hull.directions]
        for k in hull.sides:
            a, b, c = (hull.corners[i] for i in hull.faces[k][:3])
            normal = cross(b - a, c - b)
            yield normal, size_squared(b - a) * size_squared(c - b)
        edges.append(lines)
    for one in edges[0]:
        for other in edges[1]:
            yield cross(one, other), size_squared(one) * size_squared(other)
