"""Motions as one C99 header: a table of the joints and the function that interpolates it. Needs no other file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from string import Template

from nhpocp.arrays import Array
from nhpocp.csv_writer import identifiers
from nhpocp.machine.export.motion import Motion
from nhpocp.machine.export.ros2 import required_joints
from nhpocp.whole import write_text

HEADER = Template("""\
/* Motion of $title by nhpocp: $profile, duration $duration [$time].
 * Joints:
$joints
 * C99. Cubic Hermite interpolation of positions and velocities; include this file where it is called. */
#ifndef ${upper}_H
#define ${upper}_H

#define ${upper}_JOINTS $count
#define ${upper}_SAMPLES $samples
#define ${upper}_DURATION $duration

static const double ${name}_time[${upper}_SAMPLES] = {
$times
};

static const double ${name}_position[${upper}_SAMPLES][${upper}_JOINTS] = {
$positions
};

static const double ${name}_velocity[${upper}_SAMPLES][${upper}_JOINTS] = {
$velocities
};

/* Position and velocity at time t; before the start and after the end it rests at that place. Either may be null. */
static inline void ${name}_at(double t, double position[${upper}_JOINTS], double velocity[${upper}_JOINTS])
{
    int low = 0, high = ${upper}_SAMPLES - 1;
    const int outside = !(t >= 0.0 && t <= ${upper}_DURATION);
    if (!(t > 0.0)) {
        t = 0.0;
    } else if (t > ${upper}_DURATION) {
        t = ${upper}_DURATION;
    }
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (${name}_time[middle] <= t) {
            low = middle;
        } else {
            high = middle;
        }
    }
    {
        const double h = ${name}_time[high] - ${name}_time[low];
        const double z = (t - ${name}_time[low]) / h;
        const double w = 1.0 - z;
        for (int i = 0; i < ${upper}_JOINTS; i++) {
            const double p0 = ${name}_position[low][i], p1 = ${name}_position[high][i];
            const double v0 = ${name}_velocity[low][i], v1 = ${name}_velocity[high][i];
            if (position) {
                position[i] = w * w * (1.0 + 2.0 * z) * p0 + z * z * (3.0 - 2.0 * z) * p1
                    + h * z * w * (w * v0 - z * v1);
            }
            if (velocity) {
                velocity[i] = outside ? 0.0
                    : 6.0 * z * w * (p1 - p0) / h + w * (1.0 - 3.0 * z) * v0 + z * (3.0 * z - 2.0) * v1;
            }
        }
    }
}

#endif
""")


def write_header(motion: Motion, file: Path) -> None:
    """NAME_at(t, position, velocity) and its table; NAME is `motion_` and the problem's.

    Errors: `InvalidProblemError` for a motion without joints.
    """
    joints = required_joints(motion, "the table")
    (name,) = identifiers([f"motion_{motion.name}"])
    positions, velocities = (
        zip(*(getattr(joint, kind).tolist() for joint in joints), strict=True)
        for kind in ("position", "velocity")
    )
    text = HEADER.substitute(
        title=_comment(motion.name),
        profile=motion.scaling.profile.name,
        duration=repr(float(motion.scaling.duration)),
        time=_comment(motion.units.time or "time"),
        joints="\n".join(
            f" *   {i}: {_comment(joint.name)}" + (f" [{_comment(joint.unit)}]" if joint.unit else "")
            for i, joint in enumerate(joints)
        ),
        name=name,
        upper=name.upper(),
        count=len(joints),
        samples=len(motion.times),
        times=_times(motion.times),
        positions=_rows(positions),
        velocities=_rows(velocities),
    )
    write_text(file, text)


def _times(times: Array) -> str:
    return ",\n".join(f"    {time!r}" for time in times.tolist())


def _rows(rows: Iterable[Iterable[float]]) -> str:
    return ",\n".join(f"    {{{', '.join(map(repr, row))}}}" for row in rows)


def _comment(text: str) -> str:
    """A text that ends no comment, and whose characters every compiler reads."""
    return re.sub(r"[^ -~]|[*/\\?]", "_", text)
