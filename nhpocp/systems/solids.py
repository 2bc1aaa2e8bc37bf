"""Lines that show how a body is turned, for the drawings of several systems."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

from nhpocp.arrays import Array, namespace, unit

OVERLAP = 0.1  # [rad] by which a circle is drawn beyond a full turn: an open line, which pictures do not fill


def body_axes(centre: Array, rotation: Array, length: float) -> dict[str, Array]:
    """ "axis 1" to "axis 3", the body's own axes from its centre, (2, 3) each."""
    xp = namespace(centre, rotation)
    return {f"axis {i + 1}": xp.rows([centre, centre + length * rotation[:, i]]) for i in range(3)}


def facet(centre: Array, rotation: Array, length: float, bend: int = 1) -> Array:
    """The closed triangle of the axes' tips, its sides in ``bend`` parts on their sphere, (3 bend + 1, 3)."""
    xp = namespace(centre, rotation)
    corners: list[Any] = []
    for i in range(3):
        first, second = rotation[:, i], rotation[:, (i + 1) % 3]
        corners += [centre + length * unit((bend - k) * first + k * second) for k in range(bend)]
    return xp.rows([*corners, corners[0]])


def great_circle(centre: Array, rotation: Array, axis: int, radius: float) -> Array:
    """The circle perpendicular to a body's axis, (n, 3)."""
    xp = namespace(centre, rotation)
    first, second = rotation[:, (axis + 1) % 3], rotation[:, (axis + 2) % 3]
    angles = [k * (2 * pi + OVERLAP) / 64 for k in range(65)]
    return xp.rows([centre + radius * (cos(a) * first + sin(a) * second) for a in angles])
