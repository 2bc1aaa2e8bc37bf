"""Why a solve failed, in one picture: how the error and the margins went, and where the last path is in trouble."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from nhpocp.arrays import Array
from nhpocp.constraints.bound import BoundReport, check_bounds
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution
from nhpocp.systems.margins import margin
from nhpocp.systems.numeric import NumericSystem
from nhpocp.views import plots
from nhpocp.views.finite_path import path_of
from nhpocp.views.labels import axis_label, notation, symbol
from nhpocp.views.panels import SPREAD, Curve, Panel, logarithmic, of_group, of_quantity, panels
from nhpocp.views.records import accepted, column, positive
from nhpocp.views.style import (
    ALARM,
    COLOURS,
    COMPACT,
    OWN_SIZE,
    PANEL,
    Picture,
    Room,
    legend_above,
    line_style,
    say,
    trial_style,
)

HEIGHT, NARROW = 4.4, 4.6  # inches: of the whole picture; its width where there are no records to show
LEAST = 1e-8  # of the largest singular value: what is less is drawn there
LONGEST = 400  # characters of a message
SINGULAR = {Outcome.SINGULAR_S: "det_s", Outcome.SINGULAR_W: "det_w"}
_WRONG = {"color": ALARM, "linestyle": "none", "marker": "X", "markersize": 6, "clip_on": False, "zorder": 6}
_THIN_ALARM = {"color": ALARM, "linewidth": 0.9, "linestyle": ":", "zorder": 1.5}
_Plot = Callable[[Any, Solution], None]  # onto axes


def failure(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The records on the left, if there are any; the last path, or its two ends alone, on the right, or below."""
    columns = [plots for plots in (_of_records(solution), _of_path(solution)) if plots]
    size = (2 * PANEL[0], HEIGHT) if len(columns) > 1 else (NARROW, PANEL[1] + 0.4)
    across = room.columns(len(columns))
    down = len(columns) // across
    width = room.width or size[0]
    figure = Picture(
        figsize=(width, room.height or down * size[1]), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    )
    grid = figure.add_gridspec(down, across)
    for i, rows in enumerate(columns):
        cells = grid[divmod(i, across)].subgridspec(len(rows), 1)
        for j, plot in enumerate(rows):
            plot(figure.add_subplot(cells[j, 0]), solution)
    say(figure, [f"{_title(solution)}: {_short(solution)}", _cut_words(solution)])
    return figure


def _title(solution: Solution) -> str:
    return re.sub(r" ([sw])$", lambda letter: letter[0].upper(), solution.outcome.value.replace("_", " "))


def _short(solution: Solution) -> str:
    """The message without the advice that belongs to every ending of its kind."""
    words = solution.message.replace(solution.outcome.advice, "").strip()
    return words if len(words) <= LONGEST else f"{words[:LONGEST].rpartition(' ')[0]} …"


def _of_records(solution: Solution) -> list[_Plot]:
    there = [plot_errors] if np.isfinite(column(solution.iterations, "error")).any() else []
    return [*there, *([plot_record_margins] if margin_names(solution) else [])]


def _of_path(solution: Solution) -> list[_Plot]:
    """What is broken; else the two ends, if nothing was tried between them; else what the path may have run into."""
    broken = [report for report in (solution.verdict.bounds if solution.verdict else ()) if not report.ok]
    broken = [report for report in broken if report.bound.quantity in solution.trajectory][:2]
    if solution.iterations and broken:
        return [partial(plot_broken, report=report) for report in broken]
    if not solution.iterations and set(solution.problem.goal) == set(
        solution.problem.system.state_space.names
    ):
        return [plot_ends]
    return [plot_determinants] if of_group(panels(solution), "determinant") else [_plot_difference]


# --- by evaluation ---------------------------------------------------------------------------------------------------


def margin_names(solution: Solution) -> list[str]:
    """What the records say of singularities; of an optimizer, how far its conditions are from being met."""
    there = list(dict.fromkeys(name for record in solution.iterations for name in record))
    names = [name for name in there if margin(name)] or ["dual_infeasibility"]
    return [name for name in names if np.isfinite(column(solution.iterations, name)).any()]


def _tries(solution: Solution) -> list[Array]:
    """The numbers of the evaluations of each try."""
    tries = [record.get("attempt", 0) for record in solution.iterations]
    return [np.flatnonzero([own == number for own in tries]) for number in dict.fromkeys(tries)]


def _by_evaluation(axes: Any, solution: Solution, values: Array, label: str, **line: Any) -> None:
    """Accepted values as a line for each try, refused ones as crosses."""
    good = accepted(solution.iterations)
    refused = np.flatnonzero(~good)
    axes.plot(refused, values[refused], **trial_style(len(refused)), color=line["color"], zorder=1.8)
    for i, numbers in enumerate(_tries(solution)):
        kept = numbers[good[numbers]]
        marker = {"marker": "o", "markersize": 2.2} if len(values) < 60 or len(kept) == 1 else {}
        axes.plot(kept, values[kept], label=None if i else label, **{"linewidth": 1.0, **marker, **line})


def _evaluation_axis(axes: Any, solution: Solution) -> None:
    last = len(solution.iterations) - 1
    room = max(0.02 * last, 0.5 if last < 1 else 0.05)
    axes.set_xlim(-room, last + room)
    if last < 1:
        axes.set_xticks([0])
    else:
        axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("evaluation" if "accepted" in solution.iterations[0] else "iteration $k$")
    for numbers in _tries(solution)[1:]:
        axes.axvline(numbers[0] - 0.5, color="0.75", linewidth=0.6, zorder=1)
    if axes.get_yscale() == "log" and np.ptp(np.log10(axes.get_ylim())) > 3:
        axes.minorticks_off()


def plot_errors(axes: Any, solution: Solution) -> None:
    """E of every evaluation on a log axis; what was refused, and what was not finite."""
    errors, good = positive(column(solution.iterations, "error")), accepted(solution.iterations)
    _by_evaluation(axes, solution, errors, r"error $\mathscr{E}$", color=COLOURS[0])
    if not good.all():
        axes.plot([], [], label="refused", **trial_style(1), color=COLOURS[0])
    axes.axhline(solution.tolerance, label=f"tolerance {solution.tolerance:g}", **plots.REFERENCE)
    lost = np.flatnonzero(np.isnan(errors))
    if lost.size:
        look = {**_WRONG, "marker": "^", "markersize": 3.2, "transform": axes.get_xaxis_transform()}
        axes.plot(lost, np.full(lost.size, 0.97), label="not finite", **look)
    kept = [*errors[np.isfinite(errors) & good], solution.tolerance]
    plots.error_axis(axes, "", min(kept) / 2.5, 4 * max(np.nanmax(errors), solution.tolerance))
    _evaluation_axis(axes, solution)
    legend_above(axes, 3 if good.all() else 2, **COMPACT)


def plot_record_margins(axes: Any, solution: Solution) -> None:
    """Least singular values of every evaluation: of the end point's Jacobian, and of S and W along its path."""
    names = margin_names(solution)
    table = np.stack([column(solution.iterations, name) for name in names])
    sigma = margin(names[0]) is not None
    floor = LEAST * np.nanmax(table)
    drawn = np.maximum(table, floor) if sigma else positive(table)
    for i, (name, values) in enumerate(zip(names, drawn, strict=True)):
        _by_evaluation(axes, solution, values, symbol(name) if sigma else "stationarity", **line_style(i))
    if sigma and (low := np.nonzero((table < floor).any(axis=0))[0]).size:
        look = {"linestyle": "none", "marker": "v", "markersize": 4, "color": ALARM, "zorder": 6}
        axes.plot(low, np.full(low.size, floor), label=r"$\leq$", **look)
    plots.margin_axis(axes, drawn)
    if logarithmic(drawn):
        axes.set_ylim(0.4 * np.nanmin(drawn), 2.5 * np.nanmax(drawn))
    axes.set_ylabel(r"least singular value $\sigma_{\min}$ [–]" if sigma else "stationarity residual [–]")
    _evaluation_axis(axes, solution)
    legend_above(axes, 4, **COMPACT)


# --- along the last path ---------------------------------------------------------------------------------------------


def _end(solution: Solution) -> float:
    """Up to where the path is one: finite, and confirmed by the replay, which may have stopped before a solver did."""
    reached = solution.verdict.reached if solution.verdict else None
    end = path_of(solution).end
    return end if reached is None else min(end, reached)


def _cut_words(solution: Solution) -> str | None:
    end, horizon = _end(solution), float(solution.control.horizon)
    return f"The path ends at t = {end:.4g} of {horizon:.4g}." if end < horizon * (1 - 1e-9) else None


def _finish(axes: Any, solution: Solution, label: str, columns: int) -> None:
    """Time up to T, or to a little more than where the path ends; the label and the legend."""
    end, horizon = _end(solution), float(solution.control.horizon)
    unit = solution.problem.units.time
    plots.time_axis(axes, end, min(horizon, 1.3 * end) if end > 0 else horizon, unit)
    axes.set_ylabel(label)
    legend_above(axes, columns, **COMPACT)


def plot_broken(axes: Any, solution: Solution, report: BoundReport) -> None:
    """A bounded quantity along the path: the component that breaks its limit in colour, and where it is worst."""
    shown = (panel.until(_end(solution)) for panel in panels(solution))
    curves = of_quantity(shown, report.bound.quantity)
    component = _flat(solution, report)
    for i, curve in enumerate(curves):
        mine = i == component
        look = {"color": COLOURS[0], "zorder": 3} if mine else {"color": "0.7", "linewidth": 0.8, "zorder": 2}
        axes.plot(curve.times, curve.values, label=curve.symbol if mine else None, **look)
    axes.axvline(report.time, **_THIN_ALARM)
    if np.isfinite(report.value):
        words = f"{report.value:.4g} at $t$ = {report.time:.3g}"
        axes.plot([report.time], [report.value], label=words, **_WRONG)
    _limits(axes, report, [*(value for curve in curves for value in curve.values), report.value])
    _finish(axes, solution, _bound_words(solution, report), 3)


def _bound_words(solution: Solution, report: BoundReport) -> str:
    problem = solution.problem
    _, mathtext, unit = notation(problem.system, report.bound.quantity, units=problem.units)
    return axis_label(report.bound.label.partition(".")[0].replace("_", " "), mathtext, unit)


def _flat(solution: Solution, report: BoundReport) -> int:
    shape = np.shape(solution.trajectory[report.bound.quantity])[1:]
    return int(np.ravel_multi_index(report.component, shape)) if shape else 0


def _limits(axes: Any, report: BoundReport, values: Sequence[float]) -> None:
    """The limits of the broken component; shaded where it must not be."""
    limits = report.bound.limits(report.component)
    seen = [value for value in (*values, *limits) if np.isfinite(value)]
    room = max(0.08 * (max(seen) - min(seen)), 1e-3 * max(np.abs(seen)), 1e-12)
    edges = min(seen) - room, max(seen) + room
    for limit, edge in zip(limits, edges, strict=True):
        if np.isfinite(limit):
            axes.axhspan(limit, edge, facecolor=ALARM, alpha=0.07, linewidth=0, zorder=0.4)
            axes.axhline(limit, **plots.LIMIT)
    axes.plot([], [], label="limit", **plots.LIMIT)
    axes.set_ylim(edges)


def plot_determinants(axes: Any, solution: Solution) -> None:
    """det S and det W along the path, by their size at the start, and where they vanish."""
    panel = of_group(panels(solution), "determinant")[0].until(_end(solution))
    for i, curve in enumerate(panel.curves):
        axes.plot(curve.times, curve.values, label=curve.symbol, **line_style(i))
    plots.zero_line(axes)
    _mark_singular(axes, solution, panel)
    values = np.concatenate([curve.values for curve in panel.curves])
    if np.max(np.abs(values), initial=0.0, where=np.isfinite(values)) > SPREAD:
        axes.set_yscale("symlog", linthresh=1.0)
    _finish(axes, solution, panel.label, 3)


def _mark_singular(axes: Any, solution: Solution, panel: Panel) -> None:
    """Where a determinant vanishes: the one for which the solve ended, else any; or where the path stops."""
    ended, end = SINGULAR.get(solution.outcome), _end(solution)
    marks = [mark for mark in panel.marks if ended in (None, mark.curve)]
    places = sorted(mark.time for mark in marks)
    for time in places:
        axes.axvline(time, **_THIN_ALARM)
    if places:
        names = " or ".join(dict.fromkeys(symbol(mark.curve) for mark in marks))
        at = f" at $t$ = {places[0]:.3g}" if len(places) == 1 else ""
        axes.plot(places, np.zeros(len(places)), label=f"{names} $= 0${at}", **_WRONG)
    elif end < solution.control.horizon * (1 - 1e-9):
        axes.axvline(end, label=f"path ends, $t$ = {end:.3g}", **_THIN_ALARM)


def plot_ends(axes: Any, solution: Solution) -> None:
    """What start and goal say on their own: the bound that one of them breaks, or the determinants' signs."""
    problem = solution.problem
    states = np.stack([problem.start_point, problem.goal_point])
    still = np.zeros((2, problem.system.input_space.size))
    values = NumericSystem(problem.system).trajectory(states, still, problem.scale)
    both = replace(solution, trajectory={"t": np.array([0.0, 1.0]), **values})
    bounds = [bound for bound in problem.bounds if bound.quantity not in problem.system.input_space.names]
    broken = [report for report in check_bounds(bounds, np.array([0.0, 1.0]), values) if not report.ok]
    if broken:
        curves = of_quantity(panels(both), broken[0].bound.quantity)
        _plot_pairs(axes, curves)
        axes.axhline(broken[0].value, **_THIN_ALARM, label=f"{broken[0].value:.4g}")
        _limits(axes, broken[0], [value for curve in curves for value in curve.values])
        axes.set_ylabel(_bound_words(solution, broken[0]))
    else:
        for panel in of_group(panels(both), "determinant"):
            _plot_pairs(axes, panel.curves)
            axes.set_ylabel(panel.label)
        axes.axhline(0, color=ALARM, linewidth=0.9, zorder=1)
    axes.set(xlim=(-0.4, 1.4), xticks=[0, 1], xticklabels=["start", "goal"])
    axes.grid(axis="x", visible=False)
    legend_above(axes, 5, **COMPACT)


def _plot_pairs(axes: Any, curves: Sequence[Curve]) -> None:
    """Two values of each curve, side by side where several are equal."""
    for i, curve in enumerate(curves):
        shift = 0.07 * (i - 0.5 * (len(curves) - 1))
        look = {**line_style(i), "linewidth": 0.6, "alpha": 0.9, "marker": "osD^v"[i % 5], "markersize": 4}
        axes.plot([shift, 1 + shift], curve.values, label=curve.symbol, **look)


def _plot_difference(axes: Any, solution: Solution) -> None:
    """For systems without singularities: how the path misses the goal."""
    plots.draw(axes, of_group(panels(solution), "error")[0], path_of(solution))
