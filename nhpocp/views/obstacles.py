"""Obstacles as faces: closed outlines in space or in the plane, for pictures on paper and for the animation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from nhpocp.arrays import Array
from nhpocp.bodies.hull import HalfSpace, Hull
from nhpocp.bodies.obstacles import Obstacle
from nhpocp.systems.system import System

COLOUR, EDGE = "#d9c2b4", "#8a5a44"
ROUND = 48  # corners of a disc
REACH = 0.35  # of the scene: how far an obstacle may widen it
SEEN = 0.2  # of that, of what lies behind a wall


def obstacles_of(system: System) -> tuple[Obstacle, ...]:
    """Those that a system is among."""
    return system.surroundings.obstacles if system.surroundings is not None else ()


def widened(system: System, low: Array, high: Array) -> tuple[Array, Array]:
    """Corners of a box that shows the obstacles as well, unless they are far off or large."""
    reach = REACH * float((high - low).max())
    least, most = low - reach, high + reach
    for obstacle in obstacles_of(system):
        if isinstance(obstacle.shape, Hull):
            corners = np.array(obstacle.shape.corners, dtype=float)
            low = np.minimum(low, np.maximum(corners.min(axis=0) - obstacle.shape.radius, least))
            high = np.maximum(high, np.minimum(corners.max(axis=0) + obstacle.shape.radius, most))
            continue
        normal = np.asarray(obstacle.shape.normal, dtype=float)
        nearest = np.where(normal > 0, low, high)
        height = float(normal @ (nearest - obstacle.shape.point))
        if 0 <= height < reach:
            step = (height + SEEN * reach) * normal
            low, high = low - np.maximum(step, 0), high - np.minimum(step, 0)
    return low, high


def faces(obstacle: Obstacle, low: Array, high: Array) -> list[Array]:
    """Closed outlines (n, 3) or (n, 2) of one obstacle, as far as it is within the box."""
    shape = obstacle.shape
    if isinstance(shape, HalfSpace):
        return _half(shape, low, high)
    corners = np.clip(np.array(shape.corners, dtype=float), low, high)
    if shape.rank >= 2:
        around = shape.faces if shape.dimension == 3 else (tuple(range(len(corners))),)
        return [corners[[*face, face[0]]] for face in around]
    if shape.dimension == 2:
        turns = np.linspace(0, 2 * np.pi, ROUND + 1)
        return [corners[0] + shape.radius * np.c_[np.cos(turns), np.sin(turns)]]
    return _round(corners[0], corners[-1], shape.radius)


def _round(start: Array, end: Array, radius: float, around: int = 18, half: int = 5) -> list[Array]:
    """Quadrilaterals of a ball, or of a bar with round ends."""
    axis = end - start if np.any(end != start) else np.array([0.0, 0.0, 1.0])
    axis = axis / np.linalg.norm(axis)
    first = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second, turns = np.cross(axis, first), np.linspace(0, 2 * np.pi, around + 1)
    circle = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second
    rings = [
        centre + radius * (np.sin(angle) * axis + np.cos(angle) * circle)
        for centre, (lowest, highest) in ((start, (-np.pi / 2, 0.0)), (end, (0.0, np.pi / 2)))
        for angle in np.linspace(lowest, highest, half)
    ]
    return [
        np.array([one[k], one[k + 1], other[k + 1], other[k], one[k]])
        for one, other in pairwise(rings)
        for k in range(around)
    ]


def _half(shape: HalfSpace, low: Array, high: Array) -> list[Array]:
    """In the plane what of the box lies behind the line, in space where its surface cuts the box."""
    point, normal = np.asarray(shape.point, dtype=float), np.asarray(shape.normal, dtype=float)
    if len(low) == 2:
        box = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        cut = _clipped(box, point, normal)
        return [np.vstack([cut, cut[:1]])] if len(cut) > 2 else []
    first = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second, size = np.cross(normal, first), 2 * float(np.linalg.norm(high - low))
    middle = 0.5 * (low + high)
    middle = middle - (normal @ (middle - point)) * normal
    sheet = np.array(
        [middle + size * (a * first + b * second) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    )
    for i in range(3):
        axis = np.eye(3)[i]
        for place, sign in ((high, 1.0), (low, -1.0)):
            sheet = _clipped(sheet, place, sign * axis) if len(sheet) > 2 else sheet[:0]
    return [np.vstack([sheet, sheet[:1]])] if len(sheet) > 2 else []


def _clipped(corners: Array, point: Array, normal: Array) -> Array:
    """The part of a convex polygon where normal · (x - point) ≤ 0."""
    kept: list[Array] = []
    heights = (corners - point) @ normal
    for k, (here, there) in enumerate(zip(heights, np.roll(heights, -1), strict=True)):
        if here <= 0:
            kept.append(corners[k])
        if (here <= 0) != (there <= 0):
            kept.append(corners[k] + here / (here - there) * (corners[(k + 1) % len(corners)] - corners[k]))
    return np.array(kept).reshape(-1, corners.shape[1])


def plot_obstacles(axes: Any, system: System, low: Array, high: Array) -> None:
    """All of them, behind whatever moves; light, so that one sees through."""
    for obstacle in obstacles_of(system):
        outlines = faces(obstacle, low, high)
        if len(low) == 2:
            for outline in outlines:
                axes.fill(*outline.T, facecolor=COLOUR, edgecolor=EDGE, linewidth=0.8, hatch="////", zorder=1)
            continue
        flat = isinstance(obstacle.shape, HalfSpace)
        sharp = isinstance(obstacle.shape, HalfSpace) or obstacle.shape.rank == 3
        fill = Poly3DCollection(
            outlines,
            facecolor=COLOUR,
            edgecolor=EDGE,
            linewidth=0.6 if sharp else 0.25,  # of a small ball nothing else is seen
            alpha=0.25 if flat else 0.6,
        )
        fill.set_zorder(3)
        axes.add_collection3d(fill)


def parts(system: System, low: Array, high: Array) -> list[dict[str, Any]]:
    """The obstacles as parts of an animated scene, which stand still: balls, rods, and faces of all others."""
    every: list[dict[str, Any]] = []
    for obstacle in obstacles_of(system):
        shape, named = obstacle.shape, {"name": obstacle.name, "colour": COLOUR}
        if isinstance(shape, Hull) and shape.rank < 2 and shape.dimension == 3:
            ends = [np.asarray(corner, dtype=float) for corner in shape.corners]
            for end in ends:
                rows = np.vstack([end, np.eye(3)])[None]
                every.append({**named, "kind": "ball", "radius": shape.radius, "values": rows, "exact": True})
            if len(ends) == 2:
                bar = np.array([ends])
                every.append({**named, "kind": "rod", "radius": shape.radius, "values": bar, "exact": True})
            continue
        every += [
            {**named, "kind": "surface", "values": outline[None], "exact": True}
            for outline in faces(obstacle, low, high)
        ]
    return every
