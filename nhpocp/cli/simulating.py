"""The verb `simulate`: a stored plan on a machine of bodies, joints and contacts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.machine_options import machine_options, machine_settings, numbers
from nhpocp.cli.options import json_option
from nhpocp.cli.progress import counter
from nhpocp.cli.terminal import put, say, tell

if TYPE_CHECKING:
    from nhpocp.machine.simulation import Simulation


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--duration", type=float, default=10.0, show_default=True, help="Of the play [s].")
@click.option(
    "--tolerance",
    type=float,
    default=5e-3,
    show_default=True,
    help="By how much the end may miss the plan's, in units of length and in degrees.",
)
@machine_options
@click.option(
    "--noise",
    default="0",
    show_default=True,
    metavar="LENGTH[,ANGLE]",
    help="Standard deviations of the measured position and orientation: 0.01,0.1deg.",
)
@click.option(
    "--error",
    multiple=True,
    metavar="NAME=VALUE,...",
    help="The machine differs from the model: roller_tilt=2deg,base_radius=1%. Repeatable.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the noise.")
@click.option(
    "--mjcf", type=click.Path(path_type=Path), metavar="FILE", help="Write the machine there, as MJCF."
)
@json_option
def simulate(
    folder: Path, duration: float, tolerance: float, mjcf: Path | None, as_json: bool, **given: Any
) -> int:
    """Play the plan in DIR on a machine of bodies, joints and contacts (extra: physics).

    The machine is built of where the joints are, at the plan's start; its motors follow the plan's leg lengths. Writes
    what it does into DIR/simulation. Exit status 0 if it ends where a converged plan does, within the tolerance.
    """
    from nhpocp.interruption import Interruption
    from nhpocp.machine.simulation import play
    from nhpocp.simulation_folder import save_simulation
    from nhpocp.solution_folder import check_target, load_solution, unwritable
    from nhpocp.solution_folder.target import SIMULATION
    from nhpocp.whole import write_text

    position, orientation = numbers(given["noise"], "--noise")
    more = {
        "noise": (position, orientation or 0.0),
        "errors": ",".join(given["error"]),
        "seed": given["seed"],
    }
    settings = machine_settings(given, **more)
    solution = load_solution(folder)
    check_target(folder / SIMULATION)
    with Interruption() as stop:
        with counter(as_json, "step") as show:
            played = play(solution, settings, duration=duration, tolerance=tolerance, progress=show)
        stop.patient = True  # what was measured is written
        written, missing = save_simulation(played, folder, _pictures)
    for sentence in missing:
        say(f"warning: {sentence}")
    if mjcf is not None:
        try:
            write_text(mjcf, played.model)
        except OSError as error:
            raise unwritable(mjcf, error) from error
    if as_json:
        put(_json(played, written))
    else:
        tell("\n".join([*_lines(played), f"  written: {written}"]))
    return SOLVED if played.reached else NOT_SOLVED


def _pictures(played: Simulation, folder: Path) -> None:
    from nhpocp.views.simulation_figures import write_simulation_pictures  # once the numbers are written
    from nhpocp.views.simulation_page import write_simulation_page

    write_simulation_pictures(played, folder)
    write_simulation_page(played, folder / "animation.html")


def _json(played: Simulation, written: Path) -> dict[str, Any]:
    from nhpocp.simulation_folder import to_json

    return {"folder": str(written), **to_json(played)}


def _lines(played: Simulation) -> list[str]:
    position, angle = played.worst_following
    end = _off(played, played.position_error, played.angle_error)
    said = "reached the plan's end" if played.reached else "missed the plan's end"
    if played.interrupted:
        said = "was stopped on its way"
    elif not played.solution.converged:
        said = "followed a plan that does not reach its goal"
    lines = [
        f"{played.solution.problem.name}: the machine {said}, {end}",
        f"  played over {played.duration:g} s; on the way {_off(played, position, angle)}; slip {played.slip:.2g}",
        f"  simulated in {played.seconds:.1f} s by {played.engine}",
    ]
    return [*lines, f"  {played.failure}"] if played.failure else lines


def _off(played: Simulation, position: float, angle: float) -> str:
    unit = played.solution.problem.units.length
    return f"off by {position:.3g}{f' {unit}' if unit else ''} and {math.degrees(angle):.3g}°"
