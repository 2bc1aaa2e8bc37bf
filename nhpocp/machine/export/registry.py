"""The file formats of a motion, each announced in one line and imported when it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nhpocp.plugins import imported

if TYPE_CHECKING:
    from nhpocp.machine.export.motion import Motion

NAME = "motion"  # of the files, in a solution folder


@dataclass(frozen=True)
class Format:
    """A file format: how its files end, and the function "module:name" of a motion and a file that writes one."""

    ending: str
    writer: str
    meaning: str

    @property
    def file_name(self) -> str:
        """What a file is called unless somebody says."""
        return f"{NAME}.{self.ending}"

    @property
    def write(self) -> Callable[[Motion, Path], None]:
        """Writes a file. Errors: `OSError`, `InvalidProblemError`, `MissingDependencyError`."""
        return imported(self.writer)


FORMATS = {
    "csv": Format("csv", "nhpocp.machine.export.tables:write_csv", "a row per sample"),
    "json": Format("json", "nhpocp.machine.export.tables:write_json", "every column with unit and meaning"),
    "mat": Format("mat", "nhpocp.machine.export.tables:write_mat", "MATLAB, an array per quantity"),
    "ros2": Format("yaml", "nhpocp.machine.export.ros2:write_yaml", "trajectory_msgs/JointTrajectory"),
    "mcap": Format(
        "mcap", "nhpocp.machine.export.recording:write_mcap", "a message per sample, for Foxglove"
    ),
    "c": Format("h", "nhpocp.machine.export.c_header:write_header", "C99, a table and its interpolation"),
}
