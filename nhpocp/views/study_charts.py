"""Where the runs of a study succeed, and at what cost: maps, curves and points over its axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from nhpocp.arrays import Array
from nhpocp.survey import Axis, Cells, Map, Points, Quantity, Survey
from nhpocp.views import study_words as words
from nhpocp.views.overlays import WIDTH, Overlay
from nhpocp.views.report_words import run_names
from nhpocp.views.style import COMPACT, axes_grid, line_style, sheet

SUCCESS = "#BFE3F5"  # pale, so that failures stand out
FAILURES = ("#D55E00", "#E69F00", "#CC79A7", "#009E73", "#0072B2", "#000000")  # Okabe and Ito
MARKERS = ("x", "+", "o", "^", "s", "D")  # which tell them apart in grey
LEVELS, SHARES = "viridis", "cividis"
TICKS = 11  # labels along an upright axis of a map
LETTER = 0.05  # inches of one in a label
NUMBERS = 64  # cells of a panel in which their values can still be read
MARKED = 400  # cells of a panel that are marked one by one
WIDE = 20.0  # most over least, from which a scale is logarithmic
PAIRS = 3  # of axes over which points are shown


def charts(survey: Survey) -> list[Overlay]:
    """Every chart of a study: of each solver a map or points, or curves of all of them over one axis."""
    chart = survey.chart
    if chart is None:
        return []
    with sheet():
        if isinstance(chart, Points):
            return list(_points(survey, chart))
        return list(_maps(survey, chart)) if chart.rows else [_curves(survey, chart, chart.columns)]


# --- outcomes ---------------------------------------------------------------------------------------------------------


def _failure_look(place: int) -> tuple[str, str]:
    """Colour and marker of an outcome by its place in `Survey.outcomes`; rare ones share the last."""
    k = min(place, len(FAILURES)) - 1
    return FAILURES[k], MARKERS[k]


def _outcome_legend(figure: Figure, survey: Survey, solved: bool = True) -> None:
    """Names of the outcomes; ``solved``: success too."""
    handles: list[Any] = (
        [Patch(facecolor=SUCCESS, edgecolor="0.5", linewidth=0.4, label="solved")] if solved else []
    )
    for place, outcome in enumerate(survey.outcomes[1 : len(FAILURES) + 1], 1):
        colour, marker = _failure_look(place)
        rest = len(survey.outcomes) - 1 > len(FAILURES) == place
        label = "other failures" if rest else outcome.replace("_", " ")
        look: dict[str, Any] = {
            "color": colour,
            "marker": marker,
            "markersize": 5,
            "markeredgewidth": 1.2,
            "linestyle": "none",
        }
        handles.append(Line2D([], [], label=label, **look))
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 4), **COMPACT)


# --- maps -------------------------------------------------------------------------------------------------------------


def _maps(survey: Survey, chart: Map) -> Iterator[Overlay]:
    norms = {
        quantity.name: _norm([cells.medians[quantity.name] for cells in chart.cells.values()])
        for quantity in _mapped(survey)
    }
    names = run_names(survey.solvers)
    for number, (name, cells) in enumerate(zip(names, chart.cells.values(), strict=True)):
        if not cells.stored.any():
            continue
        figure = _map_figure(survey, chart, cells, norms)
        over = words.over_words(chart)
        caption = Markup("{} {}").format(MAPPED if chart.single else SHARED, over)
        title = "Where it is solved, and at what cost"
        title += f": {name}" if len(names) > 1 else ""
        yield Overlay(f"map-{number + 1}", title, caption, figure)


MAPPED = Markup("One run a cell; cells that are crossed out failed, blank ones have not run.")
SHARED = Markup("Medians are of the solved runs in a cell; blank cells have none.")


def _mapped(survey: Survey) -> list[Quantity]:
    return [quantity for quantity in survey.quantities if quantity.kind in ("cost", "evaluations")]


def _map_figure(survey: Survey, chart: Map, cells: Cells, norms: dict[str, Normalize]) -> Figure:
    """A row a quantity and a column a panel; the quantities side by side where there is one panel."""
    count = cells.stored.shape[0]
    success = len(survey.outcomes) > 1
    kinds: list[Quantity | None] = [*([None] if success else []), *_mapped(survey)]
    columns = count if count > 1 else len(kinds)
    width = WIDTH / max(columns, 2)
    figure, grid = axes_grid(
        len(kinds) * count, columns, (width, 0.86 * width + 0.15), 0.3 if success else 0.05
    )
    for row, quantity in enumerate(kinds):
        mine = grid[row * count : (row + 1) * count]
        for place, axes in enumerate(mine):
            if quantity is None:
                mesh = _success_panel(axes, chart, cells, place)
                label = "share solved"
            else:
                norm = norms[quantity.name]
                mesh = _value_panel(axes, chart, cells, place, quantity.name, norm)
                label = words.quantity_label(quantity, survey.problem)
            if chart.panels and row == 0:
                level = chart.panels.levels[place]
                axes.set_title(words.panel_words(chart.panels, level, survey.problem), loc="left")
            lowest = row == len(kinds) - 1 or count == 1
            room = width - (0.55 if count > 1 else 0.9)
            _map_axes(axes, chart, survey, place if count > 1 else 0, lowest, room)
        if mesh is not None:
            _scale(figure, mesh, mine, label)
        elif count == 1:
            mine[0].set_title("outcome", loc="left")
    if success and chart.single:
        _outcome_legend(figure, survey)
    return figure


def _scale(figure: Figure, mesh: Any, beside: Sequence[Any], label: str) -> None:
    """The scale of colours beside panels; a logarithmic one in plain numbers."""
    bar = figure.colorbar(mesh, ax=beside, pad=0.02, aspect=24)
    bar.set_label(label)
    bar.outline.set_linewidth(0.4)
    if isinstance(mesh.norm, LogNorm):
        least, most = mesh.get_clim()
        narrow = most / least < 1000
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,)))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    bar.ax.tick_params(which="both", length=2)


def _norm(values: Sequence[Array]) -> Normalize:
    known = np.concatenate([np.ravel(some) for some in values])
    known = known[np.isfinite(known)]
    least, most = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    if least == most:
        least, most = least - 0.5 * abs(least or 1.0), most + 0.5 * abs(most or 1.0)
    return LogNorm(least, most) if least > 0 and most / least > WIDE else Normalize(least, most)


def _success_panel(axes: Any, chart: Map, cells: Cells, place: int) -> Any:
    """Outcomes where a cell has one run; else the share of solved runs, and that as a mesh for a scale."""
    outcome = cells.outcome[place]
    if not chart.single:
        with np.errstate(invalid="ignore", divide="ignore"):
            shares = np.where(cells.stored[place] > 0, cells.solved[place] / cells.stored[place], np.nan)
        mesh = _mesh(axes, shares, SHARES, Normalize(0, 1))
        _numbers(axes, shares, mesh)
        return mesh
    colours = np.ones((*outcome.shape, 3))
    colours[outcome == 0] = to_rgb(SUCCESS)
    for which in range(1, int(outcome.max(initial=0)) + 1):
        colours[outcome == which] = 0.55 * np.asarray(to_rgb(_failure_look(which)[0])) + 0.45
    axes.pcolormesh(*_edges(outcome), colours, edgecolor="w", linewidth=0.3, rasterized=outcome.size > MARKED)
    axes.grid(visible=False)
    if outcome.size <= MARKED:
        for which in range(1, int(outcome.max(initial=0)) + 1):
            _, marker = _failure_look(which)
            rows, columns = np.nonzero(outcome == which)
            size = _marker_size(outcome)
            axes.plot(
                columns,
                rows,
                linestyle="none",
                marker=marker,
                markersize=size,
                color="k",
                markeredgewidth=0.8,
            )
    return None


def _value_panel(axes: Any, chart: Map, cells: Cells, place: int, name: str, norm: Normalize) -> Any:
    values, outcome = cells.medians[name][place], cells.outcome[place]
    mesh = _mesh(axes, values, LEVELS, norm)
    _numbers(axes, values, mesh)
    failed = (outcome > 0) & ~np.isfinite(values)
    if chart.single and outcome.size <= MARKED and failed.any():
        rows, columns = np.nonzero(failed)
        look: dict[str, Any] = {
            "linestyle": "none",
            "marker": "x",
            "markersize": 0.7 * _marker_size(outcome),
            "markeredgewidth": 0.6,
        }
        axes.plot(columns, rows, color="0.55", **look)
    return mesh


def _marker_size(cells: Array) -> float:
    return float(np.clip(42 / max(cells.shape), 1.5, 5))


def _edges(cells: Array) -> tuple[Array, Array]:
    return np.arange(cells.shape[1] + 1) - 0.5, np.arange(cells.shape[0] + 1) - 0.5


def _mesh(axes: Any, values: Array, colours: str, norm: Normalize) -> Any:
    axes.set_facecolor("0.97")
    axes.grid(visible=False)
    shown = np.ma.masked_invalid(values)
    many = values.size > MARKED
    return axes.pcolormesh(*_edges(values), shown, cmap=colours, norm=norm, rasterized=many, linewidth=0)


def _numbers(axes: Any, values: Array, mesh: Any) -> None:
    """The values themselves, where there are few cells."""
    if values.size > NUMBERS or max(values.shape) > 8:
        return
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            red, green, blue, _ = mesh.cmap(mesh.norm(value))
            dark = 0.3 * red + 0.59 * green + 0.11 * blue < 0.5
            text = f"{value:g}" if value == int(value) else f"{value:#.3g}"
            axes.text(column, row, text, ha="center", va="center", fontsize=6.5, color="w" if dark else "k")


def _map_axes(axes: Any, chart: Map, survey: Survey, column: int, lowest: bool, room: float) -> None:
    """Ticks and labels; the y axis is named once a row, the x axis once a column. room: for the x axis [inch]."""
    _level_ticks(axes.xaxis, chart.columns, chart.group[0], room)
    if lowest:
        axes.set_xlabel(words.axis_words(chart.columns, survey.problem))
    if chart.rows:
        _level_ticks(axes.yaxis, chart.rows, chart.group[1])
        if column == 0:
            axes.set_ylabel(words.axis_words(chart.rows, survey.problem))
    axes.tick_params(length=0)
    for spine in ("top", "right"):
        axes.spines[spine].set_visible(True)


def _level_ticks(ruler: Any, axis: Axis, group: int, room: float | None = None) -> None:
    """The levels of an axis at its cells; those for which there is ``room`` along it [inch], if they stand side by
    side, both ends among them where that can be."""
    count = -(-len(axis.levels) // group)
    labels = [words.level_words(axis, axis.levels[place * group]) for place in range(count)]
    most = TICKS if room is None else max(2, int(room / (0.14 + LETTER * max(map(len, labels)))))
    least = -(-count // most)
    step = next((step for step in range(least, 2 * least + 1) if (count - 1) % step == 0), least)
    ruler.set_ticks(list(range(0, count, step)), labels[::step])


# --- one axis ---------------------------------------------------------------------------------------------------------


def _curves(survey: Survey, chart: Map, axis: Axis) -> Overlay:
    """Share solved, cost and evaluations over the only axis, a line a solver."""
    success = len(survey.outcomes) > 1
    shown: list[Quantity | None] = [*([None] if success else []), *_mapped(survey)]
    figure, grid = axes_grid(len(shown), len(shown), (WIDTH / max(len(shown), 2), 2.3), 0.3)
    x = axis.places()
    for axes, quantity in zip(grid, shown, strict=True):
        for k, (name, cells) in enumerate(zip(run_names(survey.solvers), chart.cells.values(), strict=True)):
            with np.errstate(invalid="ignore", divide="ignore"):
                shares = np.where(cells.stored > 0, cells.solved / cells.stored, np.nan)
            values = (shares if quantity is None else cells.medians[quantity.name])[0, 0]
            middles = np.array(
                [part.mean() for part in np.array_split(x, np.arange(chart.group[0], len(x), chart.group[0]))]
            )
            marker = {"marker": "o", "markersize": 3} if len(values) <= 40 else {}
            axes.plot(middles, values, label=name, **marker, **line_style(k))
        axes.set_xlabel(words.axis_words(axis, survey.problem))
        axes.set_ylabel(
            "share solved" if quantity is None else words.quantity_label(quantity, survey.problem)
        )
        if quantity is None:
            axes.set_ylim(-0.03, 1.03)
        elif isinstance(_norm([cells.medians[quantity.name] for cells in chart.cells.values()]), LogNorm):
            axes.set_yscale("log")
        if not axis.numeric:
            _level_ticks(axes.xaxis, axis, 1)
        elif axis.logarithmic:
            axes.set_xscale("log")
    if len(survey.solvers) > 1:
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), 3))
    over = words.over_words(chart)
    caption = Markup("{} {}").format(Markup("Gaps in a line are runs that failed."), over)
    return Overlay("curves", "Where it is solved, and at what cost", caption, figure)


# --- points -----------------------------------------------------------------------------------------------------------


def pairs(count: int) -> list[tuple[int, int]]:
    """Which axes are shown together: every one, in order, as far as there are panels; a last one with the first."""
    if count == 1:
        return [(0, 0)]
    found = [(k, k + 1) for k in range(0, count - 1, 2)]
    return (found + ([(count - 1, 0)] if count % 2 else []))[:PAIRS]


def _points(survey: Survey, chart: Points) -> Iterator[Overlay]:
    norm = _norm([costs[chart.outcomes[label] == 0] for label, costs in chart.costs.items()])
    names = run_names(survey.solvers)
    for number, (name, label) in enumerate(zip(names, survey.solvers, strict=True)):
        shown = len(chart.outcomes[label])
        if not shown:
            continue
        figure = _point_figure(survey, chart, label, norm)
        stored = survey.tallies[label][0]
        part = (
            Markup(" {} of {} runs, taken all over the study.").format(shown, stored)
            if shown < stored
            else ""
        )
        title = "Where it is solved, and at what cost"
        title += f": {name}" if len(names) > 1 else ""
        caption = Markup("{}{}{}").format(POINTED, part, _left_out(survey, chart))
        yield Overlay(f"points-{number + 1}", title, caption, figure)


POINTED = Markup("A point is a run; the colour of solved ones is their cost, other marks are failures.")


def _left_out(survey: Survey, chart: Points) -> Markup:
    seen = {place for pair in pairs(len(chart.axes)) for place in pair}
    left = [axis.path for place, axis in enumerate(chart.axes) if place not in seen]
    return Markup(" Not shown: {}.").format(", ".join(left)) if left else Markup("")


def _point_figure(survey: Survey, chart: Points, label: str, norm: Normalize) -> Figure:
    both = pairs(len(chart.axes))
    places, outcomes, costs = chart.places[label], chart.outcomes[label], chart.costs[label]
    width = WIDTH / max(len(both), 2)
    head = 0.3 if len(survey.outcomes) > 1 else 0.05
    figure, grid = axes_grid(len(both), len(both), (width, 0.86 * width + 0.2), head)
    cost = (
        next(quantity for quantity in survey.quantities if quantity.kind == "cost") if survey.solved else None
    )
    dense = len(outcomes) > MARKED
    size, solved = 9 if dense else 16, outcomes == 0
    mesh = None
    for axes, (first, second) in zip(grid, both, strict=True):
        y = costs if first == second else places[:, second]
        look = {"s": size, "linewidths": 0.2, "edgecolors": "k", "zorder": 2}
        if dense:
            axes.set_rasterization_zorder(3.5)  # all points as one image
        mesh = axes.scatter(places[solved, first], y[solved], c=costs[solved], cmap=LEVELS, norm=norm, **look)
        for which in range(1, len(survey.outcomes)):
            mine = outcomes == which
            colour, marker = _failure_look(which)
            spots = np.zeros(mine.sum()) if first == second else places[mine, second]
            where = axes.get_xaxis_transform() if first == second else axes.transData
            axes.scatter(
                places[mine, first], spots, s=size, c=colour, marker=marker, linewidths=1.0, transform=where,
                zorder=3, clip_on=first != second,
            )  # fmt: skip
        axes.set_xlabel(words.axis_words(chart.axes[first], survey.problem))
        if first == second:
            axes.set_ylabel(words.quantity_label(cost, survey.problem) if cost else "")
        else:
            axes.set_ylabel(words.axis_words(chart.axes[second], survey.problem))
        for ruler, place in ((axes.xaxis, first), (axes.yaxis, second)):
            if not chart.axes[place].numeric and (first != second or ruler is axes.xaxis):
                _level_ticks(ruler, chart.axes[place], 1)
    if mesh is not None and cost is not None and both != [(0, 0)]:
        _scale(figure, mesh, grid, words.quantity_label(cost, survey.problem))
    if len(survey.outcomes) > 1:
        _outcome_legend(figure, survey, solved=False)
    return figure
