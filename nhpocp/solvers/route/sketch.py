"""Routes and trees as plain data, as a solution keeps them for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.route.route import Route
from nhpocp.solvers.route.rrt_connect import Trees

MOST = 200  # poses of a tree that are kept
DIGITS = 6  # of the numbers of a tree's poses


def sketched_route(route: Route) -> list[list[float]]:
    """The waypoints, packed poses, start and goal among them."""
    return [[float(number) for number in pose] for pose in route.waypoints]


def sketched_trees(trees: Trees) -> dict[str, Any]:
    """Of the trees from start and goal some poses, the root first, and of each the place of the one it grew from.

    grown: how many poses there are in all.
    """
    both = {"start": (trees.start, trees.parents[0]), "goal": (trees.goal, trees.parents[1])}
    return {name: _sketched(*tree) for name, tree in both.items()}


def _sketched(poses: Array, parents: Array) -> dict[str, Any]:
    chosen = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST)).round().astype(int))
    places = {int(number): place for place, number in enumerate(chosen)}

    def kept_before(number: int) -> int:
        """The nearest pose that is kept on the way to the root, the root itself being its own."""
        before = int(parents[number])
        while before not in places and before != number:
            number, before = before, int(parents[before])
        return places.get(before, 0)

    return {
        "poses": [[float(f"{number:.{DIGITS}g}") for number in pose] for pose in poses[chosen]],
        "parents": [kept_before(int(number)) for number in chosen],
        "grown": len(poses),
    }
