"""Goals for benchmarks: reachable by construction, or drawn from a robot's workspace; the same for the same seed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.three_upu import ThreeUPU

PAPER_START = np.array([[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])  # Λ₀ of [Paper] section 4
NOISE = (0.3, 0.6)  # standard deviations of a coefficient, in turn
CLEAR = {
    "sigma_s": 0.05,
    "sigma_w": 0.02,
}  # least margins along the path that makes a goal, lengths divided by …
CLEAR_LENGTH = 10.0  # … this one
NEAR_LENGTH, NEAR_ANGLE = 5.0, np.radians(30)  # at most, of a coordinate beside the start
# which of x, y, z and the rotation vector's three change: each alone three times, all pairs, all of them
NEAR = [(i,) for i in range(6)] * 3 + list(combinations(range(6), 2)) + [tuple(range(6))] * 17
RADIUS, HEIGHT, TILT, YAW = 8.0, (18.0, 40.0), np.radians(30), np.radians((-120, 20))

BASE, PLATFORM, TILTS = (10.0, 40.0), (4.0, 20.0), np.radians((40, 90))  # of random robots
START_HEIGHT, START_YAW, LOWEST = (15.0, 40.0), np.radians(60), 5.0
WALK, WALK_LENGTH, WALK_ANGLE, WALK_REACH = (
    300,
    0.5,
    0.06,
    25.0,
)  # steps, their sizes, and how far from the axis

ROBOTS: dict[str, dict[str, Any]] = {name: {"preset": name} for name in ThreeUPU.presets} | {
    "hostile": {
        "base_radius": 10.0,
        "platform_radius": 5.0,
        "roller_tilt": np.pi / 2,
        "platform_axis": "normal",
    }
}


@cache
def robot(name: str) -> ThreeUPU:
    """One of `ROBOTS`, the same for all tasks: what is built for it is built once."""
    parameters = dict(ROBOTS[name])
    preset = parameters.pop("preset", "default")
    return ThreeUPU.preset(preset, **parameters)


def paper_task(name: str, **changes: Any) -> PlanningProblem:
    """The paper's start pose and Λ₀ on one of `ROBOTS`; the paper's goal unless changed."""
    turned = {yaw: so3.from_rpy(np.array([0.0, 0.0, yaw])) for yaw in (-np.pi / 6, -np.pi / 2)}
    values: dict[str, Any] = {
        "system": robot(name),
        "start": {"position": [0, 0, 25], "orientation": turned[-np.pi / 6]},
        "goal": {"position": [-0.4, -0.2, 35], "orientation": turned[-np.pi / 2]},
        "initial": PAPER_START,
        "pictures": False,
        "name": name,
    }
    return PlanningProblem(**{**values, **changes})


def reachable_goals(problem: PlanningProblem, count: int, seed: int = 0) -> list[Mapping[str, Any]]:
    """End points of the problem's Λ₀ plus noise, of paths that stay clear of the singular surfaces."""
    random, numeric = np.random.default_rng(seed), numeric_system(problem.system)
    flow = RungeKutta4(200).flow(Dynamics(numeric.rate_function), problem.basis, problem.horizon.fixed)
    goals: list[Mapping[str, Any]] = []
    while len(goals) < count:
        noise = random.normal(0.0, NOISE[len(goals) % len(NOISE)], np.shape(problem.initial))
        path = flow.states(problem.start_point, problem.initial + noise)
        if not np.isfinite(path).all():
            continue
        margins = numeric.margins(path, CLEAR_LENGTH)
        one_side = all(np.all(v * v[0] > 0) for name, v in margins.items() if name.startswith("det"))
        if one_side and all(margins[name].min() >= least for name, least in CLEAR.items()):
            space = problem.system.state_space
            goals.append(space.unpack(space.nearest(path[-1])))
    return goals


def workspace_goal(problem: PlanningProblem, seed: int) -> Mapping[str, Any]:
    """A pose of the workspace on the start's side of det S = 0 and det W = 0."""
    random, numeric = np.random.default_rng(seed), numeric_system(problem.system)
    while True:
        heading = random.uniform(0, 2 * np.pi)
        tilt = random.uniform(0, TILT) * np.array([np.cos(heading), np.sin(heading), 0.0])
        goal = {
            "position": np.array([*random.uniform(-RADIUS, RADIUS, 2), random.uniform(*HEIGHT)]),
            "orientation": so3.exp(tilt) @ so3.from_rpy(np.array([0.0, 0.0, random.uniform(*YAW)])),
        }
        point = problem.system.state_space.pack(goal)
        determinants = numeric.determinants(np.stack([problem.start_point, point]))
        if all(there * here > 0 for here, there in determinants.values()):
            return goal


def near_goal(problem: PlanningProblem, number: int) -> Mapping[str, Any]:
    """A pose near the start, on its side of det S = 0 and det W = 0, of which the coordinates `NEAR[number]` differ."""
    random, numeric = np.random.default_rng(number), numeric_system(problem.system)
    start, axes = problem.start, list(NEAR[number])
    while True:
        moved = np.zeros(6)
        moved[axes] = random.uniform(-1.0, 1.0, len(axes))
        goal = {
            "position": np.asarray(start["position"]) + NEAR_LENGTH * moved[:3],
            "orientation": so3.exp(NEAR_ANGLE * moved[3:]) @ start["orientation"],
        }
        point = problem.system.state_space.pack(goal)
        determinants = numeric.determinants(np.stack([problem.start_point, point]))
        if all(there * here > 0 for here, there in determinants.values()):
            return goal


def random_robot_task(seed: int) -> PlanningProblem:
    """A robot at random on a start that is clear of its singular surfaces; the goal is the start."""
    random = np.random.default_rng([seed, 0])
    while True:
        tilt = random.uniform(*TILTS) * random.choice([-1.0, 1.0])
        system = ThreeUPU(
            base_radius=random.uniform(*BASE),
            platform_radius=random.uniform(*PLATFORM),
            roller_tilt=tilt,
            platform_axis=str(random.choice(["radial", "tangential", "normal"])),
            joint=str(random.choice(["veselova", "suslov"])),
        )
        height, yaw = random.uniform(*START_HEIGHT), random.uniform(-START_YAW, START_YAW)
        start = {
            "position": np.array([0.0, 0.0, height]),
            "orientation": so3.from_rpy(np.array([0.0, 0.0, yaw])),
        }
        if _clear(system, np.asarray(system.state_space.pack(start))) is not None:
            return PlanningProblem(
                system=system, start=start, goal=start, pictures=False, name=f"robot-{seed}"
            )


def walked_goal(problem: PlanningProblem, seed: int) -> Mapping[str, Any]:
    """The end of a random walk of the pose from the start, which stays clear and on the start's side."""
    random, space = np.random.default_rng([seed, 1]), problem.system.state_space
    here = problem.start_point
    signs = _clear(problem.system, here)
    sizes = np.array([WALK_LENGTH] * 3 + [WALK_ANGLE] * 3)
    velocity = random.normal(size=6)
    for _ in range(WALK):
        velocity = 0.95 * velocity + 0.31 * random.normal(size=6)
        there = np.asarray(space.retract(here, sizes * velocity))
        position = space.unpack(there)["position"]
        inside = position[2] > LOWEST and np.abs(position[:2]).max() < WALK_REACH
        if inside and _clear(problem.system, there) == signs:
            here = space.nearest(there)
        else:
            velocity = random.normal(size=6)
    return space.unpack(here)


def _clear(system: ThreeUPU, pose: Any) -> tuple[bool, ...] | None:
    """The signs of the determinants where a pose is clear of their zeros."""
    margins = numeric_system(system).margins(pose[None], CLEAR_LENGTH)
    if not all(margins[name][0] >= least for name, least in CLEAR.items()):
        return None
    return tuple(bool(margins[name][0] > 0) for name in ("det_s", "det_w"))
