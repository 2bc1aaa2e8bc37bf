"""What the legs of a parallel robot leave to its platform at a pose: how many constraints, which velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import CallError, InvalidProblemError, describe, expect
from nhpocp.singular_values import svd
from nhpocp.systems.parallel_robot import ParallelRobot

RANK = 1e-9  # singular values below this fraction of the largest count as zero


@dataclass(frozen=True)
class Mobility:
    """The count at one pose, constraints with their rows' ranks.

    freedom: instantaneous degrees of freedom, 6 - rank [S J]. twists: orthonormal basis (6, freedom) of the velocities
    left, (ṗ/length_scale, ω). reachable: the most dimensions that a reachable set through this pose can have, 6 - the
    rank of the holonomic rows; non-holonomic joints decide, by their Lie brackets, how many of them it has.
    """

    legs: tuple[str, ...]
    motors: int
    holonomic: int
    non_holonomic: int
    independent: int
    freedom: int
    reachable: int
    twists: Array

    def describe(self) -> list[str]:
        """The counts in sentences."""
        constraints = self.holonomic + self.non_holonomic
        lines = [f"leg {i}: {words}" for i, words in enumerate(self.legs, 1)]
        lines.append(
            f"{self.motors} motors, {self.holonomic} holonomic and {self.non_holonomic} non-holonomic constraints; "
            f"{self.freedom} instantaneous degrees of freedom, at most {self.reachable} reachable dimensions"
        )
        if self.independent < constraints:
            lines.append(f"only {self.independent} of the {constraints} constraints are independent here")
        return lines


def mobility(robot: ParallelRobot, state: Array) -> Mobility:
    """What a parallel robot can do at a pose: its constraints counted, and what manoeuvres reach.

    robot: a `ParallelRobot`, such as `ThreeUPU()`. state: a packed pose (12,), position [length] and the nine numbers
    of the rotation row by row, as `problem.start_point`. The answer's `lines()` say it in sentences.
    Errors: `InvalidProblemError` where the rows of its constraints are not finite, `CallError` for another state.
    """
    expect(robot, ParallelRobot, "a ParallelRobot", "robot")
    if np.shape(state) != (robot.state_space.size,):
        words = f"expected a packed state of {robot.state_space.size} numbers, got {describe(state)}"
        raise CallError(words, path="state")
    blocks, scale = robot.kinematics(state), robot.default_length_scale()
    rows = np.hstack([blocks.S * scale, blocks.J])  # on (ṗ/scale, ω)
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(float).tiny)
    if not np.isfinite(rows).all():
        raise InvalidProblemError(
            "the constraints of the legs are not finite here; choose lengths nearer to 1"
        )
    kinds = [kind for leg in robot.legs for kind in leg.constraint_kinds]
    held = rows[[kind == "holonomic" for kind in kinds]]
    _, values, right = svd(rows)
    independent = _rank(values)
    return Mobility(
        legs=tuple(leg.describe() for leg in robot.legs),
        motors=robot.motors,
        holonomic=robot.holonomic,
        non_holonomic=robot.non_holonomic,
        independent=independent,
        freedom=6 - independent,
        reachable=6 - (_rank(svd(held, compute_uv=False)) if len(held) else 0),
        twists=right[independent:].T,
    )


def _rank(values: Array) -> int:
    return int(np.sum(values > RANK * max(values[0], RANK))) if len(values) else 0
