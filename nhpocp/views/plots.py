"""Panels and convergence of one solution drawn by Matplotlib, on axes that the caller owns."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution
from nhpocp.views.finite_path import FinitePath
from nhpocp.views.labels import axis_label
from nhpocp.views.panels import Mark, Panel, logarithmic
from nhpocp.views.records import decays, error_history
from nhpocp.views.style import ALARM, COLOURS, COMPACT, FAINT, GREY, legend_above, line_style, trial_style

LIMIT: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "linestyle": (0, (6, 3)), "zorder": 1}
REFERENCE: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "linestyle": ":", "zorder": 1}


def draw(axes: Any, panel: Panel, path: FinitePath) -> None:
    """A panel with everything that it says, from 0 to T; hatched where there is no path."""
    for i, curve in enumerate(panel.curves):
        axes.plot(curve.times, curve.values, label=curve.symbol, **line_style(i))
    draw_marks(axes, panel.marks)
    if panel.zero:
        zero_line(axes)
    if panel.margin:
        margin_axis(axes, [curve.values for curve in panel.curves])
    limits = {limit for curve in panel.curves for limit in curve.limits}
    draw_limits(axes, limits, wherever=panel.group == "distance")
    time_axis(axes, path.end, path.horizon, path.time_unit)
    axes.set_ylabel(panel.label)
    legend_above(axes)


def zero_line(axes: Any) -> None:
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)


def draw_marks(axes: Any, marks: Iterable[Mark], dashes: Any = None, labelled: bool = True) -> None:
    """Red lines at the times of marks, faint ones at via poses; one entry of the legend for all of one kind.

    dashes: of the run that they belong to, where there are several.
    """
    kinds: list[str] = []
    for mark in marks:
        first = mark.words not in kinds
        kinds += [mark.words] if first else []
        style = dashes or (":", "--")[kinds.index(mark.words) % 2]
        look = {"color": ALARM if mark.alarm else "0.6", "linewidth": 0.9, "linestyle": style, "zorder": 1.5}
        axes.axvline(mark.time, label=mark.words if first and labelled else None, **look)


def margin_axis(axes: Any, values: Iterable[Array]) -> None:
    """Distances from zero: an axis that begins there, or a logarithmic one."""
    seen = np.concatenate([np.ravel(some) for some in values] or [np.empty(0)])
    if logarithmic(seen):
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.08 * np.max(seen, initial=0.0, where=np.isfinite(seen)) or 1.0)


def draw_limits(axes: Any, limits: Iterable[float], wherever: bool = False) -> None:
    """Stated limits, where they are near enough to the curves to be worth the room, or ``wherever`` they are."""
    low, high = axes.get_ylim()
    room = 0.5 * (high - low)
    for limit in sorted(limits):
        if wherever or low - room < limit < high + room:
            axes.axhline(limit, **LIMIT)


def time_axis(axes: Any, end: float, last: float, unit: str | None) -> None:
    """Time from 0 to ``last``, hatched from ``end`` on, where there is no path."""
    axes.set(xlim=(0, last), xlabel=axis_label("time", "$t$", unit or "–"))
    if end < last * (1 - 1e-9):
        axes.axvspan(end, last, facecolor=FAINT, edgecolor="0.8", hatch="////", linewidth=0, zorder=0.5)


# --- convergence ------------------------------------------------------------------------------------------------------


def draw_convergence(axes: Any, solution: Solution) -> None:
    """E against iteration on a log axis with the decay that eqs. (9) and (17) promise, [Paper] section 3."""
    ks, errors = error_history(solution)
    known = np.flatnonzero(np.isfinite(errors))
    look = {"color": COLOURS[0], "marker": "o", "markersize": 2.2, "linewidth": 1.0}
    axes.plot(ks, errors, label=r"error $\mathscr{E}$", zorder=3, **look)
    refused = error_history(solution, kept=False)
    if len(refused[0]):
        axes.plot(*refused, label="trial", **trial_style(len(refused[0])), color=COLOURS[0])
    names = (r"$\mathscr{E}(0)\,e^{-\gamma\theta}$", r"$\mathscr{E}(0)\,(1-\gamma)^k$")
    for i, (name, values) in enumerate(zip(names, decays(solution) or (), strict=False), 1):
        axes.plot(ks, values, label=name, zorder=2, **{**line_style(i), "linewidth": 0.9})
    axes.axhline(solution.tolerance, label=f"tolerance {solution.tolerance:g}", **REFERENCE)
    if len(known):
        _last_point(axes, solution, ks[known[-1]], errors[known[-1]])
    seen = [*errors[known], solution.tolerance]
    error_axis(axes, "iteration $k$", min(seen) / 2.5, max(seen) * 2.5)
    axes.set_xlim(-0.02 * max(ks.max(initial=1), 1), 1.02 * max(ks.max(initial=1), 1))
    legend_above(axes, 2, **COMPACT)


def error_axis(axes: Any, over: str, low: float | None = None, high: float | None = None) -> None:
    """E on a log axis over whole numbers."""
    axes.set(yscale="log", ylim=(low, high), xlabel=over, ylabel=r"error $\mathscr{E}$ [–]")
    axes.xaxis.get_major_locator().set_params(integer=True)


def _last_point(axes: Any, solution: Solution, k: float, error: float) -> None:
    words = f"{solution.outcome.value.replace('_', ' ')}: $\\mathscr{{E}}$ = {error:.2g} at $k$ = {k:g}"
    if solution.outcome is Outcome.CONVERGED:
        look = {"marker": "D", "color": COLOURS[2], "markersize": 4}
    else:
        look = {"marker": "X", "color": ALARM, "markersize": 6}
    axes.plot([k], [error], linestyle="none", zorder=5, label=words, clip_on=False, **look)
