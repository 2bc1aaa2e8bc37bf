"""The end-point error e = (p_T - p_d, r_T) of [Paper] eq. (8), the via poses' errors above it."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import EndPoint
from nhpocp.problem import PlanningProblem
from nhpocp.task import total_error


class EndPointError:
    """e of every task along one path and E, their norm with the problem's weights.

    e and J, for the linear algebra, are dimensionless.
    """

    def __init__(self, problem: PlanningProblem, end: EndPoint) -> None:
        self._met = [(task, end.path[stop]) for task, stop in zip(problem.tasks, end.stops, strict=True)]
        self._jacobians = end.jacobians

    @property
    def half_turn(self) -> float | None:
        """The angle of an orientation that is opposite to its goal, where the logarithm has no direction [rad]."""
        return next((task.angle(point) for task, point in self._met if task.half_turn(point)), None)

    @cached_property
    def vector(self) -> Array:
        return np.concatenate([task.vector(point) for task, point in self._met])

    @property
    def jacobian(self) -> Array:
        pairs = zip(self._met, self._jacobians, strict=True)
        return np.vstack([task.jacobian(point, rows) for (task, point), rows in pairs])

    @property
    def norm(self) -> float:
        """E(θ), [Paper] section 4."""
        return total_error(*zip(*self._met, strict=True))
