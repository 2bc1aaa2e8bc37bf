"""The picture of a calibration: how far measurements are from the model, before and after it was fitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.machine.calibration.calibration import Calibration
from nhpocp.machine.calibration.noise import KINDS, kinds_of
from nhpocp.views.figures import write_all
from nhpocp.views.labels import axis_label
from nhpocp.views.plots import REFERENCE
from nhpocp.views.style import COLOURS, COMPACT, GREY, PANEL, axes_grid, legend_above, styled

WORDS = {"position": "position", "angle": "orientation", "leg_length": "leg lengths"}
LEAST = 1e-3  # of the noise: what a log axis shows of a residual that is none


def write_calibration_pictures(calibration: Calibration, folder: Path) -> None:
    """The picture `residuals` as the other pictures are written."""
    write_all({"residuals": residuals}, calibration, folder, ("svg", "png"), ("residuals",))


@styled
def residuals(calibration: Calibration) -> Figure:
    """Root mean squares over the numbers of each sample, the runs one after another, on log axes; the noise dashed."""
    kinds: Any = kinds_of(calibration.problem.system)  # type: ignore[arg-type]
    there = [k for k in range(len(KINDS)) if (kinds == k).any()]
    figure, axes = axes_grid(len(there), len(there), PANEL)
    for panel, kind in zip(axes, there, strict=True):
        _panel(panel, calibration, kind, kinds == kind)
        legend_above(panel, **COMPACT)
    return figure


def _panel(axes: Any, calibration: Calibration, kind: int, rows: Array) -> None:
    noise = getattr(calibration.noise, KINDS[kind])
    begun, ticks = 0.0, []
    for i, each in enumerate(calibration.residuals):
        times = each.run.times - each.run.times[0]
        for table, look in (
            (each.before, {"color": GREY, "linewidth": 0.9, "label": "before"}),
            (each.after, {"color": COLOURS[0], "linewidth": 1.1, "label": "fitted"}),
        ):
            sizes = np.sqrt(np.mean(table[:, rows] ** 2, axis=1))
            seen = np.isfinite(sizes)
            style = {**look, "marker": "." if seen.sum() < 30 else None, "markersize": 3}
            if i:
                style["label"] = None
            axes.plot(begun + times[seen], np.maximum(sizes[seen], LEAST * noise), **style)
        ticks.append(begun)
        begun += float(times[-1])
        if i + 1 < len(calibration.residuals):
            axes.axvline(begun, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))
    axes.axhline(noise, label="noise" if calibration.stated else "noise, estimated", **REFERENCE)
    many = len(calibration.residuals) > 1
    axes.set(yscale="log", xlabel=axis_label("time, runs one after another" if many else "time", "", ""))
    units = calibration.problem.units
    unit = "rad" if KINDS[kind] == "angle" else units.words("length", False) or "length"
    axes.set_ylabel(axis_label(f"residual of {WORDS[KINDS[kind]]}", "", unit))
    axes.margins(x=0.0)
