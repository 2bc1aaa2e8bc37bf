"""The file formats of a plan and of what belongs to it, each announced in one line and imported when it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nhpocp.plugins import imported

NAME = "motion"  # of the files, in a solution folder


@dataclass(frozen=True)
class Format:
    """A file format: how its files end, and the function "module:name" that writes one."""

    ending: str
    writer: str
    meaning: str
    stem: str = NAME

    @property
    def file_name(self) -> str:
        """What a file is called unless somebody says."""
        return f"{self.stem}.{self.ending}"

    @property
    def write(self) -> Callable[..., Any]:
        """Writes a file, its last argument. Errors: `OSError`, `InvalidProblemError`, `MissingDependencyError`."""
        return imported(self.writer)


FORMATS = {  # of a `Motion`
    "csv": Format("csv", "nhpocp.machine.export.tables:write_csv", "a row per sample"),
    "json": Format("json", "nhpocp.machine.export.tables:write_json", "every column with unit and meaning"),
    "mat": Format("mat", "nhpocp.machine.export.tables:write_mat", "MATLAB, an array per quantity"),
    "ros2": Format("yaml", "nhpocp.machine.export.ros2:write_yaml", "trajectory_msgs/JointTrajectory"),
    "mcap": Format(
        "mcap", "nhpocp.machine.export.recording:write_mcap", "a message per sample, for Foxglove"
    ),
    "c": Format("h", "nhpocp.machine.export.c_header:write_header", "C99, a table and its interpolation"),
}
MACHINES = {  # of a `PlanningProblem`
    "mjcf": Format(
        "xml", "nhpocp.machine.simulation.building:write_mjcf", "the machine for MuJoCo", stem="machine"
    ),
}
PLANNERS = {  # of a `PlanningProblem` and a `Solver`
    "c-planner": Format(
        "c",
        "nhpocp.machine.export.planner.c_planner:write_planner",
        "C99 that plans to any goal, and its header",
        stem="planner",
    ),
}
