"""Motions as an MCAP recording with JSON messages, which Foxglove and the `mcap` command read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nhpocp.arrays import Array
from nhpocp.errors import MissingDependencyError
from nhpocp.machine.export.motion import Entry, Motion
from nhpocp.machine.export.ros2 import NANOSECONDS, require_seconds
from nhpocp.machine.export.tables import facts
from nhpocp.whole import write_file

NUMBER = {"type": "number"}
POSE = {  # foxglove.PoseInFrame
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "frame_id": {"type": "string"},
        "pose": {
            "type": "object",
            "properties": {
                "position": {"type": "object", "properties": dict.fromkeys("xyz", NUMBER)},
                "orientation": {"type": "object", "properties": dict.fromkeys("xyzw", NUMBER)},
            },
        },
    },
}


def write_mcap(motion: Motion, file: Path) -> None:
    """A message per sample on /motion, a number a column, and on /pose where there is one; metadata "plan".

    Errors: `MissingDependencyError` without the package mcap; `InvalidProblemError` where time is not in seconds.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        words = 'MCAP needs the package mcap; install it with: pip install "nhpocp[export]"'
        raise MissingDependencyError(words) from None
    require_seconds(motion, "MCAP")
    columns = motion.columns()
    channels = [("/motion", "nhpocp.Motion", _schema(columns), _rows(columns))]
    entries = {entry.name: entry.values for entry in motion.entries}
    quaternions, positions = entries.get("orientation_quaternion"), entries.get("position")
    if quaternions is not None and positions is not None and positions.shape[1:] == (3,):
        poses = _poses(motion.times.tolist(), positions, quaternions)
        channels.append(("/pose", "foxglove.PoseInFrame", POSE, poses))
    stamps = [round(time * NANOSECONDS) for time in motion.times.tolist()]

    def write(scratch: Path) -> None:
        with scratch.open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="", library="nhpocp")
            writer.add_metadata("plan", {name: json.dumps(value) for name, value in facts(motion).items()})
            ids = [
                writer.register_channel(
                    topic,
                    "json",
                    writer.register_schema(
                        name, "jsonschema", json.dumps(schema, ensure_ascii=False).encode()
                    ),
                )
                for topic, name, schema, _ in channels
            ]
            together = zip(*(messages for _, _, _, messages in channels), strict=True)
            for k, (stamp, messages) in enumerate(zip(stamps, together, strict=True)):
                for place, message in zip(ids, messages, strict=True):
                    data = json.dumps(message, allow_nan=False).encode()
                    writer.add_message(place, log_time=stamp, publish_time=stamp, sequence=k, data=data)
            writer.finish()

    write_file(file, write)


def _schema(columns: list[Entry]) -> dict[str, Any]:
    described = {
        column.name: {
            **NUMBER,
            "description": f"{column.meaning} [{column.unit}]" if column.unit else column.meaning,
        }
        for column in columns
    }
    return {"type": "object", "properties": described}


def _rows(columns: list[Entry]) -> Iterator[dict[str, Any]]:
    names = [column.name for column in columns]
    values = zip(*(column.values.tolist() for column in columns), strict=True)
    return (dict(zip(names, row, strict=True)) for row in values)


def _poses(times: list[float], positions: Array, quaternions: Array) -> Iterator[dict[str, Any]]:
    for time, position, (w, *xyz) in zip(times, positions.tolist(), quaternions.tolist(), strict=True):
        sec, nsec = divmod(round(time * NANOSECONDS), NANOSECONDS)
        pose = {
            "position": dict(zip("xyz", position, strict=True)),
            "orientation": {**dict(zip("xyz", xyz, strict=True)), "w": w},
        }
        yield {"timestamp": {"sec": sec, "nsec": nsec}, "frame_id": "base", "pose": pose}
