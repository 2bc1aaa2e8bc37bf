"""Why a solve failed, in one picture: how the error and the margins went, and where the last path is in trouble."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from nhpocp.arrays import Array
from nhpocp.constraints.bound import BoundReport, check_bounds
from nhpocp.solution import Outcome, Solution
from nhpocp.systems.numeric import NumericSystem
from nhpocp.views import plots
from nhpocp.views.finite_path import path_of, positive, quantity
from nhpocp.views.style import (
    ALARM,
    COLOURS,
    COMPACT,
    FAINT,
    GREY,
    PANEL,
    legend_above,
    line_style,
    say,
    symbol,
    trial_style,
)

HEIGHT, NARROW = 4.4, 4.6  # inches: of the whole picture; its width where there are no records to show
LEAST = 1e-8  # of the largest singular value: what is less is drawn there
STEEP = 30.0  # spread from which an axis is logarithmic
LONGEST = 400  # characters of a message
SINGULAR = {Outcome.SINGULAR_S: "det_s", Outcome.SINGULAR_W: "det_w"}
_WRONG = {"color": ALARM, "linestyle": "none", "marker": "X", "markersize": 6, "clip_on": False, "zorder": 6}
_THIN_ALARM = {"color": ALARM, "linewidth": 0.9, "linestyle": ":", "zorder": 1.5}


def failure(solution: Solution) -> Figure:
    """The records on the left, if there are any; the last path, or its two ends alone, on the right."""
    left = _record_panels(solution)
    right = _path_panels(solution)
    size = (2 * PANEL[0], HEIGHT) if left else (NARROW, PANEL[1] + 0.4)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05))
    columns = [panels for panels in (left, right) if panels]
    grid = figure.add_gridspec(1, len(columns))
    for i, panels in enumerate(columns):
        cells = grid[0, i].subgridspec(len(panels), 1)
        for j, plot in enumerate(panels):
            plot(figure.add_subplot(cells[j, 0]))
    say(figure, [f"{_title(solution)}: {_short(solution)}", _cut_words(solution)])
    return figure


def _title(solution: Solution) -> str:
    return re.sub(r" ([sw])$", lambda found: found[0].upper(), solution.outcome.value.replace("_", " "))


def _short(solution: Solution) -> str:
    """The message without the advice that belongs to every ending of its kind."""
    words = solution.message.replace(solution.outcome.advice, "").strip()
    return words if len(words) <= LONGEST else f"{words[:LONGEST].rpartition(' ')[0]} …"


Panel = Callable[[Any], None]


def _record_panels(solution: Solution) -> list[Panel]:
    panels: list[Panel] = []
    if np.isfinite(_column(solution, "error")).any():
        panels.append(lambda axes: plot_errors(axes, solution))
    if margin_names(solution):
        panels.append(lambda axes: plot_record_margins(axes, solution))
    return panels


def _path_panels(solution: Solution) -> list[Panel]:
    """What is broken; else the two ends, if nothing was tried between them; else what the path may have run into."""
    broken = [report for report in (solution.verdict.bounds if solution.verdict else ()) if not report.ok]
    broken = [report for report in broken if report.bound.quantity in solution.trajectory][:2]
    if solution.iterations and broken:
        return [lambda axes, report=report: plot_broken(axes, solution, report) for report in broken]  # type: ignore[misc]
    if not solution.iterations and set(solution.problem.goal) == set(
        solution.problem.system.state_space.names
    ):
        return [lambda axes: plot_ends(axes, solution)]
    if any(name.startswith("det_") for name in solution.trajectory):
        return [lambda axes: plot_determinants(axes, solution)]
    return [lambda axes: _plot_difference(axes, solution)]


# --- by evaluation ---------------------------------------------------------------------------------------------------


def margin_names(solution: Solution) -> list[str]:
    """What the records say of singularities; of an optimizer, how far its conditions are from being met."""
    there = list(dict.fromkeys(name for record in solution.iterations for name in record))
    found = [name for name in there if name.startswith("sigma_")] or ["dual_infeasibility"]
    return [name for name in found if np.isfinite(_column(solution, name)).any()]


def _column(solution: Solution, name: str) -> Array:
    values = [record.get(name) for record in solution.iterations]
    return np.array([np.nan if value is None else float(value) for value in values])


def _accepted(solution: Solution) -> Array:
    return np.array([bool(record.get("accepted", True)) for record in solution.iterations])


def _tries(solution: Solution) -> list[Array]:
    """The numbers of the evaluations of each try."""
    tries = [record.get("attempt", 0) for record in solution.iterations]
    return [np.flatnonzero([own == number for own in tries]) for number in dict.fromkeys(tries)]


def _by_evaluation(axes: Any, solution: Solution, values: Array, label: str, **line: Any) -> None:
    """Accepted values as a line for each try, refused ones as crosses."""
    accepted = _accepted(solution)
    refused = np.flatnonzero(~accepted)
    axes.plot(refused, values[refused], **trial_style(len(refused)), color=line["color"], zorder=1.8)
    for i, numbers in enumerate(_tries(solution)):
        kept = numbers[accepted[numbers]]
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
    errors = positive(record.get("error") for record in solution.iterations)
    _by_evaluation(axes, solution, errors, r"error $\mathcal{E}$", color=COLOURS[0])
    if not _accepted(solution).all():
        axes.plot([], [], label="refused", **trial_style(1), color=COLOURS[0])
    tolerance = f"tolerance {solution.tolerance:g}"
    axes.axhline(solution.tolerance, color=GREY, linewidth=0.8, linestyle=":", label=tolerance)
    lost = np.flatnonzero(np.isnan(errors))
    if lost.size:
        look = {**_WRONG, "marker": "^", "markersize": 3.2}
        axes.plot(
            lost, np.full(lost.size, 0.97), transform=axes.get_xaxis_transform(), label="not finite", **look
        )
    axes.set_yscale("log")
    kept = [*errors[np.isfinite(errors) & _accepted(solution)], solution.tolerance]
    axes.set_ylim(min(kept) / 2.5, 4 * max(np.nanmax(errors), solution.tolerance))
    axes.set_ylabel(r"error $\mathcal{E}$ [–]")
    _evaluation_axis(axes, solution)
    legend_above(axes, 3 if _accepted(solution).all() else 2, **COMPACT)


def plot_record_margins(axes: Any, solution: Solution) -> None:
    """Least singular values of every evaluation: of the end point's Jacobian, and of S and W along its path."""
    names = margin_names(solution)
    table = np.stack([_column(solution, name) for name in names])
    sigma = names[0].startswith("sigma_")
    floor = LEAST * np.nanmax(table)
    drawn = np.maximum(table, floor) if sigma else np.where(table > 0, table, np.nan)
    for i, (name, values) in enumerate(zip(names, drawn, strict=True)):
        _by_evaluation(axes, solution, values, _margin_symbol(name), **line_style(i))
    if sigma and (low := np.nonzero((table < floor).any(axis=0))[0]).size:
        look = {"linestyle": "none", "marker": "v", "markersize": 4, "color": ALARM, "zorder": 6}
        axes.plot(low, np.full(low.size, floor), label=r"$\leq$", **look)
    least, most = np.nanmin(drawn), np.nanmax(drawn)
    if most > STEEP * least > 0:
        axes.set_yscale("log")
        axes.set_ylim(0.4 * least, 2.5 * most)
    else:
        axes.set_ylim(0, 1.08 * max(most, 1e-300))
    axes.set_ylabel(r"least singular value $\sigma_{\min}$ [–]" if sigma else "stationarity residual [–]")
    _evaluation_axis(axes, solution)
    legend_above(axes, 4, **COMPACT)


def _margin_symbol(name: str) -> str:
    if not name.startswith("sigma_"):
        return "stationarity"
    letter = name.removeprefix("sigma_")
    return rf"$\sigma_{{\min}}({'J' if letter == 'jacobian' else letter.upper()})$"


# --- along the last path ---------------------------------------------------------------------------------------------


def _end(solution: Solution) -> float:
    """Up to where the path is one: finite, and confirmed by the replay, which may have stopped before a solver did."""
    path = path_of(solution)
    end = float(path.times[-1]) if path.samples else 0.0
    reached = solution.verdict.reached if solution.verdict else None
    return end if reached is None else min(end, reached)


def _cut_words(solution: Solution) -> str | None:
    end, horizon = _end(solution), float(solution.control.horizon)
    return f"The path ends at t = {end:.4g} of {horizon:.4g}." if end < horizon * (1 - 1e-9) else None


def _along(solution: Solution, name: str) -> tuple[Array, Array]:
    """Times and values up to where the path ends; the first sample in any case."""
    path = path_of(solution)
    there = path.times <= max(_end(solution), path.times[0] if path.samples else 0.0)
    return path.times[there], quantity(solution, name, path)[there]


def _time_axis(axes: Any, solution: Solution) -> None:
    """Time up to T, or to a little more than where the path ends; hatched where there is none."""
    end, horizon = _end(solution), float(solution.control.horizon)
    last = min(horizon, 1.3 * end) if end > 0 else horizon
    axes.set(xlim=(0, last), xlabel="time $t$ [–]")
    if end < horizon * (1 - 1e-9):
        axes.axvspan(end, last, facecolor=FAINT, edgecolor="0.8", hatch="////", linewidth=0, zorder=0.5)


def plot_broken(axes: Any, solution: Solution, report: BoundReport) -> None:
    """A bounded quantity along the path: the component that breaks its limit in colour, and where it is worst."""
    times, values = _along(solution, report.bound.quantity)
    component = _flat(solution, report)
    for i, name in enumerate(_names(report.bound.quantity, values.shape[1])):
        mine = i == component
        look = {"color": COLOURS[0], "zorder": 3} if mine else {"color": "0.7", "linewidth": 0.8, "zorder": 2}
        axes.plot(times, values[:, i], label=name if mine else None, **look)
    axes.axvline(report.time, **_THIN_ALARM)
    if np.isfinite(report.value):
        words = f"{report.value:.4g} at $t$ = {report.time:.3g}"
        axes.plot([report.time], [report.value], label=words, **_WRONG)
    _limits(axes, report, [*np.ravel(values), report.value])
    _time_axis(axes, solution)
    axes.set_ylabel(_bound_words(report))
    legend_above(axes, 3, **COMPACT)


def _names(name: str, count: int) -> list[str]:
    if name.startswith("sigma_"):
        return [_margin_symbol(name)]
    return [symbol(name, i if count > 1 else None) for i in range(count)]


def _bound_words(report: BoundReport) -> str:
    words = report.bound.label.partition(".")[0].replace("_", " ")
    return f"{words} {_margin_symbol(name) if (name := report.bound.quantity).startswith('sigma_') else symbol(name)}"


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
            axes.axhline(limit, color=GREY, linewidth=0.8, linestyle=(0, (6, 3)), zorder=1)
    axes.plot([], [], color=GREY, linewidth=0.8, linestyle=(0, (6, 3)), label="limit")
    axes.set_ylim(edges)


def plot_determinants(axes: Any, solution: Solution) -> None:
    """det S and det W along the path, by their size at the start, and where they vanish."""
    names = [name for name in solution.trajectory if name.startswith("det_")]
    largest = 0.0
    for i, name in enumerate(names):
        times, values = _along(solution, name)
        share = _share(values)
        largest = max(largest, float(np.max(np.abs(share), initial=0.0, where=np.isfinite(share))))
        axes.plot(times, share, label=_determinant(name), **line_style(i))
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    _mark_singular(axes, solution)
    if largest > STEEP:
        axes.set_yscale("symlog", linthresh=1.0)
    _time_axis(axes, solution)
    axes.set_ylabel("determinant, its size at the start being 1 [–]")
    legend_above(axes, 3, **COMPACT)


def _determinant(name: str) -> str:
    return rf"$\det\,{name.removeprefix('det_').upper()}$"


def _share(values: Array) -> Array:
    values = np.ravel(values)
    return values / abs(values[0]) if values.size and abs(values[0]) > 0 else values


def _mark_singular(axes: Any, solution: Solution) -> None:
    """Where a determinant vanishes: the one for which the solve ended, else any; or where the path stops."""
    crossings, ended, end = plots.crossing_times(solution), SINGULAR.get(solution.outcome), _end(solution)
    if ended is not None:
        crossings = {name: times for name, times in crossings.items() if name == ended}
    places = sorted(time for times in crossings.values() for time in times)
    for time in places:
        axes.axvline(time, **_THIN_ALARM)
    if places:
        words = " or ".join(_determinant(name) for name in crossings) + " $= 0$"
        at = f" at $t$ = {places[0]:.3g}" if len(places) == 1 else ""
        axes.plot(places, np.zeros(len(places)), label=words + at, **_WRONG)
    elif end < solution.control.horizon * (1 - 1e-9):
        axes.axvline(end, label=f"path ends, $t$ = {end:.3g}", **_THIN_ALARM)


def plot_ends(axes: Any, solution: Solution) -> None:
    """What start and goal say on their own: the bound that one of them breaks, or the determinants' signs."""
    problem = solution.problem
    states = np.stack([problem.start_point, problem.goal_point])
    still = np.zeros((2, problem.system.input_space.size))
    values = NumericSystem(problem.system).trajectory(states, still, problem.scale)
    bounds = [bound for bound in problem.bounds if bound.quantity not in problem.system.input_space.names]
    broken = [report for report in check_bounds(bounds, np.array([0.0, 1.0]), values) if not report.ok]
    if broken:
        drawn = values[broken[0].bound.quantity].reshape(2, -1)
        _plot_pairs(axes, drawn, _names(broken[0].bound.quantity, drawn.shape[1]))
        axes.axhline(broken[0].value, **_THIN_ALARM, label=f"{broken[0].value:.4g}")
        _limits(axes, broken[0], [*np.ravel(drawn)])
        axes.set_ylabel(_bound_words(broken[0]))
    else:
        found = [name for name in values if name.startswith("det_")]
        drawn = np.stack([_share(values[name]) for name in found], axis=1) if found else np.empty((2, 0))
        _plot_pairs(axes, drawn, [_determinant(name) for name in found])
        axes.axhline(0, color=ALARM, linewidth=0.9, zorder=1)
        axes.set_ylabel("determinant, its size at the start being 1 [–]")
    axes.set(xlim=(-0.4, 1.4), xticks=[0, 1], xticklabels=["start", "goal"])
    axes.grid(axis="x", visible=False)
    legend_above(axes, 5, **COMPACT)


def _plot_pairs(axes: Any, values: Array, names: Sequence[str]) -> None:
    """Two values of each name, side by side where several are the same."""
    for i, name in enumerate(names):
        shift = 0.07 * (i - 0.5 * (len(names) - 1))
        look = {**line_style(i), "linewidth": 0.6, "alpha": 0.9}
        axes.plot([shift, 1 + shift], values[:, i], marker="osD^v"[i % 5], markersize=4, label=name, **look)


def _plot_difference(axes: Any, solution: Solution) -> None:
    """For systems without singularities: how the path misses the goal."""
    plots.plot_relative(axes, solution, plots.goal_groups(solution)[0])
    legend_above(axes, 4, **COMPACT)
