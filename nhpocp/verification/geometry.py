"""The rolling constraint and the leg speeds from geometry alone, [Paper] section 2 and Fig. 1.

A leg's frame is a function of the pose, so its angular velocity along a motion depends on the pose's velocity alone.
It is found here by differencing the frame along the screw motion through the pose with that velocity: neither S nor
J nor G nor K is used, and nothing straddles a discontinuity of the control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nhpocp.arrays import Array
from nhpocp.systems.numeric import NumericSystem

# Five-point stencil: truncation ~ STEP⁴/30, rounding ~ 1e-16/STEP, both relative to the motion
OFFSETS = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FIRST_DERIVATIVE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
STEP = 1e-3  # radians, or fractions of the shortest leg, that the mechanism moves per step
# beside its own w4, at an angle of sine b, a leg's frame turns 1/b as fast: truncation ~ STEP⁴/b⁵, rounding 1/(b STEP)
NEAREST, SHORTER = 1e-4, 0.8  # the least b that counts, and the power of it by which the step is shorter
FLOOR = 1e-4  # fraction of the whole motion under which a leg counts as at rest: 0/0 has no meaning there


def has_legs(system: Any) -> bool:
    """Whether the system is a parallel robot whose legs can be checked (on p and R alone)."""
    return hasattr(system, "legs") and "orientation" in system.state_space.names


def leg_frames(leg: Any, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Length l (…,) and frame (…, 3, 3) with columns g, w3, g×w3, for poses (…, 3) and (…, 3, 3).

    The platform's own frame for a leg that spins as it likes (no axis w4 in the platform), and for none at all.
    """
    reach = positions + rotations @ np.asarray(leg.platform) - np.asarray(leg.base)
    length = np.linalg.norm(reach, axis=-1)
    if leg.w4 is None:
        return length, rotations
    g = reach / length[..., None]
    w3 = np.cross(g, rotations @ np.asarray(leg.w4))
    w3 /= np.linalg.norm(w3, axis=-1, keepdims=True)
    return length, np.stack([g, w3, np.cross(g, w3)], axis=-1)


def _universal_normal(leg: Any, frame: Array) -> Array:
    """The perpendicular of both axes."""
    r = np.cross(np.asarray(leg.w1), frame @ np.asarray(leg.w2))
    return r / np.linalg.norm(r, axis=-1, keepdims=True)


# by base joint, r (k, 3) from frames (k, 3, 3): the direction about which the joint cannot turn
NORMALS: dict[str, Callable[[Any, Array], Array]] = {
    "veselova": lambda leg, frame: np.broadcast_to(np.asarray(leg.r), frame.shape[:2]),
    "suslov": lambda leg, frame: frame @ np.asarray(leg.r),
    "universal": _universal_normal,
}


@dataclass(frozen=True)
class _Motion:
    """The screw motions through samples: poses (5, k, …) around each, and how to differentiate along them."""

    positions: Array
    rotations: Array
    step: Array  # [time], (k,)

    def derivative(self, values: Array) -> Array:
        change = np.tensordot(FIRST_DERIVATIVE, values, axes=1)
        return change / self.step.reshape(-1, *[1] * (change.ndim - 1))


def residuals(numeric: NumericSystem, states: Array, controls: Array) -> tuple[Array, Array]:
    """(|r·ω_leg|/|ω_leg| of the worst leg, |l̇ - u|/|u|) at samples, (k,) each; u = 0 for legs that are bars.

    Denominators are not let below `FLOOR` times the size of the whole motion, since a leg may rest for an instant;
    without any motion both are 0. Where the base joint holds the platform itself, its centre counts as a leg's length.
    """
    system = numeric.system
    legs: Any = system.legs  # type: ignore[attr-defined]
    pose = system.state_space.split(states)
    rates = numeric.rate_function.map(len(states))(states.T, controls.T)
    velocity = system.state_space.split(np.array(rates).T)
    rotation, rest = pose["orientation"], np.zeros((len(states), 3))  # a wrist has no position
    p, speed = pose.get("position", rest), velocity.get("position", rest)
    spin = _angular_velocity(velocity["orientation"], rotation)

    shortest = np.min([leg_frames(leg, p, rotation)[0] for leg in legs if leg.length != 0], axis=0)
    size = np.linalg.norm(spin, axis=1) + np.linalg.norm(speed, axis=1) / shortest  # [1/time]
    safe = np.where(size > 0, size, 1.0)
    step = STEP * _apart(legs, p, rotation) ** SHORTER / safe  # [time]
    shifts = OFFSETS[:, None] * step  # offsets × samples
    turns = Rotation.from_rotvec((shifts[..., None] * spin).reshape(-1, 3)).as_matrix()
    turned = turns.reshape(*shifts.shape, 3, 3) @ rotation
    motion = _Motion(p + shifts[..., None] * speed, turned, step)

    rolling = np.zeros(len(states))
    driven: list[Array] = []
    held: list[Array] = []
    for leg in legs:
        length, frame = leg_frames(leg, motion.positions, motion.rotations)
        if leg.joint in NORMALS and (leg.w4 is not None or leg.length == 0):
            omega = _angular_velocity(motion.derivative(frame), frame[2])
            against = np.abs(np.sum(NORMALS[leg.joint](leg, frame[2]) * omega, axis=1))
            rolling = np.maximum(rolling, against / np.maximum(np.linalg.norm(omega, axis=1), FLOOR * safe))
        if leg.length == 0:
            centre = motion.positions + motion.rotations @ np.asarray(leg.platform)
            held += list(motion.derivative(centre).T)
        elif leg.actuated or leg.length is not None:
            (driven if leg.actuated else held).append(motion.derivative(length))
    u = controls if "u" in system.input_space.names else numeric.outputs(states, controls)["u"]
    off = np.linalg.norm(np.column_stack([np.stack(driven, axis=1) - u, *held]), axis=1)
    return rolling, off / np.maximum(np.linalg.norm(u, axis=1), FLOOR * safe * shortest)


def _apart(legs: Any, positions: Array, rotations: Array) -> Array:
    """The least sine (k,) of the angle between a leg and its w4, beside which w3 = g × w4 turns as much faster."""
    least = np.ones(len(positions))
    for leg in legs:
        if leg.w4 is not None and leg.length != 0:
            reach = positions + rotations @ np.asarray(leg.platform) - np.asarray(leg.base)
            across = np.linalg.norm(np.cross(reach, rotations @ np.asarray(leg.w4)), axis=-1)
            least = np.minimum(least, across / np.linalg.norm(reach, axis=-1) / np.linalg.norm(leg.w4))
    return np.maximum(least, NEAREST)


def _angular_velocity(rate: Array, frame: Array) -> Array:
    """ω (k, 3) of Ḟ Fᵀ = [ω]."""
    m = rate @ frame.transpose(0, 2, 1)
    return 0.5 * np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
