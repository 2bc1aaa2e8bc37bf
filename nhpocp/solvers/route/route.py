"""A route: valid poses from start to goal, in straight parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.route.edges import free
from nhpocp.solvers.route.pose_checks import PoseChecks

SHORTCUTS = 100  # tried
LONGEST = np.pi - 0.05  # [rad]: a turn by more has two directions


class Poses:
    """The poses of a problem as a space that can be measured: tangents in units of the problem's scales."""

    def __init__(self, problem: PlanningProblem, checks: PoseChecks) -> None:
        self.checks, self.scales = checks, problem.scales.states
        space = problem.system.state_space
        self._turns = [space.tangent_slice(block.name) for block in space.blocks if block.kind == "rotation"]

    def tangent(self, there: Array, here: Array) -> tuple[Array, float]:
        """From one pose to another, and how long that is; infinite where it would be a half turn."""
        tangent = self.checks.difference(there, here)
        far = not np.isfinite(tangent).all() or any(
            np.linalg.norm(tangent[turn]) > LONGEST for turn in self._turns
        )
        return tangent, np.inf if far else float(np.linalg.norm(tangent / self.scales))

    def free(self, here: Array, there: Array) -> bool:
        """Whether the straight motion from one pose to another is valid."""
        tangent, size = self.tangent(there, here)
        return bool(np.isfinite(size)) and free(self.checks, here, tangent, size)


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

    @property
    def length(self) -> float:
        """In units of the problem's scales."""
        return float(self._knots[-1])

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

    def shortened(self, random: np.random.Generator) -> Route:
        """With straight parts wherever two of its poses see each other and that is shorter."""
        route = self
        for _ in range(SHORTCUTS):
            if len(route.waypoints) == 2:
                break
            first, last = np.sort(random.uniform(0.0, route.length, 2))
            ends = route.at(first), route.at(last)
            if self.poses.tangent(ends[1], ends[0])[1] < 0.99 * (last - first) and self.poses.free(*ends):
                before = route.waypoints[route._knots < first]
                after = route.waypoints[route._knots > last]
                route = Route(np.vstack([before, *ends, after]), self.poses)
        return route.merged()

    def merged(self) -> Route:
        """Without the waypoints that can be left out."""
        kept, here = [self.waypoints[0]], 0
        while here < len(self.waypoints) - 1:
            seen = next(
                (k for k in range(len(self.waypoints) - 1, here + 1, -1) if self._skips(here, k)), here + 1
            )
            kept.append(self.waypoints[seen])
            here = seen
        return Route(np.array(kept), self.poses)

    def _skips(self, first: int, last: int) -> bool:
        shorter = self.poses.tangent(self.waypoints[last], self.waypoints[first])[1]
        return shorter <= 1.001 * (self._knots[last] - self._knots[first]) and self.poses.free(
            self.waypoints[first], self.waypoints[last]
        )
