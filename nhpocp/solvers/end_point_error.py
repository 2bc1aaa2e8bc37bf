"""The end-point error e = (p_T - p_d, r_T) of [Paper] eq. (8), the via poses' errors above it."""

from __future__ import annotations

from functools import cached_property

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
        self._tasks, self._end = problem.tasks, end
        self._points = [end.path[stop] for stop in end.stops]

    @cached_property
    def _differences(self) -> list[Array]:
        return [task.difference(point) for task, point in zip(self._tasks, self._points, strict=True)]

    @property
    def vector(self) -> Array:
        pairs = zip(self._tasks, self._differences, strict=True)
        return np.concatenate([task.scales * difference for task, difference in pairs])

    @property
    def jacobian(self) -> Array:
        parts = zip(self._tasks, self._points, self._end.jacobians, strict=True)
        return np.concatenate([task.jacobian(point, rows) for task, point, rows in parts])

    @property
    def norm(self) -> float:
        """E(θ), [Paper] section 4."""
        pairs = zip(self._tasks, self._differences, strict=True)
        return float(norm(np.concatenate([task.weights * difference for task, difference in pairs])))
