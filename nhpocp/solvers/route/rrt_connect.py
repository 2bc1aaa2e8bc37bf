"""OMPL's RRT-Connect over a system's poses. [Kuffner, LaValle, ICRA 2000]"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from time import thread_time
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.bodies.hull import Hull
from nhpocp.errors import MissingDependencyError
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.route.route import Poses
from nhpocp.state_space import Block

MISSING = 'routes need OMPL; install it with: pip install "nhpocp[routes]"'
RANGE = 1.0  # of the pose's scales: the longest edge of a tree
MOST_SEED = 2**64 - 1  # that OMPL takes
SELDOM = 8  # edges, after which the time is looked at
ROOM = 2.0  # of its scale, beside start and goal: where a coordinate without bounds is looked for
HALF_TURN = np.pi  # beside start and goal, likewise of an angle


@dataclass(frozen=True)
class Trees:
    """What a search ended with.

    waypoints: of a route, (k, size); None where there is none. start, goal: the poses of either tree, (k, size), the
    root first. parents: of either tree the place of the pose that each grew from, (k,); a root's is its own.
    """

    waypoints: Array | None
    start: Array
    goal: Array
    parents: tuple[Array, Array] = (np.zeros(1, dtype=int), np.zeros(1, dtype=int))


def installed() -> bool:
    """Whether routes can be looked for."""
    try:
        _ompl()
    except MissingDependencyError:
        return False
    return True


def _ompl() -> tuple[Any, Any, Any]:
    """OMPL's modules base, geometric and util. Errors: `MissingDependencyError` with the line that installs it."""
    try:
        from ompl import base, geometric, util
    except ImportError:
        raise MissingDependencyError(MISSING) from None
    util.setLogLevel(util.LOG_NONE)
    _collected_at_exit()
    return base, geometric, util


@cache
def _collected_at_exit() -> None:
    """OMPL complains at exit of what is left of it, and what the program has frozen is not collected."""
    atexit.register(gc.unfreeze)


@dataclass(frozen=True)
class Allowed:
    """What a search may cost.

    seconds: of processor time. edges: that are looked at. stopped: asked often, whether to give up.
    """

    seconds: float
    edges: float
    stopped: Callable[[], bool]


def grown(problem: PlanningProblem, poses: Poses, allowed: Allowed, seed: int) -> Trees:
    """Trees from start and goal until they meet, or no more is allowed.

    Whatever is OMPL's is gone when this returns: objects of its own that live at the end of Python make it complain.
    Errors: `MissingDependencyError` where OMPL is not installed.
    """
    base, geometric, util = _ompl()
    util.RNG.setSeed(seed % MOST_SEED + 1)  # which is not to be 0
    packing = _Packing(problem)
    space = packing.space(base)
    information = base.SpaceInformation(space)

    deadline, looked, late = thread_time() + allowed.seconds, 0, False

    def over() -> bool:
        nonlocal late
        if looked % SELDOM == 0:  # to ask takes as long as to look at an edge
            late = thread_time() > deadline
        return late or looked > allowed.edges or allowed.stopped()

    class Edges(base.MotionValidator):  # type: ignore[name-defined]
        def checkMotion(self, here: Any, there: Any, *last: Any) -> bool:  # OMPL advances as long as it may
            nonlocal looked
            looked += 1
            return not over() and poses.free(packing.point(here), packing.point(there))

    validator = Edges(information)
    information.setMotionValidator(validator)
    information.setStateValidityChecker(lambda state: True)  # edges alone are asked, their ends included
    information.setup()
    ends = space.allocState(), space.allocState()
    for state, point in zip(ends, (problem.start_point, problem.goal_point), strict=True):
        packing.write(state, point)
    definition = base.ProblemDefinition(information)
    definition.setStartAndGoalStates(*ends, 1e-9)
    planner = geometric.RRTConnect(information)
    planner.setRange(RANGE)
    planner.setProblemDefinition(definition)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(over))
    waypoints = None
    if definition.hasExactSolution():
        states = definition.getSolutionPath().getStates()
        waypoints = np.array([packing.point(state) for state in states])
        waypoints[0], waypoints[-1] = problem.start_point, problem.goal_point
    data = base.PlannerData(information)
    planner.getPlannerData(data)
    # OMPL's tags of the two trees; the edges of the second lead to its root
    start, goal = _tree(data, packing, 1, data.getIncomingEdges), _tree(data, packing, 2, data.getEdges)
    roots = problem.start_point, problem.goal_point
    (poses, parents), (others, of_others) = (
        tree if len(tree[0]) else (root[None], np.zeros(1, dtype=int))
        for tree, root in zip((start, goal), roots, strict=True)
    )
    return Trees(waypoints, poses, others, (parents, of_others))


def _tree(
    data: Any, packing: _Packing, tag: int, towards_root: Callable[[int], list[int]]
) -> tuple[Array, Array]:
    """Poses of a tree, the root first, and the place of the one that each grew from."""
    states = {v: data.getVertex(v) for v in range(data.numVertices())}
    before = {v: next(iter(towards_root(v)), v) for v, vertex in states.items() if vertex.getTag() == tag}
    before = {v: parent if parent in before else v for v, parent in before.items()}
    order = sorted(before, key=lambda v: before[v] != v)
    places = {v: place for place, v in enumerate(order)}
    poses = np.array([packing.point(states[v].getState()) for v in order])
    return poses, np.array([places[before[v]] for v in order], dtype=int)


class _Packing:
    """Packed poses and OMPL's states: one vector of all numbers, in units of their scales, then the rotations."""

    def __init__(self, problem: PlanningProblem) -> None:
        self._space, self.size = problem.system.state_space, problem.system.state_space.size
        plain, self._rotations = list[int](), list[slice]()
        for block in self._space.blocks:
            place = self._space.point_slice(block.name)
            if block.kind == "rotation":
                self._rotations.append(place)
            else:
                plain += range(place.start, place.stop)
        self._plain = np.array(plain, dtype=int)
        self._scales = problem.scales.points[self._plain]
        self._box = _box(problem)

    def space(self, base: Any) -> Any:
        """OMPL's space."""
        whole = base.CompoundStateSpace()
        if len(self._plain):
            vectors, bounds = (
                base.RealVectorStateSpace(len(self._plain)),
                base.RealVectorBounds(len(self._plain)),
            )
            for i, (low, high) in enumerate(zip(*(self._box / self._scales), strict=True)):
                bounds.setLow(i, float(low))
                bounds.setHigh(i, float(high))
            vectors.setBounds(bounds)
            whole.addSubspace(vectors, 1.0)
        for _ in self._rotations:
            whole.addSubspace(base.SO3StateSpace(), 2.0)  # whose distance is half of the angle
        whole.lock()
        return whole

    def point(self, state: Any) -> Array:
        point, first = np.empty(self.size), bool(len(self._plain))
        if first:
            vector = state[0]
            point[self._plain] = self._scales * [vector[i] for i in range(len(self._plain))]
        for i, place in enumerate(self._rotations):
            q = state[i + first]
            point[place] = _matrix(q.w, q.x, q.y, q.z)
        return point

    def write(self, state: Any, point: Array) -> None:
        first = bool(len(self._plain))
        for i, value in enumerate(point[self._plain] / self._scales):
            state[0][i] = float(value)
        for i, place in enumerate(self._rotations):
            q = state[i + first]
            q.w, q.x, q.y, q.z = so3.to_quaternion(point[place].reshape(3, 3)).tolist()


def _matrix(w: float, x: float, y: float, z: float) -> list[float]:
    """The rotation of a unit quaternion, row by row."""
    return [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]


def _box(problem: PlanningProblem) -> Array:
    """Lower and upper limits (2, numbers) of what is no rotation: the problem's bounds, else around start and goal."""
    sides: list[Array] = []
    for block in problem.system.state_space.blocks:
        if block.kind != "rotation":
            sides.append(_limits(problem, block))
    return np.concatenate([*sides, np.empty((2, 0))], axis=1)


def _limits(problem: PlanningProblem, block: Block) -> Array:
    ends = _ends(problem, block)
    low, high = ends.min(axis=0), ends.max(axis=0)
    room, beside = ROOM * problem.scales.of(block.unit), high - low
    if block.unit == "angle":
        room = HALF_TURN
    elif around := _extent(problem):  # without, ways that go far off take three times as many manoeuvres
        beside = max(_apart(problem, block.unit), around)
    room = room + beside
    box = np.stack([low - room, high + room])
    for bound in problem.bounds:
        if bound.quantity == block.name:
            box[0] = np.where(np.isfinite(bound.lower), np.maximum(box[0], bound.lower), box[0])
            box[1] = np.where(np.isfinite(bound.upper), np.minimum(box[1], bound.upper), box[1])
    return np.stack([np.minimum(box[0], low), np.maximum(box[1], high)])


def _ends(problem: PlanningProblem, block: Block) -> Array:
    """A block's coordinates at start and goal, (2, numbers)."""
    place = problem.system.state_space.point_slice(block.name)
    return np.stack([problem.start_point[place], problem.goal_point[place]])


def _apart(problem: PlanningProblem, unit: str) -> float:
    """The largest difference of start and goal in a coordinate of that unit: what is between may be as wide as long."""
    blocks = [b for b in problem.system.state_space.blocks if b.kind != "rotation" and b.unit == unit]
    return max(float(np.abs(np.diff(_ends(problem, b), axis=0)).max()) for b in blocks)


def _extent(problem: PlanningProblem) -> float:
    """How far the obstacles that end somewhere reach [length], all together: the way leads around them, if need be."""
    around = problem.system.surroundings
    hulls = [shape for shape in around.shapes().values() if isinstance(shape, Hull)] if around else []
    if not hulls:
        return 0.0
    corners, radius = np.vstack([hull.corners for hull in hulls]), max(hull.radius for hull in hulls)
    return float(np.ptp(corners, axis=0).max() + 2.0 * radius)
