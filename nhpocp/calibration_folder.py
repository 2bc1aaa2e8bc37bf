"""A Calibration as a folder: calibration.json, residuals.csv, the problem with the fitted robot, a picture."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.csv_writer import write_table
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.calibration.calibration import Calibration, Ending
from nhpocp.machine.calibration.identifiability import correlations
from nhpocp.machine.calibration.noise import KINDS
from nhpocp.problem_file import dump_problem, parse_problem
from nhpocp.problem_file.dumping import write_data
from nhpocp.problem_file.overrides import apply
from nhpocp.provenance import environment
from nhpocp.solution_folder import check_target, plain, unwritable
from nhpocp.solution_folder.pictures import drawn
from nhpocp.solution_folder.target import CALIBRATION, write_whole
from nhpocp.systems.system import System

SCHEMA_VERSION = 1
DATA, TABLE, FITTED = CALIBRATION

Pictures = Callable[[Calibration, Path], Any]


def save_calibration(calibration: Calibration, home: Path, pictures: Pictures | None = None) -> list[str]:
    """Writes the folder, whole or not at all; one that nhpocp wrote before is replaced.

    What is missing is returned, in words. Errors: `InvalidProblemError` for a folder that is something else or cannot
    be written.
    """
    missing: list[str] = []
    check_target(home)
    text, why = fitted_text(calibration)

    def write(scratch: Path) -> None:
        data = json.dumps(to_json(calibration), indent=1, allow_nan=False, ensure_ascii=False)
        (scratch / DATA).write_text(data + "\n", encoding="utf-8")
        with (scratch / TABLE).open("w", newline="", encoding="utf-8") as stream:
            write_table(stream, _columns(calibration), _rows(calibration))
        if text:
            (scratch / FITTED).write_text(text, encoding="utf-8", newline="")
        if pictures is not None and (words := drawn(partial(pictures, calibration), scratch)):
            missing.append(words)

    try:
        write_whole(home, write)
    except OSError as error:
        raise unwritable(home, error) from error
    return [*missing, *([why] if why else [])]


def fitted_text(calibration: Calibration) -> tuple[str, str]:
    """The problem's file with the fitted robot in it, all else kept; and what is wrong with it, in words."""
    problem = calibration.problem
    if calibration.system is None:
        return "", f"there is no {FITTED}: no robot has these parameters"
    if calibration.outcome in (Ending.NOT_CONVERGED, Ending.INTERRUPTED):
        return "", f"there is no {FITTED}: the fit did not come to its end"
    if problem.source is None:
        try:
            text = dump_problem(problem.with_(system=calibration.system))
        except InvalidProblemError as error:
            return "", f"there is no {FITTED}: {error}"
        return text, ""
    text = apply(problem.source, _overrides(calibration.system, calibration.changes), None)[0].text
    try:
        parse_problem(text)
    except InvalidProblemError as error:
        return text, f"{FITTED} needs more changes: {error}"
    return text, ""


def _overrides(system: System, changes: Mapping[str, Any]) -> list[str]:
    """The changes as `--set` takes them: angles in degrees; of legs the whole robot, which nothing may stand beside."""
    if "legs" in changes:
        whole = {"model": system.model, **system.parameters()}
        flow = write_data({"system": whole}).partition(":")[2].strip()
        return [f"system={flow}"]
    return [
        f"system.{name}={f'{degrees(value)!r} deg' if system.declared[name].unit == 'angle' else repr(value)}"
        for name, value in changes.items()
    ]


def to_json(calibration: Calibration) -> Any:
    """calibration.json as plain data; lengths in the problem's unit, angles in radians."""
    names = [each.name for each in calibration.estimates]
    seen = {each.name for each in calibration.estimates if each.seen}
    close = [pair for pair in correlations(calibration.covariance, names) if seen.issuperset(pair[:2])]
    units = calibration.problem.units
    return plain(
        {
            "schema_version": SCHEMA_VERSION,
            "name": calibration.problem.name,
            "outcome": calibration.outcome.value,
            "message": calibration.message,
            "parameters": [
                {
                    "name": each.name,
                    "unit": units.words(each.unknown.unit) or each.unknown.unit,
                    "before": each.before,
                    "value": each.value,
                    "standard_deviation": each.deviation,
                    "seen": each.seen,
                }
                for each in calibration.estimates
            ],
            "covariance": calibration.covariance,
            "correlations": [{"parameters": [one, other], "value": value} for one, other, value in close],
            "directions": [
                {"singular_value": each.value, "seen": each.seen, "parts": dict(each.parts)}
                for each in calibration.directions
            ],
            "noise": {
                **{kind: getattr(calibration.noise, kind) for kind in KINDS},
                "estimated": not calibration.stated,
            },
            "variance": calibration.variance,
            "residuals": {
                when: {kind: calibration.size(k, after) for k, kind in enumerate(KINDS)}
                for when, after in (("before", False), ("after", True))
            },
            "runs": [
                {
                    "name": each.run.name,
                    "samples": len(each.run.times),
                    "poses": int(each.run.posed.sum()),
                    "every": each.run.every,
                }
                for each in calibration.residuals
            ],
            "doubts": list(calibration.doubts),
            "system": (
                {"model": calibration.system.model, **calibration.system.parameters()}
                if calibration.system
                else None
            ),
            "environment": environment(None),
        }
    )


def _columns(calibration: Calibration) -> list[str]:
    space, motors = calibration.problem.system.state_space, calibration.residuals[0].after.shape[1]
    names = [label.replace("[", "_").replace("]", "") for label in space.tangent_labels]
    numbers = [_counted(name) for name in names]
    numbers += [f"leg_lengths_{i + 1}" for i in range(motors - space.dimension)]
    return ["run", "t", *(f"{name}_before" for name in numbers), *(f"{name}_after" for name in numbers)]


def _counted(name: str) -> str:
    """position_0 as position_1."""
    stem, _, number = name.rpartition("_")
    return f"{stem}_{int(number) + 1}" if number.isdecimal() else name


def _rows(calibration: Calibration) -> Iterator[list[Any]]:
    for each in calibration.residuals:
        for time, before, after in zip(each.run.times, each.before, each.after, strict=True):
            yield [each.run.name, float(time), *np.concatenate([before, after]).tolist()]
