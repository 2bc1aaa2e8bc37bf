"""The door of this room: a route for a problem, with as much clearance as is to be had, or what is known of none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time
from typing import NamedTuple

import numpy as np

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.route.easing import eased
from nhpocp.solvers.route.loops import Loops, known_loops
from nhpocp.solvers.route.pose_checks import PoseChecks, pose_checks
from nhpocp.solvers.route.route import Poses, Route
from nhpocp.solvers.route.rrt_connect import MISSING, Allowed, Trees, grown, installed


class Level(NamedTuple):
    """What is asked of a route, and what its search may cost.

    clearance: of σ_min, and of what bounds spare, at start or goal, the lesser. most: manoeuvres a unit of length.
    """

    clearance: float
    most: float
    share: float  # of the time
    edges: float  # that are looked at, most of them in less than the share: the same on every machine


LEVELS = (  # one after the other
    Level(0.5, 15.0, 0.15, 800),
    Level(0.2, 60.0, 0.25, 3000),
    Level(0.05, 300.0, 0.3, 8000),
    Level(0.01, np.inf, 0.3, np.inf),
)
STRAIGHT = LEVELS[:2]  # a straight motion that is so needs no search
KEPT = 0.2  # of a route's clearance, by manoeuvres along it


@dataclass(frozen=True)
class RouteSearch:
    """How the search for a route ended.

    route: None where none was found; words: what is known then. checks: what the poses of manoeuvres along it have to
    meet. trees: that did not meet, of the last search.
    """

    route: Route | None = None
    checks: PoseChecks | None = None
    words: str = ""
    trees: Trees | None = None


def lacking(problem: PlanningProblem) -> str:
    """Why manoeuvres along routes are not for a problem, in words; empty where they are."""
    if not problem.system.driftless:
        return "with a drift a motion cannot follow any route"
    if problem.via:
        return "via poses are met at given times"
    if not set(problem.goal) <= set(problem.system.state_space.names):
        return "the goal names outputs, which many poses have"
    if problem.system.invariants(problem.start_point):
        return "its joints hold what routes would change"
    if problem.goal_error(problem.start_point) == 0.0:
        return "the start is the goal"
    return ""


@np.errstate(all="ignore")  # a pose whose numbers are not finite is not valid
def find_route(
    problem: PlanningProblem,
    seconds: float,
    seed: int,
    stopped: Callable[[], bool] = lambda: False,
    required: bool = False,
) -> RouteSearch:
    """A route from start to goal, of which free blocks keep the start's value.

    A straight one if that is clear of everything; else the first on which trees meet, asked for much clearance first.
    seconds: of processor time, at most. stopped: asked often, whether to give up.
    Errors: `MissingDependencyError` where OMPL, needed for any but straight routes, is ``required`` and not installed.
    """
    ends, words, began = np.stack([problem.start_point, problem.goal_point]), "", thread_time()
    loops, trees = known_loops(problem), None
    for level in STRAIGHT:
        poses = _poses(problem, level, loops)
        if poses.free(*ends):
            return _found(problem, Route(ends, poses), level, seed)
    if not required and not installed():
        return RouteSearch(words=f"around what is in the way of the straight motion, {MISSING}")
    for level in LEVELS:
        poses = _poses(problem, level, loops)
        if words := _ends_nowhere(problem, poses):
            continue
        left = seconds - (thread_time() - began)
        trees = grown(problem, poses, Allowed(min(level.share * seconds, left), level.edges, stopped), seed)
        if trees.waypoints is not None:
            return _found(problem, Route(trees.waypoints, poses), level, seed)
        words = _growth(problem, poses, trees, thread_time() - began)
        if stopped():
            break
    return RouteSearch(words=words, trees=trees)


def _poses(problem: PlanningProblem, level: Level, loops: Loops | None) -> Poses:
    return Poses(problem, pose_checks(problem, level.clearance), loops, level.most if loops else np.inf)


def _ends_nowhere(problem: PlanningProblem, poses: Poses) -> str:
    """Which end no route can leave, in words; empty where there is none."""
    for end, point in (("start", problem.start_point), ("goal", problem.goal_point)):
        checks = poses.checks
        for check, least in zip(checks.checks, checks.least(checks.slacks(point[None])), strict=True):
            if not least > 0:
                return f"no route leads from or to the {end}, which is refused by {check.name}"
    return ""


def _found(problem: PlanningProblem, route: Route, level: Level, seed: int) -> RouteSearch:
    route = eased(route, np.random.default_rng(seed))
    return RouteSearch(route, pose_checks(problem, KEPT * level.clearance))


def _growth(problem: PlanningProblem, poses: Poses, trees: Trees, seconds: float) -> str:
    """How far the trees grew, and what refused most."""
    nearest_to_goal = _nearest(poses, trees.start, problem.goal_point)
    nearest_to_start = _nearest(poses, trees.goal, problem.start_point)
    words = (
        f"no route was found in {seconds:.2g} s: the tree from the start ({len(trees.start)} poses) came as near to "
        f"the goal as {_apart(problem, poses, nearest_to_goal, problem.goal_point)}, that from the goal "
        f"({len(trees.goal)} poses) as near to the start as "
        f"{_apart(problem, poses, nearest_to_start, problem.start_point)}"
    )
    refusals = poses.checks.refusals
    most = max(refusals, key=lambda name: refusals[name])
    total = sum(refusals.values())
    return f"{words}; most refused by {most} ({refusals[most]} of {total})" if total else words


def _nearest(poses: Poses, tree: Array, target: Array) -> Array:
    return min(tree, key=lambda pose: poses.tangent(target, pose)[1])


def _apart(problem: PlanningProblem, poses: Poses, here: Array, there: Array) -> str:
    """The distance of two poses in words."""
    space, tangent = problem.system.state_space, poses.checks.difference(there, here)
    parts = []
    for block in space.blocks:
        part = float(np.linalg.norm(tangent[space.tangent_slice(block.name)]))
        angle = block.unit == "angle"
        parts.append((f"{np.degrees(part):.3g} deg" if angle else f"{part:.3g}") + f" in {block.name}")
    return " and ".join(parts)
