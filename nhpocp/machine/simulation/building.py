"""A parallel robot as an MJCF document: bodies, joints, contacts and motors, from where its joints are and no more.

The machine is as large as a bench: the mechanism's own length, the mean distance of the platform's joints from its
origin, is 15 cm, whatever the problem's unit; forces and masses are those of such a machine.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.simulation.base_joints import BASE_JOINTS, Document, Roller, Seat
from nhpocp.machine.simulation.built import Built, Drive, head
from nhpocp.machine.simulation.mjcf import Element, add, as_text, axes
from nhpocp.machine.simulation.rolling_ball import DRIVE, build_ball
from nhpocp.machine.simulation.settings import MachineSettings
from nhpocp.problem import PlanningProblem
from nhpocp.systems.legs import Leg
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.rolling_sphere import RollingSphere
from nhpocp.systems.system import System
from nhpocp.whole import write_text

SIZE = 0.15  # m, of the mechanism's own length
TUBE_MASS, ROD_MASS, CROSS_MASS, PLATFORM_MASS = 0.1, 0.1, 0.02, 0.5  # kg
WELD = {"solref": (0.002, 1), "solimp": (0.99, 0.9999, 1e-4)}


def built(system: System, position: Array, orientation: Array, settings: MachineSettings) -> Built:
    """The machine of any system that can be built. Errors: `InvalidProblemError` for any other."""
    if isinstance(system, RollingSphere):
        return build_ball(system, position, orientation, settings)
    return build(as_robot(system), position, orientation, settings)


def drive_of(system: System) -> Drive:
    """What its motors follow. Errors: as of `built`."""
    if isinstance(system, RollingSphere):
        return DRIVE
    legs = list(enumerate(as_robot(system).legs, 1))
    free = [(number, leg) for number, leg in legs if not leg.pinned]
    columns = tuple(i for i, (_, leg) in enumerate(free) if leg.actuated)
    labels = tuple(f"leg {number}" for number, leg in legs if leg.actuated)
    return Drive("leg_lengths", "leg_lengths", columns, labels)


def as_robot(system: System) -> ParallelRobot:
    """A robot whose machine is told leg lengths. Errors: `InvalidProblemError` for any other system."""
    if isinstance(system, ParallelRobot):
        return system
    wanted = "a robot on legs (three_upu, parallel_robot), or to play a plan a rolling_sphere"
    raise InvalidProblemError(f"{system.model} cannot be built; expected {wanted}", path="system.model")


def build(system: ParallelRobot, position: Array, orientation: Array, settings: MachineSettings) -> Built:
    """The machine of a parallel robot at a pose.

    position: (3,) [length], orientation: (3, 3), platform to base. Errors: `InvalidProblemError` for a leg of
    length zero.
    """
    metres = SIZE / system.default_length_scale()
    root, parts = head(settings)
    platform = add(parts.world, "body", name="platform", pos=metres * position, xyaxes=axes(orientation))
    add(platform, "freejoint", name="platform")
    add(platform, "geom", type_="cylinder", size=(SIZE, 0.03 * SIZE), mass=PLATFORM_MASS)
    if settings.payload:
        add(platform, "geom", type_="sphere", size=0.1 * SIZE, mass=settings.payload)
    equality = add(root, "equality")
    rollers, motors, lengths = [], [], []
    for number, leg in enumerate(system.legs, 1):
        roller = _build_leg(number, leg, (position, orientation), metres, settings, parts, equality)
        if roller:
            rollers.append(roller)
        if leg.actuated:
            motors.append(f"length {number}")
            lengths.append(float(leg.pose(position, orientation).length))
    return Built(as_text(root), metres, "platform", tuple(motors), np.array(lengths), tuple(rollers))


def write_mjcf(problem: PlanningProblem, file: Path) -> None:
    """The machine of a problem at its start, with the settings that a simulation has unless told otherwise.

    Errors: as of `built`, and `OSError`.
    """
    drive_of(problem.system)
    position, orientation = (
        np.asarray(problem.start[name], dtype=float) for name in ("position", "orientation")
    )
    write_text(file, built(problem.system, position, orientation, MachineSettings()).text)


def _build_leg(
    number: int,
    leg: Leg,
    pose: tuple[Array, Array],
    metres: float,
    settings: MachineSettings,
    parts: Document,
    equality: Element,
) -> Roller | None:
    """One leg from its base joint up to the platform; its roller, if it has one."""
    at = leg.pose(*pose)
    if not leg.pinned and not at.length > 0:
        raise InvalidProblemError(
            f"leg {number} has length zero at the start; no machine has that", path="system.legs"
        )
    frame = _leg_frame(at.g, at.w3)
    seat = Seat(number, leg, metres * at.a, frame, SIZE, settings.press, settings.friction)
    body, roller = BASE_JOINTS[leg.joint].build(seat, parts)
    if leg.pinned:  # the base joint holds the platform itself
        add(body, "inertial", pos=np.zeros(3), mass=CROSS_MASS, diaginertia=np.full(3, 1e-5))
        add(equality, "weld", body1=seat.name, body2="platform", **WELD)
        return roller
    length = metres * float(at.length)
    thin = 0.07 * SIZE
    add(body, "geom", type_="capsule", fromto=(0, 0, 0, 0.6 * length, 0, 0), size=thin, mass=TUBE_MASS)
    rod = add(body, "body", name=f"rod {number}", pos=(length, 0, 0))
    add(rod, "geom", type_="capsule", fromto=(-0.6 * length, 0, 0, 0, 0, 0), size=0.6 * thin, mass=ROD_MASS)
    if leg.length is None:
        add(rod, "joint", name=f"length {number}", type_="slide", axis=(1, 0, 0))
    if leg.actuated:
        servo = {"kp": settings.stiffness, "kv": settings.damping}
        add(parts.actuator, "position", name=f"length {number}", joint=f"length {number}", **servo)
    if at.w4 is None:  # a spherical joint
        add(equality, "connect", body1=rod.get("name"), body2="platform", anchor=np.zeros(3), **WELD)
        return roller
    cross = add(rod, "body", name=f"cross {number}")
    inertia = {"mass": CROSS_MASS, "diaginertia": np.full(3, 1e-5)}
    add(cross, "inertial", pos=np.zeros(3), **inertia)
    add(cross, "joint", name=f"w3 {number}", type_="hinge", axis=(0, 1, 0))
    fork = add(cross, "body", name=f"head {number}")
    add(fork, "inertial", pos=np.zeros(3), **inertia)
    add(fork, "joint", name=f"w4 {number}", type_="hinge", axis=frame.T @ at.w4)
    add(equality, "weld", body1=fork.get("name"), body2="platform", **WELD)
    return roller


def _leg_frame(g: Array, w3: Array | None) -> Array:
    """The columns g, w3, g × w3; of a leg that spins as it likes, any frame with g."""
    if w3 is None:
        spare = np.array([0.0, 0.0, 1.0] if abs(g[2]) < 0.9 else [1.0, 0.0, 0.0])
        w3 = np.cross(g, spare)
        w3 = w3 / np.linalg.norm(w3)
    return np.column_stack([g, w3, np.cross(g, w3)])
