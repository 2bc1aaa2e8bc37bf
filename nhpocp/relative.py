"""A path relative to its goal: e_p = p - p_d and r, [r] = log(R R_dᵀ), of [Paper] section 4 and Fig. 3."""

from __future__ import annotations

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import OrientationAtPiError
from nhpocp.solution import Solution
from nhpocp.state_space import Block


def blocks_with_goal(solution: Solution) -> list[Block]:
    """The parts of the state and of the outputs that have a goal and a course."""
    system, goal = solution.problem.system, solution.problem.goal
    every = (*system.state_space.blocks, *system.pose_outputs)
    return [block for block in every if block.name in goal and block.name in solution.trajectory]


def relative_to(goal: Array, values: Array, block: Block) -> Array:
    """value - goal, or the rotation vector from goal to value; (samples, components).

    values: (samples, …) of the block. NaN where a value is not finite, or half a turn away, where no axis is defined.
    """
    if block.kind not in ("rotation", "direction"):
        return values.reshape(len(values), block.size) - np.ravel(goal)
    vectors = np.full((len(values), 3), np.nan)
    for k, value in enumerate(values.reshape(-1, *block.shape)):
        if not np.isfinite(value).all():
            continue
        try:
            vectors[k] = so3.log(value @ goal.T) if block.kind == "rotation" else so3.between(goal, value)
        except OrientationAtPiError:
            continue
    return vectors
