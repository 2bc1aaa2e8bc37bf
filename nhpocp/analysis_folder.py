"""An Analysis as a folder: analysis.json, map.npz where there is a map, and the pictures."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nhpocp.analysis import Analysis
from nhpocp.solution_folder import check_target, plain, unwritable
from nhpocp.solution_folder.pictures import drawn
from nhpocp.solution_folder.target import write_whole
from nhpocp.systems.margins import det, sigma

Pictures = Callable[[Analysis, Path], Any]


def save_analysis(
    analysis: Analysis, folder: str | os.PathLike[str], pictures: Pictures | None = None
) -> list[str]:
    """Writes the folder, whole or not at all; one that nhpocp wrote before is replaced.

    What is missing is returned, in words: pictures for which there is no room. Errors: `InvalidProblemError` for a
    folder that is something else or cannot be written.
    """
    target, missing = Path(folder), ""
    check_target(target)

    def write(scratch: Path) -> None:
        nonlocal missing
        _write(analysis, scratch)
        missing = drawn(partial(pictures, analysis), scratch) if pictures is not None else ""

    try:
        write_whole(target, write)
    except OSError as error:
        raise unwritable(target, error) from error
    return [missing] if missing else []


def _write(analysis: Analysis, folder: Path) -> None:
    text = json.dumps(plain(analysis.to_json()), indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "analysis.json").write_text(text + "\n", encoding="utf-8")
    surfaces = analysis.map
    if surfaces is not None:
        arrays: dict[str, Any] = {
            surfaces.first.name: surfaces.first_values,
            surfaces.second.name: surfaces.second_values,
            **{det(name).name: values for name, values in surfaces.determinants.items()},
            **{sigma(name).name: values for name, values in surfaces.margins.items()},
        }
        np.savez_compressed(folder / "map.npz", **arrays)
