"""Machines in the plane, seen from above: headings, bodies, wheels and links, for the drawings of several systems."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

from nhpocp.arrays import Array, namespace, norm
from nhpocp.bodies.hull import Hull, polygon

NOSE = [
    (1.2, 0.0),
    (0.5, 0.5),
    (-0.7, 0.5),
    (-0.7, -0.5),
    (0.5, -0.5),
    (1.2, 0.0),
]  # a body that points ahead
WHEEL, TYRE = 0.18, 0.05  # half of a drawn wheel along and across, in lengths of its vehicle


def along(heading: Array) -> Array:
    """The unit vector (2,) of a heading [rad] from the x axis."""
    xp = namespace(heading)
    return xp.vector([xp.cos(heading), xp.sin(heading)])


def across(heading: Array) -> Array:
    """The unit vector (2,) to the left of a heading [rad]."""
    xp = namespace(heading)
    return xp.vector([-xp.sin(heading), xp.cos(heading)])


def outline(here: Array, heading: Array, corners: Sequence[tuple[float, float]], size: float = 1.0) -> Array:
    """The corners of a body (n, 2), given ahead and to the left of ``here``, in multiples of ``size``."""
    ahead, left = along(heading), across(heading)
    return namespace(here, heading).rows([here + size * (a * ahead + b * left) for a, b in corners])


def box(back: float, front: float, half: float) -> list[tuple[float, float]]:
    """The closed rectangle from ``back`` to ``front`` of a body and ``half`` to each side."""
    return [(back, half), (front, half), (front, -half), (back, -half), (back, half)]


def vehicle(name: str, here: Array, heading: Array, wheelbase: float, size: float) -> dict[str, Array]:
    """A body with a bonnet and a windscreen, from its rear axle ``here`` ahead to over a front axle or bearing.

    wheelbase: between the two, in multiples of ``size``.
    """
    bonnet = [
        (wheelbase + 0.1, 0.22),
        (wheelbase + 0.35, 0.14),
        (wheelbase + 0.35, -0.14),
        (wheelbase + 0.1, -0.22),
    ]
    window = [
        (wheelbase - 0.25, 0.15),
        (wheelbase - 0.05, 0.19),
        (wheelbase - 0.05, -0.19),
        (wheelbase - 0.25, -0.15),
    ]
    body = [(-0.25, 0.22), *bonnet, (-0.25, -0.22), (-0.25, 0.22)]
    return {
        name: outline(here, heading, body, size),
        "window": outline(here, heading, [*window, window[0]], size),
    }


def footprint(here: Array, heading: Array, corners: Sequence[tuple[float, float]], size: float = 1.0) -> Hull:
    """The convex body within the closed line of `outline`."""
    ahead, left = along(heading), across(heading)
    return polygon([here + size * (a * ahead + b * left) for a, b in corners[:-1]])


def vehicle_footprint(here: Array, heading: Array, wheelbase: float, size: float) -> Hull:
    """What `vehicle` and its `wheels`, those in front straight ahead, take up."""
    front, half = wheelbase + 0.35, 0.28
    corners = [(-0.25, half), (wheelbase + WHEEL, half), (front, 0.14)]
    corners += [(a, -b) for a, b in reversed(corners)]
    return footprint(here, heading, [*corners, corners[0]], size)


def wheel(here: Array, heading: Array, size: float) -> Array:
    """A wheel from above, (5, 2)."""
    return outline(here, heading, box(-WHEEL, WHEEL, TYRE), size)


def wheels(
    name: str, here: Array, heading: Array, half: float, size: float, steer: Array = 0.0
) -> dict[str, Array]:
    """The two wheels of an axle, "left name" and "right name": ``half`` to each side, turned by ``steer`` [rad]."""
    left = across(heading)
    return {
        f"{which} {name}": wheel(here + side * half * left, heading + steer, size)
        for which, side in (("left", 1), ("right", -1))
    }


def link(start: Array, end: Array, half: float) -> Array:
    """A bar with round ends about two joints, ``half`` to each side, (n, 2)."""
    xp = namespace(start, end)
    ahead = (end - start) / norm(end - start)
    left = xp.vector([-ahead[1], ahead[0]])
    turns = [k * pi / 8 for k in range(9)]
    corners = [end + half * (sin(a) * ahead + cos(a) * left) for a in turns]
    corners += [start - half * (sin(a) * ahead + cos(a) * left) for a in turns]
    return xp.rows([*corners, corners[0]])
