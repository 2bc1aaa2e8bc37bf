"""The end-point error e = (p_T - p_d, r_T) of [Paper] eq. (8), over the blocks that the goal fixes."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import EndPoint
from nhpocp.problem import PlanningProblem

HALF_TURN_WITHIN = 1e-7  # [rad]; closer to π the axis of the error is noise


class EndPointError:
    """e at one end point and E, its norm with the problem's weights; e and J dimensionless for the linear algebra.

    The rows of J for a rotation are s_T, not the derivative of the logarithm: [Paper] eq. (13) asks s_T = -γ r_T, which
    is parallel to r, so that ṙ = -γ r exactly.
    """

    def __init__(self, problem: PlanningProblem, end: EndPoint) -> None:
        self._problem, self._end = problem, end

    @cached_property
    def angle(self) -> float:
        """The largest rotation between a block's end and its goal [rad]."""
        space = self._problem.system.state_space
        here, goal = space.unpack(self._end.state), self._problem.goal
        return max(
            (
                float(so3.angle(here[b.name] @ goal[b.name].T))
                for b in space.blocks
                if b.kind == "rotation" and b.name in goal
            ),
            default=0.0,
        )

    @property
    def half_turn(self) -> bool:
        """Whether an orientation is opposite to its goal, where the logarithm has no direction."""
        return self.angle > np.pi - HALF_TURN_WITHIN

    @cached_property
    def vector(self) -> Array:
        """e over the fixed rows, lengths divided by the mechanism's own (`PlanningProblem.scale`)."""
        return self._problem.goal_difference(self._end.state) * self._scales

    @property
    def _scales(self) -> Array:
        units = np.array(self._problem.system.state_space.tangent_units)[self._problem.error_rows]
        return np.where(units == "length", 1.0 / self._problem.scale, 1.0)

    @property
    def jacobian(self) -> Array:
        """Rows of the end point's Jacobian in the same scale: the rank depends on no unit and no error_length."""
        return self._scales[:, None] * self._end.jacobian[self._problem.error_rows]

    @property
    def norm(self) -> float:
        """E(θ), [Paper] section 4."""
        return self._problem.goal_error(self._end.state)
