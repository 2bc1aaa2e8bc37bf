"""Motions as tables: CSV, JSON and MATLAB's MAT."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nhpocp.csv_writer import write_table
from nhpocp.machine.export.motion import Motion
from nhpocp.whole import write_file, write_text


def facts(motion: Motion) -> dict[str, Any]:
    """What holds for all samples, plain data."""
    scaling = motion.scaling
    return {
        "name": motion.name,
        "system": motion.system,
        "converged": motion.converged,
        "profile": scaling.profile.name,
        "duration": scaling.duration,
        "plan_duration": scaling.horizon,
        "rate": motion.rate,
        "samples": len(motion.times),
    }


def write_csv(motion: Motion, file: Path) -> None:
    """A header and a row per sample; the columns are those of JSON."""
    columns = motion.columns()

    def write(scratch: Path) -> None:
        with scratch.open("w", encoding="utf-8", newline="") as stream:
            rows = zip(*(column.values.tolist() for column in columns), strict=True)
            write_table(stream, [column.name for column in columns], rows)

    write_file(file, write)


def write_json(motion: Motion, file: Path) -> None:
    """{"schema_version": 1, …`facts`, "columns": [{"name", "unit", "meaning", "values": [a number per sample]}, …]}."""
    columns = [
        {
            "name": column.name,
            "unit": column.unit,
            "meaning": column.meaning,
            "values": column.values.tolist(),
        }
        for column in motion.columns()
    ]
    document = {"schema_version": 1, **facts(motion), "columns": columns}
    write_text(file, json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n")


def write_mat(motion: Motion, file: Path) -> None:
    """An array (samples, …) per quantity, `unit` and `meaning` as structs of texts, and `info`."""
    from scipy.io import savemat

    arrays: dict[str, Any] = {entry.name: entry.values for entry in motion.entries}
    told = {name: value for name, value in facts(motion).items() if name != "system"}
    told["system"] = json.dumps(motion.system)  # names of parameters may be longer than MATLAB's
    arrays |= {
        "unit": {entry.name: entry.unit for entry in motion.entries},
        "meaning": {entry.name: entry.meaning for entry in motion.entries},
        "info": told,
    }

    def write(scratch: Path) -> None:
        with scratch.open("wb") as stream:  # of a name without .mat SciPy would make another
            savemat(stream, arrays, long_field_names=True, oned_as="column")

    write_file(file, write)
