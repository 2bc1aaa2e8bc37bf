"""Machines in the plane, seen from above: headings, bodies and wheels, for the drawings of several systems."""

from __future__ import annotations

from collections.abc import Sequence

from nhpocp.arrays import Array, namespace

NOSE = [
    (1.2, 0.0),
    (0.5, 0.5),
    (-0.7, 0.5),
    (-0.7, -0.5),
    (0.5, -0.5),
    (1.2, 0.0),
]  # a body that points ahead
WHEEL = 0.18  # half of a drawn wheel, in lengths of its vehicle


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


def wheels(
    name: str, here: Array, heading: Array, half: float, size: float, steer: Array = 0.0
) -> dict[str, Array]:
    """The two wheels of an axle, "left name" and "right name": ``half`` to each side, turned by ``steer`` [rad]."""
    left = across(heading)
    return {
        f"{which} {name}": outline(
            here + side * half * left, heading + steer, [(-WHEEL, 0.0), (WHEEL, 0.0)], size
        )
        for which, side in (("left", 1), ("right", -1))
    }
