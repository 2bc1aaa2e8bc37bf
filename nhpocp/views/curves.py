"""Panels as JSON for the animation's page, which draws them beside the scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from nhpocp.views.finite_path import thinned
from nhpocp.views.labels import markup, plain_words
from nhpocp.views.panels import Curve, Panel, of_group
from nhpocp.views.style import COLOURS, DASHES

MOST_CURVES = 6  # in one panel


def as_data(every: list[Panel], most: int) -> list[dict[str, Any]]:
    """Controls, legs, error against the goal, distances, margins, in this order; ``more`` marks what can wait.

    Leg lengths stand for all the outputs of a system that has legs, else its outputs, or the numbers of its state.
    ``most``: points of a curve at most.
    """
    legs, outputs = of_group(every, "leg"), of_group(every, "output")
    first = legs[:1] or outputs or of_group(every, "state")
    shown = [*of_group(every, "control"), *first, *of_group(every, "error")]
    shown += [*of_group(every, "distance"), *of_group(every, "margin")]
    rest = [panel for panel in [*legs[1:], *outputs] if panel not in first]
    return [_panel(panel, most, more=panel in rest) for panel in [*shown, *rest]]


def _panel(panel: Panel, most: int, more: bool) -> dict[str, Any]:
    own_units = not panel.unit
    return {
        "name": panel.name,
        "title": markup(panel.label),
        "words": plain_words(panel.label),
        "curves": [_curve(curve, i, most, own_units) for i, curve in enumerate(panel.curves[:MOST_CURVES])],
        "marks": [
            {"t": mark.time, "words": plain_words(mark.words), "alarm": mark.alarm} for mark in panel.marks
        ],
        "zero": panel.zero or (panel.margin and not panel.log),
        "log": panel.log,
        "more": more,
    }


def _curve(curve: Curve, place: int, most: int, own_unit: bool) -> dict[str, Any]:
    chosen = thinned(len(curve.times), most)
    return {
        "label": markup(curve.symbol),
        "unit": curve.unit if own_unit else "",
        "colour": COLOURS[place % len(COLOURS)],
        "dash": _dash(DASHES[place % len(DASHES)]),
        "t": [float(f"{time:.7g}") for time in curve.times[chosen]],
        "y": [float(f"{value:.6g}") if np.isfinite(value) else None for value in curve.values[chosen]],
    }


def _dash(dashes: Any) -> str:
    """Matplotlib's dashes as SVG has them, for lines a little thicker."""
    return "" if dashes == "-" else " ".join(f"{1.5 * length:.3g}" for length in dashes[1])
