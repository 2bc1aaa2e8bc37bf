"""A ball that rolls on a plane, as bodies: a carriage leads its centre, and friction where it touches turns it.

Nothing drives its rotation: the ball hangs in the carriage by a joint without friction, and is pressed down through it.
"""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.simulation.base_joints import GUIDE_DAMPING, Roller
from nhpocp.machine.simulation.built import Built, Drive, head
from nhpocp.machine.simulation.mjcf import add, as_text, axes
from nhpocp.machine.simulation.settings import MachineSettings
from nhpocp.systems.rolling_sphere import RollingSphere

RADIUS = 0.05  # m, of the ball
BALL_MASS, CARRIAGE_MASS = 0.3, 0.2  # kg
SPIN = 0.05  # of the friction against spinning, a length over the radius

DRIVE = Drive("centre", "position", (0, 1), ("x", "y"))


def build_ball(
    system: RollingSphere, position: Array, orientation: Array, settings: MachineSettings
) -> Built:
    """The ball at a place of the plane (2,) [length] and turned so (3, 3). Errors: `InvalidProblemError` for marble."""
    if system.contact != "rubber":
        words = "a marble that spins as it likes cannot be built: nothing drives its spin; expected contact: rubber"
        raise InvalidProblemError(words, path="system.contact")
    metres = RADIUS / system.radius
    root, parts = head(settings)
    add(parts.world, "geom", name="plane", type_="plane", size=(1, 1, 0.01))
    middle = np.array([*(metres * position), RADIUS])
    carriage = add(parts.world, "body", name="carriage", pos=middle)
    add(
        carriage,
        "inertial",
        pos=np.zeros(3),
        mass=CARRIAGE_MASS + settings.payload,
        diaginertia=np.full(3, 1e-4),
    )
    for name, axis in (("x", (1, 0, 0)), ("y", (0, 1, 0))):
        add(carriage, "joint", name=name, type_="slide", axis=axis)
        add(parts.actuator, "position", name=name, joint=name, kp=settings.stiffness, kv=settings.damping)
    add(carriage, "joint", name="press", type_="slide", axis=(0, 0, 1), damping=GUIDE_DAMPING)
    pressed = {"gainprm": 0, "biastype": "affine", "biasprm": [-settings.press, 0, 0]}
    add(parts.actuator, "general", name="press", joint="press", **pressed)
    ball = add(carriage, "body", name="ball", xyaxes=axes(orientation))
    add(ball, "joint", name="ball", type_="ball", armature=1e-6)
    add(ball, "geom", name="rim 1", type_="sphere", size=RADIUS, mass=BALL_MASS)
    add(
        parts.contact,
        "pair",
        name="contact 1",
        geom1="rim 1",
        geom2="plane",
        condim=4,
        friction=[settings.friction] * 2 + [settings.friction * SPIN * RADIUS, 0.0, 0.0],
        solref=(0.002, 1),
        solimp=(0.99, 0.9999, 1e-4),
    )
    down = np.array([0.0, 0.0, -1.0])
    contact = Roller(1, "ball", "world", "carriage", RADIUS * down, down, np.eye(3)[:2])
    return Built(as_text(root), metres, "ball", ("x", "y"), np.array(position, dtype=float), (contact,))
