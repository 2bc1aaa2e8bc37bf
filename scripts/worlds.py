"""Worlds for benchmarks: obstacles in the way of a robot or a vehicle whose goal a walk around them reaches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import casadi as ca
import fcl
import numpy as np
from goals import CLEAR, CLEAR_LENGTH

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.bodies.hull import HalfSpace, Hull
from nhpocp.bodies.obstacles import Obstacle
from nhpocp.calls import call, mapped
from nhpocp.problem import PlanningProblem
from nhpocp.systems.car import Car
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.systems.unicycle import Unicycle

COUNT = (3, 8)  # obstacles
BLOCKING = 2  # of them that are looked for in the way of the straight motion
TRIES = 60  # for each obstacle
BASE, PLATFORM, TILTS = (15.0, 35.0), (6.0, 16.0), np.radians((55, 90))
HEIGHT, YAW, LOWEST, REACH = (15.0, 35.0), np.radians(45), 5.0, 20.0
STEPS, STEP, TURN = 120, 0.5, 0.06  # of a robot's walk
AWAY = 1.0  # turn [rad] and way, in units of 10, of the goal from the start at least
ROOM = 10.0  # times a vehicle's size: of the walk to each side
SHORTEST = 3.0  # times its size: of the way from start to goal
STRAIGHT = 41  # poses of the straight motion


@dataclass(frozen=True)
class World:
    """A problem among obstacles. walk: poses (k, size) from start to goal, ``clearance`` farther away than asked."""

    problem: PlanningProblem
    walk: Array
    bound: float


def world(number: int) -> World:
    """Even numbers: robots; odd ones: unicycles and cars in turn. The same for the same number."""
    random = np.random.default_rng([number, 21])
    while True:
        made = _robot_world(random, number) if number % 2 == 0 else _vehicle_world(random, number)
        if made is not None:
            return made


def straight(problem: PlanningProblem) -> Array:
    """The geodesic from start to goal, (k, size)."""
    space = problem.system.state_space
    tangent = np.asarray(space.difference(problem.goal_point, problem.start_point))
    shares = np.linspace(0.0, 1.0, STRAIGHT)
    return np.array([space.retract(problem.start_point, share * tangent) for share in shares])


def least_distance(system: System, path: Array) -> float:
    """Of the pairs of bodies and obstacles that a system counts, along poses (k, size), by fcl's own shapes.

    -1 or less where they meet, whatever the depth; NaN where a pose is none.
    """
    if not np.isfinite(path).all():
        return float("nan")
    around = system.surroundings
    assert around is not None
    still = {name: _shape(shape) for name, shape in around.shapes().items()}
    scenes = [{**still, **bodies} for bodies in _shapes(system, path)]
    return min(_apart(shapes[one], shapes[other]) for shapes in scenes for one, other in around.pairs)


Shape = tuple[Any, float]  # fcl's, and by how much the body is thicker


def _shapes(system: System, path: Array) -> list[dict[str, Shape]]:
    """The bodies at every pose."""
    x = ca.SX.sym("x", system.state_space.size)
    bodies = system.bodies(x)
    columns = [ca.SX(corner) for body in bodies.values() for corner in body.corners]
    (numbers,) = call(
        mapped(ca.Function("corners", [x], [ca.densify(ca.vertcat(*columns))]), len(path)), path
    )
    scenes: list[dict[str, Shape]] = []
    for row in numbers.reshape(len(path), -1):
        scene, first = {}, 0
        for name, body in bodies.items():
            count = len(body.corners) * body.dimension
            places = row[first : first + count].reshape(-1, body.dimension)
            scene[name], first = _shape(replace(body, corners=tuple(places))), first + count
        scenes.append(scene)
    return scenes


def _shape(hull: Hull | HalfSpace) -> Shape:
    if isinstance(hull, HalfSpace):
        raise TypeError("no half spaces here")
    corners = np.array(hull.corners, dtype=float)
    middle = corners.mean(axis=0)
    if hull.dimension == 2:  # as prisms of one height
        middle = np.array([*middle, 0.0])
        if hull.rank == 0:
            return fcl.CollisionObject(fcl.Sphere(hull.radius), fcl.Transform(middle)), 0.0
        corners = np.vstack([np.pad(corners, ((0, 0), (0, 1)), constant_values=z) for z in (-1.0, 1.0)])
        count = len(hull.corners)
        lower, upper = list(range(count))[::-1], list(range(count, 2 * count))
        walls = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
        return _convex(corners, [lower, upper, *walls]), hull.radius
    if hull.rank == 0:
        return fcl.CollisionObject(fcl.Sphere(hull.radius), fcl.Transform(middle)), 0.0
    if hull.rank == 1:
        along = corners[1] - corners[0]
        length = float(np.linalg.norm(along))
        placed = fcl.Transform(_towards(along / length), middle)
        return fcl.CollisionObject(fcl.Capsule(hull.radius, length), placed), 0.0
    return _convex(corners, [list(face) for face in hull.faces]), hull.radius


def _convex(corners: Array, faces: list[list[int]]) -> Any:
    flat = np.concatenate([[len(face), *face] for face in faces])
    return fcl.CollisionObject(fcl.Convex(corners, len(faces), flat), fcl.Transform())


def _towards(direction: Array) -> Array:
    """A rotation whose third column is a unit vector."""
    aside = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first = aside / np.linalg.norm(aside)
    return np.column_stack([first, np.cross(direction, first), direction])


def _apart(one: Shape, other: Shape) -> float:
    found = fcl.distance(one[0], other[0], fcl.DistanceRequest(), fcl.DistanceResult())
    return float(found) - one[1] - other[1]


# --- robots ----------------------------------------------------------------------------------------------------------


def _robot_world(random: np.random.Generator, number: int) -> World | None:
    system = ThreeUPU(
        base_radius=random.uniform(*BASE),
        platform_radius=random.uniform(*PLATFORM),
        roller_tilt=random.uniform(*TILTS) * random.choice([-1.0, 1.0]),
        platform_axis=str(random.choice(["radial", "tangential", "normal"])),
        joint=str(random.choice(["veselova", "suslov"])),
        leg_radius=random.uniform(0.5, 1.5),
        thickness=1.0,
    )
    bound, clearance = 0.5, 0.7
    alone = system.among(())
    start = {
        "position": np.array([0.0, 0.0, random.uniform(*HEIGHT)]),
        "orientation": so3.from_rpy(np.array([0.0, 0.0, random.uniform(-YAW, YAW)])),
    }
    signs = _signs(alone, np.asarray(system.state_space.pack(start)), bound + clearance)
    if signs is None:
        return None

    def valid(pose: Array) -> bool:
        place = system.state_space.unpack(pose)["position"]
        inside = place[2] > LOWEST and np.abs(place[:2]).max() < REACH
        return bool(inside) and _signs(alone, pose, bound + clearance) == signs

    walk = _walk(random, system, start, valid, np.array([STEP] * 3 + [TURN] * 3))
    moved = np.asarray(system.state_space.difference(walk[-1], walk[0]))
    if np.linalg.norm(moved[3:]) + np.linalg.norm(moved[:3]) / 10.0 < AWAY:
        return None

    def seen(poses: Array) -> Array:
        """A point of a body in one of these poses."""
        bodies = system.bodies(poses[random.integers(len(poses))])
        name = str(random.choice([name for name in bodies if name != "base"]))
        weights = random.dirichlet(np.ones(len(bodies[name].corners)))
        return np.asarray(weights @ np.array(bodies[name].corners) + random.normal(0.0, 1.5, 3))

    def made(place: Array, size: float) -> Obstacle:
        kind = str(random.choice(["sphere", "capsule", "box"]))
        if kind == "sphere":
            return Obstacle(kind, {"centre": place, "radius": size})
        if kind == "box":
            angles = random.uniform(-np.pi, np.pi, 3)
            return Obstacle(
                kind, {"centre": place, "size": size * random.uniform(0.8, 2.5, 3), "rpy": angles}
            )
        half = random.normal(size=3)
        half *= random.uniform(2.0, 6.0) / np.linalg.norm(half)
        return Obstacle(kind, {"from": place - half, "to": place + half, "radius": 0.5 * size})

    return _among(random, system, start, walk, bound, clearance, seen, made, f"world-{number}", (0.8, 4.0))


def _signs(system: System, pose: Array, apart: float) -> tuple[bool, ...] | None:
    """Of the determinants, where a pose is clear of their zeros and its bodies of each other."""
    numeric = numeric_system(system)
    margins = numeric.margins(pose[None], CLEAR_LENGTH)
    if not all(margins[name][0] >= least for name, least in CLEAR.items()):
        return None
    if not np.min(numeric.outputs(pose[None], np.zeros((1, 3)))["distance"]) >= apart:
        return None
    return tuple(bool(margins[name][0] > 0) for name in ("det_s", "det_w"))


# --- vehicles --------------------------------------------------------------------------------------------------------


def _vehicle_world(random: np.random.Generator, number: int) -> World | None:
    system: System = Unicycle() if number % 4 == 1 else Car()
    size = 2.0 * system.width if isinstance(system, Unicycle) else 1.5
    bound, clearance = 0.1 * size, 0.15 * size
    start = {"x": 0.0, "y": 0.0, "theta": random.uniform(-np.pi, np.pi)}
    start |= {"phi": 0.0} if number % 4 == 3 else {}

    def valid(pose: Array) -> bool:
        return bool(np.abs(pose[:2]).max() < ROOM * size)

    steps = np.array([0.2 * size, 0.2 * size, 0.15, *([0.0] if number % 4 == 3 else [])])
    walk = _walk(random, system, start, valid, steps)
    if np.linalg.norm(walk[-1, :2]) < SHORTEST * size:
        return None

    def seen(poses: Array) -> Array:
        return np.asarray(poses[random.integers(len(poses)), :2] + random.normal(0.0, 0.5 * size, 2))

    def made(place: Array, radius: float) -> Obstacle:
        kind = str(random.choice(["disc", "rectangle", "polygon"]))
        if kind == "disc":
            return Obstacle(kind, {"centre": place, "radius": radius})
        if kind == "rectangle":
            sizes, angle = radius * random.uniform(0.6, 3.0, 2), random.uniform(0.0, np.pi)
            return Obstacle(kind, {"centre": place, "size": sizes, "angle": angle})
        corners = int(random.integers(3, 7))
        around = 2 * np.pi * (np.arange(corners) + random.uniform(0.0, 0.5, corners)) / corners
        return Obstacle(
            kind, {"corners": place + 1.2 * radius * np.column_stack([np.cos(around), np.sin(around)])}
        )

    radii = (0.3 * size, 1.5 * size)
    return _among(random, system, start, walk, bound, clearance, seen, made, f"world-{number}", radii)


# --- both ------------------------------------------------------------------------------------------------------------


def _walk(
    random: np.random.Generator,
    system: System,
    start: Mapping[str, Any],
    valid: Callable[[Array], bool],
    sizes: Array,
) -> Array:
    """A random walk of valid poses (k, size), the start first."""
    space = system.state_space
    poses = [np.asarray(space.pack(start), dtype=float)]
    velocity = random.normal(size=len(sizes))
    for _ in range(STEPS):
        velocity = 0.95 * velocity + 0.31 * random.normal(size=len(sizes))
        there = space.nearest(np.asarray(space.retract(poses[-1], sizes * velocity)))
        if valid(there):
            poses.append(there)
        else:
            velocity = random.normal(size=len(sizes))
    return np.array(poses)


def _among(
    random: np.random.Generator,
    system: System,
    start: Mapping[str, Any],
    walk: Array,
    bound: float,
    clearance: float,
    seen: Callable[[Array], Array],
    made: Callable[[Array, float], Obstacle],
    name: str,
    sizes: tuple[float, float],
) -> World | None:
    """The system on its way among obstacles that leave the walk free; None where too few find a place."""
    goal = system.state_space.unpack(walk[-1])
    problem = PlanningProblem(system=system, start=start, goal=goal, samples=1001, pictures=False, name=name)
    direct, free = straight(problem), _shapes(system, _filled(system, walk))
    swept, moving = (
        _shapes(system, direct),
        [name for name, body in system.bodies(walk[0]).items() if not body.fixed],
    )
    wanted, obstacles, blocking = int(random.integers(COUNT[0], COUNT[1] + 1)), list[Obstacle](), 0
    for tried in range(TRIES * wanted):
        if len(obstacles) == wanted:
            break
        first = blocking < BLOCKING and tried < TRIES * wanted // 2
        place = seen(direct[4:-4] if first or tried % 2 else walk)
        obstacle = made(place, random.uniform(*sizes) * (0.5 if tried > TRIES else 1.0))
        shape = _shape(obstacle.shape)
        hit = any(_apart(scene[body], shape) < bound for scene in swept for body in moving)
        if first and not hit:
            continue
        if all(_apart(scene[body], shape) > bound + clearance for scene in free for body in moving):
            blocking += hit
            obstacles.append(obstacle)
    if len(obstacles) < wanted:
        return None
    return World(problem.with_(obstacles=obstacles, bounds={"distance": bound}), walk, bound)


def _filled(system: System, walk: Array) -> Array:
    """With two poses more between neighbours."""
    space, filled = system.state_space, [walk[0]]
    for here, there in pairwise(walk):
        tangent = np.asarray(space.difference(there, here))
        filled += [np.asarray(space.retract(here, share * tangent)) for share in (1 / 3, 2 / 3)] + [there]
    return np.array(filled)
