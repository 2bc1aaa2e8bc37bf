"""A Simulation as a folder inside that of its plan: simulation.json, simulation.csv, simulation.npz, the pictures."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.csv_writer import write_table
from nhpocp.machine.simulation.playing import Simulation
from nhpocp.provenance import environment
from nhpocp.solution_folder import plain, unwritable
from nhpocp.solution_folder.pictures import drawn
from nhpocp.solution_folder.target import SIMULATION, check_target, write_whole

SCHEMA_VERSION = 1
Pictures = Callable[[Simulation, Path], Any]
# what the numbers of each array are of: the driven legs, the rollers, or counted from 1
OF_MOTORS = ("leg_lengths", "planned_leg_lengths", "centre", "planned_centre", "motor_force")
OF_ROLLERS = ("normal_force", "friction_force", "slip_rate", "slip")
UNITS = {
    "t": "s",
    "position": "length",
    "orientation": "",
    "leg_lengths": "length",
    "centre": "length",
    "motor_force": "N",
    "normal_force": "N",
    "friction_force": "N",
    "slip_rate": "length/s",
    "slip": "length",
    "planned_position": "length",
    "planned_orientation": "",
    "planned_leg_lengths": "length",
    "planned_centre": "length",
    "position_error": "length",
    "angle_error": "rad",
}


def save_simulation(
    simulation: Simulation, folder: str | os.PathLike[str], pictures: Pictures | None = None
) -> tuple[Path, list[str]]:
    """Writes FOLDER/simulation, whole or not at all; one that nhpocp wrote before is replaced.

    Its path, and what is missing, in words: pictures for which there is no room. Errors: `InvalidProblemError` for a
    folder that is something else or cannot be written.
    """
    target, missing = Path(folder) / SIMULATION, ""
    check_target(target)

    def write(scratch: Path) -> None:
        nonlocal missing
        _write(simulation, scratch)
        missing = drawn(partial(pictures, simulation), scratch) if pictures is not None else ""

    try:
        write_whole(target, write)
    except OSError as error:
        raise unwritable(target, error) from error
    return target, [missing] if missing else []


def to_json(simulation: Simulation) -> dict[str, Any]:
    """simulation.json as plain data; lengths in the problem's unit, angles in radians, the rest in SI units."""
    position, angle = simulation.worst_following
    return plain(
        {
            "schema_version": SCHEMA_VERSION,
            "name": simulation.solution.problem.name,
            "reached": simulation.reached,
            "outcome": simulation.outcome,
            "position_error": simulation.position_error,
            "angle_error": simulation.angle_error,
            "slip": simulation.slip,
            "worst_position_error": position,
            "worst_angle_error": angle,
            "duration": simulation.duration,
            "tolerance": {"length": simulation.tolerance, "degrees": simulation.tolerance},
            "failure": simulation.failure,
            "plan_converged": simulation.solution.converged,
            "machine": simulation.settings.to_json(),
            "motors": [int(name) if name.isdigit() else name for name in simulation.motors],
            "rollers": list(simulation.rollers),
            "units": {name: UNITS[name] for name in simulation.trajectory},
            "timing": {"simulate_s": simulation.seconds},
            "environment": {**environment(), "engine": simulation.engine},
        }
    )


def _write(simulation: Simulation, folder: Path) -> None:
    text = json.dumps(to_json(simulation), indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "simulation.json").write_text(text + "\n", encoding="utf-8")
    arrays: dict[str, Any] = {name: np.asarray(values) for name, values in simulation.trajectory.items()}
    np.savez_compressed(folder / "simulation.npz", **arrays)
    names = [column for name, values in arrays.items() for column in _columns(simulation, name, values)]
    table = np.column_stack([values.reshape(len(values), -1) for values in arrays.values()])
    with (folder / "simulation.csv").open("w", newline="", encoding="utf-8") as stream:
        write_table(stream, names, table)


def _columns(simulation: Simulation, name: str, values: Any) -> list[str]:
    """The names of an array's numbers: by the leg that they are of, else counted from 1."""
    if name in OF_MOTORS or name in OF_ROLLERS:
        of: tuple[Any, ...] = simulation.motors if name in OF_MOTORS else simulation.rollers
        return [f"{name}_{each}" for each in of]
    places = np.ndindex(*values.shape[1:])
    return ["_".join([name, *(str(index + 1) for index in place)]) for place in places]
