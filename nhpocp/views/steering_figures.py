"""Pictures of a steering: the error over the cycles, of one machine or of many."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.machine.feedback.fleet import Fleet
from nhpocp.machine.feedback.steering import Cycle, Steered
from nhpocp.problem import PlanningProblem
from nhpocp.views.figures import write_all
from nhpocp.views.labels import axis_label
from nhpocp.views.plots import REFERENCE
from nhpocp.views.style import ALARM, COLOURS, COMPACT, GREY, PANEL, axes_grid, legend_above, styled

QUANTITIES = ("position_error", "angle_error")
LEAST = 1e-12  # what a log axis shows of an error that is none


def write_pictures(subject: Steered | Fleet, folder: Path) -> None:
    """The picture `steering` as the other pictures are written."""
    write_all({"steering": steering}, subject, folder, ("svg", "png"), ("steering",))


@styled
def steering(subject: Steered | Fleet) -> Figure:
    """Errors of position and angle over the cycles, on log axes; or E, where the goal has neither.

    Of many machines each is a thin line, the median a thick one. Of one, cycles in which a bound was broken are marked.
    """
    if isinstance(subject, Fleet):
        histories = [list(machine.steered.cycles) for machine in subject.machines]
    else:
        histories = [list(subject.cycles)]
    shown = [name for name in QUANTITIES if any(getattr(c, name) is not None for h in histories for c in h)]
    shown = shown or ["error"]
    figure, axes = axes_grid(len(shown), len(shown), PANEL)
    for panel, name in zip(axes, shown, strict=True):
        _panel(panel, name, [_values(history, name) for history in histories], subject)
        legend_above(panel, **COMPACT)
    return figure


def _values(history: list[Cycle], name: str) -> Array:
    values = [getattr(cycle, name) for cycle in history]
    return np.maximum([np.nan if value is None else value for value in values], LEAST)


def _panel(axes: Any, name: str, histories: list[Array], subject: Steered | Fleet) -> None:
    cycles = max((len(values) for values in histories), default=1)
    many = len(histories) > 1
    line = {"color": COLOURS[0], "marker": "o", "markersize": 3.2, "linewidth": 1.1, "zorder": 3}
    if many:
        line = {"color": GREY, "linewidth": 0.4, "alpha": 0.45, "zorder": 2}
    for k, values in enumerate(histories):
        words = (f"{len(histories)} machines" if many else "measured") if k == 0 else None
        axes.plot(np.arange(len(values)), values, label=words, **line)
    if many:
        # a machine that has reached the goal stays there
        held = [
            np.r_[values, np.full(cycles - len(values), values[-1])] for values in histories if len(values)
        ]
        look = {"color": COLOURS[0], "marker": "o", "markersize": 3.2, "linewidth": 1.4, "zorder": 4}
        axes.plot(np.arange(cycles), np.nanmedian(held, axis=0), label="median", **look)
    elif isinstance(subject, Steered) and not subject.reached and cycles:
        words = subject.outcome.value.replace("_", " ")
        last = {"marker": "X", "color": ALARM, "markersize": 6, "linestyle": "none", "zorder": 5}
        axes.plot([cycles - 1], [histories[0][-1]], label=words, clip_on=False, **last)
    if isinstance(subject, Steered) and (broken := sorted({k for k, _ in subject.broken if k < cycles})):
        ring = {"marker": "o", "markersize": 9, "fillstyle": "none", "color": ALARM, "linestyle": "none"}
        axes.plot(broken, histories[0][broken], label="a bound broken", clip_on=False, zorder=5, **ring)
    limit = _tolerance(name, subject.problem, subject.tolerance)
    axes.axhline(limit, label=f"tolerance {subject.tolerance:g}", **REFERENCE)
    axes.set(yscale="log", xlabel="cycle", ylabel=_label(name, subject.problem), xlim=(-0.15, cycles - 0.85))
    axes.xaxis.get_major_locator().set_params(integer=True)


def _tolerance(name: str, problem: PlanningProblem, tolerance: float) -> float:
    """E in the unit of a panel."""
    return tolerance * (problem.error_length if name == "position_error" else 1.0)


def _label(name: str, problem: PlanningProblem) -> str:
    units = problem.units
    if name == "position_error":
        return axis_label("position error", "", units.words("length", False) or "length")
    if name == "angle_error":
        return axis_label("angle error", "", "rad")
    return axis_label("error", r"$\mathscr{E}$", "–")
