"""The verb `calibrate`: a robot's parameters from what was measured of its runs."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

import click

from nhpocp.cli.exit_status import NOT_SOLVED, SOLVED
from nhpocp.cli.options import json_option, load, set_option
from nhpocp.cli.terminal import put, say, tell

if TYPE_CHECKING:
    from nhpocp.machine.calibration.calibration import Calibration, Estimate


@click.command(
    epilog="Exit status: 0 if the fit converged and everything that was asked for is seen by the data; else 1."
)
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("tables", metavar="MEASURED.csv...", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "--fit",
    metavar="NAME,...",
    help="What to fit: parameters of all legs (roller_tilt), of one or each (roller_tilt[2], roller_tilt[each]), "
    "joints (base, platform[1], base[1].x), directions (r, w4), encoders (leg_offset).  [default: base_radius, "
    "platform_radius, roller_tilt; of unlike legs base, platform, r]",
)
@click.option(
    "--noise",
    metavar="POSITION,ANGLE[,LEG]",
    help="Standard deviations of what was measured, such as 0.01,0.1deg.  [default: estimated from the residuals]",
)
@set_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The folder for calibration.json and fitted.yaml."
)
@json_option
def calibrate(
    file: Path,
    tables: tuple[Path, ...],
    fit: str | None,
    noise: str | None,
    overrides: tuple[str, ...],
    output: Path | None,
    as_json: bool,
) -> int:
    """Fit the robot of FILE to runs that were measured, a CSV file each.

    Columns: t; leg_lengths_1 and so on; position_1 to _3; orientation_1_1 to _3_3, or a quaternion, or roll, pitch,
    yaw: as `simulate`, `export` and `solve` write them. Poses may be missing, but for the first. Writes the parameters
    with their standard deviations, what the data cannot see, and FILE with the fitted robot. Default folder:
    results/NAME/calibration.
    """
    from nhpocp.calibration_folder import save_calibration, to_json
    from nhpocp.interruption import Interruption
    from nhpocp.machine.calibration.calibration import Calibrating
    from nhpocp.measured_table import read_measurements
    from nhpocp.solution_folder import check_target, folder_name

    problem = load(file, overrides)
    home = output or Path("results") / folder_name(problem.name) / "calibration"
    check_target(home)
    calibrating = Calibrating.of(problem, fit, noise)
    runs = [read_measurements(table, calibrating.unknowns.system) for table in tables]
    with Interruption() as stop:
        calibration = calibrating.run(runs)
        stop.patient = True  # what was found is written
        missing = save_calibration(calibration, home, _pictures if problem.pictures else None)
    for sentence in missing:
        say(f"warning: {sentence}")
    if as_json:
        put({"folder": str(home), **to_json(calibration)})
    else:
        _tell(calibration, home)
    return SOLVED if calibration.fitted else NOT_SOLVED


def _pictures(calibration: Calibration, folder: Path) -> None:
    from nhpocp.views.calibration_figures import write_calibration_pictures  # once the numbers are written

    write_calibration_pictures(calibration, folder)


def _tell(calibration: Calibration, home: Path) -> None:
    tell(f"{calibration.problem.name}: {calibration.outcome.value}")
    tell(f"  {calibration.message}")
    width = max(len(each.name) for each in calibration.estimates)
    tell(f"  {'':{width}s}  before        fitted        standard deviation")
    for each in calibration.estimates:
        tell(f"  {each.name:{width}s}  {_numbers(each)}")
    for kind, name in enumerate(("position", "angle", "leg length")):
        before, after = calibration.size(kind, False), calibration.size(kind)
        said = "stated" if calibration.stated else "estimated"
        noise = (calibration.noise.position, calibration.noise.angle, calibration.noise.leg_length)[kind]
        tell(f"  residuals of {name}: {before:.3g} before, {after:.3g} fitted; noise {noise:.3g} ({said})")
    for doubt in calibration.doubts:
        say(f"warning: {doubt}")
    tell(f"  written: {home}")


def _numbers(each: Estimate) -> str:
    """Before, fitted and deviation; angles in radians and degrees."""
    deviation = f"{each.deviation:.2g}" if each.seen else "not seen"
    row = f"{each.before:<12.8g}  {each.value:<12.8g}  {deviation}"
    if each.unknown.unit != "angle":
        return row
    angles = [f"{degrees(each.before):.7g}", f"{degrees(each.value):.7g}"]
    return f"{row}  ({'; '.join([*angles, f'{degrees(each.deviation):.2g}'][: 3 if each.seen else 2])} deg)"
