"""The rolling constraint and the leg speeds from geometry alone, [Paper] section 2 and Fig. 1.

A leg's frame is a function of the pose, so its angular velocity along a motion depends on the pose's velocity alone.
It is found here by differencing the frame along the screw motion through the pose with that velocity: neither S nor
J nor G nor K is used, and nothing straddles a discontinuity of the control.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nhpocp.arrays import Array
from nhpocp.systems.numeric import NumericSystem

# Five-point stencil: truncation ~ STEP⁴/30, rounding ~ 1e-16/STEP, both relative to the motion
OFFSETS = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FIRST_DERIVATIVE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
STEP = 3e-4  # radians, or shares of the shortest leg, that the mechanism moves per step
FLOOR = 1e-4  # share of the whole motion under which a leg counts as at rest: 0/0 has no meaning there


def has_legs(system: Any) -> bool:
    """Whether the system is a parallel robot whose legs can be checked (on p and R alone)."""
    return hasattr(system, "legs") and {"position", "orientation"} <= set(system.state_space.names)


def leg_frames(leg: Any, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Length l (…,) and frame (…, 3, 3) with columns g, w3, g×w3, for poses (…, 3) and (…, 3, 3)."""
    reach = positions + rotations @ np.asarray(leg.platform) - np.asarray(leg.base)
    length = np.linalg.norm(reach, axis=-1)
    g = reach / length[..., None]
    w3 = np.cross(g, rotations @ np.asarray(leg.w4))
    w3 /= np.linalg.norm(w3, axis=-1, keepdims=True)
    return length, np.stack([g, w3, np.cross(g, w3)], axis=-1)


def residuals(numeric: NumericSystem, states: Array, controls: Array) -> tuple[Array, Array]:
    """(|r·ω_leg|/|ω_leg| of the worst leg, |l̇ - u|/|u|) at samples, (k,) each.

    Denominators are not let below `FLOOR` times the size of the whole motion, since a leg may rest for an instant;
    without any motion both are 0.
    """
    system = numeric.system
    legs: Any = system.legs  # type: ignore[attr-defined]
    pose = system.state_space.split(states)
    rates = numeric.rate_function.map(len(states))(states.T, controls.T)
    velocity = system.state_space.split(np.array(rates).T)
    p, rotation = pose["position"], pose["orientation"]
    speed, spin = velocity["position"], _angular_velocity(velocity["orientation"], rotation)

    shortest = np.min([leg_frames(leg, p, rotation)[0] for leg in legs], axis=0)
    motion = np.linalg.norm(spin, axis=1) + np.linalg.norm(speed, axis=1) / shortest  # [1/time]
    safe = np.where(motion > 0, motion, 1.0)
    shifts = OFFSETS[:, None] * (STEP / safe)  # [time], offsets × samples
    along = p + shifts[..., None] * speed
    turns = Rotation.from_rotvec((shifts[..., None] * spin).reshape(-1, 3)).as_matrix()
    turned = turns.reshape(*shifts.shape, 3, 3) @ rotation

    def derivative(values: Array) -> Array:
        change = np.tensordot(FIRST_DERIVATIVE, values, axes=1)
        return change / (STEP / safe).reshape(-1, *[1] * (change.ndim - 1))

    rolling, leg_speeds = np.zeros(len(states)), []
    for leg in legs:
        length, frame = leg_frames(leg, along, turned)
        omega = _angular_velocity(derivative(frame), frame[2])
        r = np.asarray(leg.r)
        r = frame[2] @ r if leg.joint == "suslov" else np.broadcast_to(r, omega.shape)
        against = np.abs(np.sum(r * omega, axis=1))
        rolling = np.maximum(rolling, against / np.maximum(np.linalg.norm(omega, axis=1), FLOOR * safe))
        leg_speeds.append(derivative(length))
    u = controls if "u" in system.input_space.names else numeric.outputs(states, controls)["u"]
    off = np.linalg.norm(np.stack(leg_speeds, axis=1) - u, axis=1)
    leg_rate = off / np.maximum(np.linalg.norm(u, axis=1), FLOOR * safe * shortest)
    return rolling, leg_rate


def _angular_velocity(rate: Array, frame: Array) -> Array:
    """ω (k, 3) of Ḟ Fᵀ = [ω]."""
    m = rate @ frame.transpose(0, 2, 1)
    return 0.5 * np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
