"""Motions as a message of ROS 2, trajectory_msgs/JointTrajectory, in the YAML of `ros2 topic pub`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.motion import Joint, Motion
from nhpocp.whole import write_text

NANOSECONDS = 1_000_000_000


def write_yaml(motion: Motion, file: Path) -> None:
    """One message: joint_names, and a point per sample with positions, velocities, accelerations and its time.

    Errors: `InvalidProblemError` for a motion without joints, or one whose time is not counted in seconds.
    """
    joints = required_joints(motion, "a JointTrajectory")
    require_seconds(motion, "ROS")
    names = ", ".join(json.dumps(joint.name) for joint in joints)
    units = ", ".join(f"{joint.name} [{joint.unit}]" if joint.unit else joint.name for joint in joints)
    lines = [
        f"# trajectory_msgs/msg/JointTrajectory of {json.dumps(motion.name)}, by nhpocp; positions: {units}",
        "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
        f"joint_names: [{names}]",
        "points:",
    ]
    tables = [
        list(zip(*(getattr(joint, name).tolist() for joint in joints), strict=True))
        for name in ("position", "velocity", "acceleration")
    ]
    for time, *rows in zip(motion.times.tolist(), *tables, strict=True):
        sec, nanosec = divmod(round(time * NANOSECONDS), NANOSECONDS)
        positions, velocities, accelerations = map(_numbers, rows)
        lines += [
            f"- positions: {positions}",
            f"  velocities: {velocities}",
            f"  accelerations: {accelerations}",
            "  effort: []",
            f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}",
        ]
    write_text(file, "\n".join(lines) + "\n")


def required_joints(motion: Motion, what: str) -> tuple[Joint, ...]:
    """Errors: `InvalidProblemError` for a motion without joints."""
    if not motion.joints:
        raise InvalidProblemError(
            f"{what} moves joints, and {motion.system['model']} has a rotation in its state and no legs with motors; "
            "csv, json, mat and mcap hold its pose",
            path="--format",
        )
    return motion.joints


def require_seconds(motion: Motion, who: str) -> None:
    """Errors: `InvalidProblemError` where a unit of time is stated that is not the second."""
    if motion.units.time not in (None, "s"):
        words = f"{who} counts seconds, and this problem's time is in {motion.units.time}; plan in s"
        raise InvalidProblemError(words, path="--format")


def _numbers(values: Iterable[float]) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    """As YAML 1.1 reads it, which takes 1e-05 for a text and 1.0e-05 for a number."""
    mantissa, exponent, power = repr(value).partition("e")
    return mantissa + ("" if "." in mantissa or not exponent else ".0") + exponent + power
