"""The end-point error e = (p_T - p_d, r_T) of [Paper] eq. (8), the via poses' errors above it."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.flow.end_point_map import EndPoint
from nhpocp.problem import PlanningProblem


class EndPointError:
    """e of every task along one path and E, their norm with the problem's weights.

    e and J, for the linear algebra, are dimensionless. Errors: where an orientation is opposite to its goal, e and E
    are an `OrientationAtPiError`.
    """

    def __init__(self, problem: PlanningProblem, end: EndPoint) -> None:
        self._tasks = problem.tasks
        self._points = [end.path[stop] for stop in end.stops]
        self._jacobians = end.jacobians

    def measured(self) -> tuple[float, Array]:
        """E, [Paper] section 4, and e."""
        weighted, scaled = [], []
        for task, point in zip(self._tasks, self._points, strict=True):
            difference = task.difference(point)
            weighted.append(task.weights * difference)
            scaled.append(task.scales * difference)
        return float(norm(_stacked(weighted))), _stacked(scaled)

    @property
    def jacobian(self) -> Array:
        """J: the rows of every task."""
        parts = zip(self._tasks, self._points, self._jacobians, strict=True)
        return _stacked([task.jacobian(point, rows) for task, point, rows in parts])


def _stacked(parts: list[Array]) -> Array:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
