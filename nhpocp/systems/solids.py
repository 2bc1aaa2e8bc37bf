"""Bodies and lines that show how a body is turned, for the drawings of several systems."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Any

from nhpocp.arrays import Array, cross, dot, namespace, norm, unit

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


def disc(centre: Array, axle: Array, radius: float) -> Array:
    """A wheel's face, perpendicular to the unit vector of its axle, closed, (25, 3)."""
    xp = namespace(centre, axle)
    first = unit(cross(axle, xp.array([1.0, 0.0, 0.0] if abs(axle[0]) < 0.9 else [0.0, 1.0, 0.0])))
    second = cross(axle, first)
    angles = [k * 2 * pi / 24 for k in range(24)]
    around = [centre + radius * (cos(a) * first + sin(a) * second) for a in angles]
    return xp.rows([*around, around[0]])


def cuboid(centre: Array, rotation: Array, half: Sequence[float]) -> dict[str, Array]:
    """The faces of a body with these half lengths along its own axes, "face 1" (ahead on the first) to "face 6"."""
    xp, faces = namespace(centre, rotation), {}
    sides = [half[i] * rotation[:, i] for i in range(3)]
    for i in range(3):
        first, second = sides[(i + 1) % 3], sides[(i + 2) % 3]
        for k, sign in enumerate((1, -1)):
            corners = [
                centre + sign * sides[i] + a * first + b * second
                for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
            ]
            faces[f"face {2 * i + k + 1}"] = xp.rows([*corners, corners[0]])
    return faces


def ball(centre: Array, rotation: Array, radius: float, *replaces: str) -> dict[str, Any]:
    """A solid ball that shows how it is turned, for `System.drawing`."""
    return {"centre": centre, "rotation": rotation, "radius": radius, "replaces": replaces}


def rod(start: Array, end: Array, radius: float, *replaces: str) -> dict[str, Any]:
    """A solid round bar, for `System.drawing`."""
    return {"ends": namespace(start, end).rows([start, end]), "radius": radius, "replaces": replaces}


def roller(centre: Array, r: Array, towards: Array, radius: float) -> dict[str, Any]:
    """The wheel that touches a ball of this radius on the side ``towards``, and keeps it from turning about r.

    Its axle is perpendicular to r and to the line of contact: there the ball slides along r with the wheel's rim only.
    """
    side = towards - dot(towards, r) * r
    if norm(side) < 1e-6:  # the side asked for lies on r itself: any other will do
        side = cross(r, namespace(r).array([1.0, 0.0, 0.0] if abs(r[0]) < 0.9 else [0.0, 1.0, 0.0]))
    side = unit(side)
    axle, wheel = cross(r, side), 0.5 * radius
    middle = centre + (radius + wheel) * side
    return rod(middle - 0.3 * wheel * axle, middle + 0.3 * wheel * axle, wheel)


def joint_solids(rotation: Array, r: Array, towards: Array) -> dict[str, Any]:
    """A non-holonomic ball joint at the origin: its ball, its own axes as bars, and the roller that holds it."""
    origin = namespace(rotation).array([0.0, 0.0, 0.0])
    bars = {f"axis {i + 1}": rod(origin, rotation[:, i], 0.025) for i in range(3)}
    return {"ball": ball(origin, rotation, 0.45), "roller": roller(origin, r, towards, 0.45), **bars}
