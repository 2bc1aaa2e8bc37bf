"""A route: valid poses from start to goal, in straight parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.route.edges import FARTHEST, free
from nhpocp.solvers.route.loops import Loops
from nhpocp.solvers.route.pose_checks import PoseChecks

LONGEST = np.pi - 0.05  # [rad]: a turn by more has two directions
APART = 0.2  # in units of the scales: where a motion is looked at for what it takes
NARROW, WIDE = 0.02, 0.5  # of a slack: least and most of the room that counts
STEEPEST = 50.0  # area of loops for each unit of length, as which more counts: of a surface that is crossed
LEAST = 0.2  # manoeuvres for each unit of length


class Poses:
    """The poses of a problem as a space that can be measured: tangents in units of the problem's scales.

    loops: what motions take of the system, where that is known. most: manoeuvres for each unit of length of an edge.
    """

    def __init__(
        self, problem: PlanningProblem, checks: PoseChecks, loops: Loops | None = None, most: float = np.inf
    ) -> None:
        self.checks, self.scales, self.loops, self.most = checks, problem.scales.states, loops, most
        space = problem.system.state_space
        self._turns = [space.tangent_slice(block.name) for block in space.blocks if block.kind == "rotation"]
        self._tangents: dict[tuple[bytes, bytes], tuple[Array, float]] = {}
        self._measured: dict[tuple[bytes, bytes], float] = {}

    def tangent(self, there: Array, here: Array) -> tuple[Array, float]:
        """From one pose to another, and how long that is; infinite where nobody looks: a half turn, or farther off."""
        key = there.tobytes(), here.tobytes()
        if key not in self._tangents:  # one edge is asked for several times
            self._tangents[key] = self._measure(there, here)
        return self._tangents[key]

    def _measure(self, there: Array, here: Array) -> tuple[Array, float]:
        tangent = self.checks.difference(there, here)
        size = float(np.linalg.norm(tangent / self.scales))
        turned = any(np.linalg.norm(tangent[turn]) > LONGEST for turn in self._turns)
        return tangent, size if size < FARTHEST and not turned else np.inf

    def valid(self, here: Array, there: Array) -> bool:
        """Whether the straight motion from one pose to another is valid."""
        tangent, size = self.tangent(there, here)
        return free(self.checks, here, tangent, size)

    def free(self, here: Array, there: Array) -> bool:
        """Whether it is valid, and not too laborious; what most are refused for is asked first."""
        size = self.tangent(there, here)[1]
        bearable = self.most == np.inf or self.manoeuvres(here, there) <= (self.most + LEAST) * size
        return bearable and self.valid(here, there)

    def manoeuvres(self, here: Array, there: Array) -> float:
        """How many the straight motion takes, about; infinite where it is seen not to be valid."""
        key = here.tobytes(), there.tobytes()
        if key not in self._measured:
            tangent, size = self.tangent(there, here)
            dense = self._density(here, tangent, size) if 0.0 < size < np.inf else 0.0
            self._measured[key] = size * (LEAST + dense)
        return self._measured[key]

    def _density(self, here: Array, tangent: Array, size: float) -> float:
        """For each unit of length, on the average.

        A circle whose radius is the room around a pose encloses so much of the area of `Loops` that the motion takes.
        """
        count = 2 + int(size / APART)
        poses = self.checks.between(here, tangent, (np.arange(count) + 0.5) / count)
        slacks = self.checks.slacks(poses)
        if self.checks.refuse(slacks):
            return np.inf
        room = np.clip(slacks.min(axis=1, initial=WIDE), NARROW, WIDE)
        areas = self.loops.areas(poses, tangent / size) if self.loops else np.ones(count)
        return float((np.minimum(areas, STEEPEST) / (np.pi * room**2)).mean())


@dataclass(frozen=True)
class Route:
    """A route through some poses.

    waypoints: packed poses (k, size), the start first, the goal last. poses: how they are measured.
    """

    waypoints: Array
    poses: Poses

    @cached_property
    def _knots(self) -> Array:
        """The length of the route up to each of its waypoints."""
        lengths = [self.poses.tangent(there, here)[1] for here, there in pairwise(self.waypoints)]
        return np.array([0.0, *np.cumsum(lengths)])

    @cached_property
    def _counts(self) -> Array:
        """The manoeuvres up to each of its waypoints."""
        return np.array(
            [0.0, *np.cumsum([self.poses.manoeuvres(*ends) for ends in pairwise(self.waypoints)])]
        )

    @property
    def length(self) -> float:
        """In units of the problem's scales."""
        return float(self._knots[-1])

    def manoeuvres(self, first: float, last: float) -> float:
        """How many the part between two lengths takes, about."""
        before, after = np.interp([first, last], self._knots, self._counts)
        return float(after - before)

    def at(self, length: float) -> Array:
        """The pose after that much of the route."""
        if length >= self.length:
            return self.waypoints[-1]
        place = max(int(np.searchsorted(self._knots, length, side="right")) - 1, 0)
        here, there = self.waypoints[place : place + 2]
        part = (length - self._knots[place]) / (self._knots[place + 1] - self._knots[place])
        tangent, _ = self.poses.tangent(there, here)
        return np.asarray(self.poses.checks.between(here, tangent, np.array([part]))[0])

    def after(self, length: float) -> Array:
        """The waypoints that are still to come after that much of the route, (k, size)."""
        return self.waypoints[self._knots > length]

    def by(self, first: float, way: Sequence[Array], last: float) -> Route:
        """With other poses between two lengths, those at them included."""
        return Route(np.vstack([self.waypoints[self._knots < first], *way, self.after(last)]), self.poses)
