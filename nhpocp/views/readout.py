"""The numbers behind a figure, for the page's script that shows them under the pointer."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.views.labels import plain_words

POINTS = 72.0  # per inch, the unit of an SVG of matplotlib's
DIGITS, PLACES = 4, 5  # significant digits of values, and of times or iterations


def readout(figure: Figure, abscissa: str) -> dict[str, Any] | None:
    """Every labelled line of a figure that has been drawn, as plain data; None where there is none.

    abscissa: the name of what runs along the x axes, t or k. Values at a k that was not recorded are not made up;
    over t they are interpolated. A panel's ``x`` and ``y`` map a number, or its logarithm to base ten, to the SVG:
    ``[offset, factor, 1 for a logarithm, else 0]``. Curves name their abscissas by their place in ``xs``.
    """
    xs: list[list[float | None]] = []
    panels = [_panel(figure, axes, xs) for axes in figure.axes]
    panels = [panel for panel in panels if panel["curves"]]
    if not panels:
        return None
    return {"abscissa": abscissa, "interpolate": abscissa == "t", "xs": xs, "panels": panels}


def _panel(figure: Figure, axes: Any, xs: list[list[float | None]]) -> dict[str, Any]:
    curves = []
    for line in axes.get_lines():
        if str(line.get_label()).startswith("_"):
            continue  # matplotlib's own names: references and bounds
        times, values = _short(line.get_xdata(), PLACES), _short(line.get_ydata(), DIGITS)
        if not any(value is not None for value in values):
            continue
        if times not in xs:
            xs.append(times)
        colour = to_hex(line.get_color())
        curves.append({"name": line.get_label(), "colour": colour, "x": xs.index(times), "y": values})
    name, unit = _name_and_unit(axes.get_ylabel())
    corners = _drawn(figure, axes, np.column_stack([axes.get_xlim(), axes.get_ylim()]))
    return {
        "name": name,
        "unit": unit,
        "box": _rounded([*corners.min(axis=0), *corners.max(axis=0)]),
        "x": _scale(axes.get_xscale(), axes.get_xlim(), corners[:, 0]),
        "y": _scale(axes.get_yscale(), axes.get_ylim(), corners[:, 1]),
        "curves": curves,
    }


def _drawn(figure: Figure, axes: Any, points: Array) -> Array:
    """Points of the axes (n, 2) where the SVG has them: y down, in points."""
    fractions = figure.transFigure.inverted().transform(axes.transData.transform(points))
    width, height = POINTS * figure.get_size_inches()
    return np.column_stack([width * fractions[:, 0], height * (1 - fractions[:, 1])])


def _scale(kind: str, limits: tuple[float, float], drawn: Array) -> list[float]:
    ends = np.log10(limits) if kind == "log" else np.asarray(limits)
    factor = (drawn[1] - drawn[0]) / (ends[1] - ends[0])
    return [float(f"{drawn[0] - factor * ends[0]:.7g}"), float(f"{factor:.7g}"), int(kind == "log")]


def _name_and_unit(words: str) -> tuple[str, str]:
    name, _, unit = plain_words(words).partition(" [")
    return name, unit.rstrip("]").replace("–", "")


def _short(values: Any, digits: int) -> list[float | None]:
    numbers = np.ravel(np.asarray(values, dtype=float))
    return [float(f"{number:.{digits}g}") if np.isfinite(number) else None for number in numbers]


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 2) for value in values]
