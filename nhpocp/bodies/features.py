"""Parts of the formulas of distances: the least of several numbers, and the distance of a point from a segment."""

from __future__ import annotations

from nhpocp.arrays import Array, dot, namespace
from nhpocp.bodies.hull import TINY

FAR = 1e30  # squared, of what is no candidate
PARALLEL = 1e-14  # sin² of the angle below which two directions make no axis


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


def of_point(point: Array, start: Array, end: Array) -> Array:
    """The squared distance of a point from a segment."""
    along = end - start
    share = clamped(dot(point - start, along) / namespace(along, point).maximum(size_squared(along), TINY))
    return size_squared(point - start - share * along)


def clamped(share: Array) -> Array:
    xp = namespace(share)
    return xp.minimum(xp.maximum(share, 0.0), 1.0)


def size_squared(vector: Array) -> Array:
    return dot(vector, vector)
