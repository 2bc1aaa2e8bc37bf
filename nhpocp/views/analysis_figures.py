"""Pictures of an Analysis: the map of singularities, margins along the initial guess, the agility ellipsoid."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nhpocp.analysis import Analysis
from nhpocp.analysis.agility import Ellipsoid
from nhpocp.analysis.slices import Coordinate, SingularityMap, coordinates
from nhpocp.arrays import Array
from nhpocp.systems.margins import det, margin
from nhpocp.systems.system import System
from nhpocp.views.figures import write_all
from nhpocp.views.labels import axis_label, notation, symbol
from nhpocp.views.plots import margin_axis, time_axis
from nhpocp.views.style import (
    ALARM,
    COLOURS,
    COMPACT,
    GREY,
    PANEL,
    axes_grid,
    legend_above,
    line_style,
    say,
    styled,
)

# red and blue that colour-blind readers can tell apart, pale where a determinant vanishes
SIGNED = LinearSegmentedColormap.from_list("signed", ["#8C2D04", "#F4A582", "#FAFAFA", "#92C5DE", "#08519C"])
LEVELS = 9  # of the lines of equal margin
SURFACE: dict[str, Any] = {"colors": "k", "linewidths": 1.3}
TOUCHING: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 2.4, "color": "k", "zorder": 3}
ALARMED: dict[str, Any] = {"linestyle": "none", "marker": "X", "markersize": 5.5, "color": ALARM}
CROSSING: dict[str, Any] = {**ALARMED, "markeredgecolor": "w", "markeredgewidth": 0.6, "zorder": 6}
ZERO: dict[str, Any] = {**ALARMED, "marker": "v", "markersize": 4, "clip_on": False}
END: dict[str, Any] = {
    "linestyle": "none",
    "markersize": 5,
    "color": "w",
    "markeredgecolor": "k",
    "zorder": 7,
}
JUMP = 0.5  # of the largest margin: a change of sign larger than this in one step is no zero


# --- the map ---------------------------------------------------------------------------------------------------------


@styled
def singularity_map(analysis: Analysis) -> Figure:
    """σ_min with the sign of det over the slice, a panel a matrix; start, goal and guess are projected onto it."""
    the_map = analysis.map
    if the_map is None:
        raise ValueError("this analysis has no map of singularities")
    figure, axes = axes_grid(count := len(the_map.signed), count, (PANEL[0], PANEL[1] + 0.45))
    entries: dict[str, Any] = {}
    for panel, (name, values) in zip(axes, the_map.signed.items(), strict=True):
        plot_signed(panel, the_map, name, values)
        plot_places(panel, analysis, the_map, name)
        entries |= {label: handle for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    rows = -(-len(entries) // (2 * len(axes)))
    columns = -(-len(entries) // rows)
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=columns, **COMPACT)
    fixed = ", ".join(_value(name, value, the_map) for name, value in the_map.fixed().items())
    words = f"The other coordinates are as at {_at(the_map.at)}: {fixed}." if fixed else ""
    figure.supxlabel("\n".join(textwrap.wrap(words, 80 * len(axes))), fontsize=7.5, color=GREY)
    return figure


def _at(name: str) -> str:
    return f"${name[0]}${name[1:]} of the initial guess" if name.startswith("t = ") else f"the {name}"


def plot_signed(axes: Any, the_map: SingularityMap, name: str, values: Array) -> None:
    """One matrix: colours by distance from the singular surface, the surface itself as a line."""
    x, y = _shown(the_map.first, the_map.first_values), _shown(the_map.second, the_map.second_values)
    known = values[np.isfinite(values)]
    largest = float(np.abs(known).max()) if known.size and np.any(known) else 1.0
    low, high = min(float(known.min(initial=0.0)), 0.0), max(float(known.max(initial=0.0)), 0.0)
    mesh = axes.pcolormesh(
        *(x, y, np.ma.masked_invalid(values)),
        cmap=SIGNED,
        norm=TwoSlopeNorm(0.0, -largest, largest),
        shading="gouraud",
        rasterized=True,
    )
    axes.set_facecolor("0.85")  # where there is no value
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.02, aspect=28)
    smooth = np.ma.masked_where(_jumps(values, JUMP * largest), values)
    if not smooth.mask.all():
        levels = [
            level for level in MaxNLocator(LEVELS).tick_values(low, high) if low < level < high and level
        ]
        if levels:
            axes.contour(x, y, smooth, levels=levels, colors="0.4", linewidths=0.35, linestyles="-")
            bar.ax.hlines(levels, 0, 1, colors="0.4", linewidths=0.35)
            bar.set_ticks([*levels, 0.0])
        if (known > 0).any() and (known < 0).any():
            axes.contour(x, y, smooth, levels=[0.0], **SURFACE)
            axes.plot([], [], "k-", linewidth=1.3, label="determinant changes its sign")
    if len(the_map.touching[name]):
        spots = [
            _shown(c, v)
            for c, v in zip((the_map.first, the_map.second), the_map.touching[name].T, strict=True)
        ]
        axes.plot(
            *(values[::4] for values in spots), label="determinant is zero, but keeps its sign", **TOUCHING
        )
    axes.set(
        xlabel=_label(the_map.first), ylabel=_label(the_map.second), xlim=(x[0], x[-1]), ylim=(y[0], y[-1])
    )
    if the_map.first.unit == the_map.second.unit and 0.5 < (x[-1] - x[0]) / (y[-1] - y[0]) < 2:
        axes.set_aspect("equal", "box")
    axes.grid(visible=False)
    letter = name.upper()
    bar.set_label(rf"$\mathrm{{sgn}}(\det {letter})\,\sigma_{{\min}}({letter})$ [–]")
    bar.ax.set_ylim(low, high if high > low else 1.0)
    bar.outline.set_linewidth(0.4)


def _jumps(values: Array, size: float) -> Array:
    """Where the sign changes by a jump: through a pole or a direction that is lost, not through zero."""
    jumps = ~np.isfinite(values)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            step = np.abs(np.diff(values, axis=axis)) > size
            before, after = ([(0, 0), (0, 0)] for _ in range(2))
            before[axis], after[axis] = (0, 1), (1, 0)
            jumps |= np.pad(step, before) | np.pad(step, after)
    return jumps


def plot_places(axes: Any, analysis: Analysis, the_map: SingularityMap, name: str) -> None:
    """Start, goal and initial guess, projected, and where the guess crosses this matrix' zero."""
    space, path = analysis.problem.system.state_space, analysis.path

    def projected(states: Array) -> list[Array]:
        return [_shown(c, c.of(space, states)) for c in (the_map.first, the_map.second)]

    if path is not None and len(path.times) > 1:
        line = projected(path.states)
        axes.plot(*line, color="w", linewidth=2.4, zorder=4)
        label = "initial guess, projected"
        axes.plot(*line, color="k", linewidth=1.0, linestyle=(0, (4, 1.5)), zorder=5, label=label)
        mine = [i for i, crossing in enumerate(path.crossings) if crossing.which == f"det_{name}"]
        if mine:
            label = rf"guess crosses $\det {name.upper()} = 0$"
            axes.plot(*projected(path.crossing_states[mine]), label=label, **CROSSING)
    for end, marker in (("start", "o"), ("goal", "s")):
        if end in analysis.points:
            axes.plot(*projected(analysis.points[end].state[None]), marker=marker, label=end, **END)


def _shown(coordinate: Coordinate, values: Array) -> Array:
    """Angles in degrees."""
    return np.degrees(values) if coordinate.unit == "angle" else values


def _label(coordinate: Coordinate) -> str:
    name = coordinate.name if coordinate.block.kind == "rotation" else symbol(coordinate.name)
    return axis_label("", name, {"angle": "°"}.get(coordinate.unit, coordinate.unit))


def _value(name: str, value: float, the_map: SingularityMap) -> str:
    coordinate = coordinates(the_map.system.state_space)[name]
    words = name if coordinate.block.kind == "rotation" else symbol(name)
    shown = round(np.degrees(value), 3) if coordinate.unit == "angle" else value
    return f"{words} = {shown + 0.0:.4g}{'°' if coordinate.unit == 'angle' else ''}".replace("-", "−")


# --- along the initial guess -----------------------------------------------------------------------------------------


@styled
def along_guess(analysis: Analysis) -> Figure:
    """How near the initial guess comes to losing a bracket direction, and to the singularities of each matrix."""
    path = analysis.path
    if path is None or len(path.times) < 2:
        raise ValueError("this analysis has no path to draw")
    figure, (axes,) = axes_grid(1, 1, (1.35 * PANEL[0], PANEL[1] + 0.15))
    rank, degree, floor = path.generic.rank, len(path.generic.spectra), analysis.tolerance
    label = rf"$\sigma_{{{rank}}}/\sigma_1$ of the brackets up to degree {degree}"
    axes.plot(path.times, np.maximum(path.bracket_margin, floor), label=label, **line_style(0))
    seen = [np.maximum(path.bracket_margin, floor)]
    for i, own in enumerate(
        [own for name in path.margins if (own := margin(name)) and own.kind == "sigma"], 1
    ):
        zero = det(own.matrix)
        zeros = [crossing.time for crossing in path.crossings if crossing.which == zero.name]
        places = np.searchsorted(path.times, zeros)  # the samples go past the zeros
        times, values = np.insert(path.times, places, zeros), np.insert(path.margins[own.name], places, 0.0)
        seen.append(np.maximum(values, floor))
        axes.plot(times, seen[-1], label=f"${own.symbol}$", **line_style(i))
        if zeros:
            axes.plot(zeros, np.full(len(zeros), floor), label=f"${zero.symbol} = 0$", **ZERO)
    if path.irregular:
        vectors = sorted({str(path.growth[i].vector) for i in path.irregular})
        words = f"growth vector {' or '.join(vectors if len(vectors) < 4 else [*vectors[:2], 'others'])}"
        axes.plot(path.times[path.irregular], np.full(len(path.irregular), floor), label=words, **CROSSING)
    time_axis(axes, path.times[-1], path.times[-1], analysis.problem.units.time)
    axes.set_ylabel("least singular value [–]")
    margin_axis(axes, seen)
    legend_above(axes, 3, **COMPACT)
    say(figure, [note for note in analysis.notes if note.startswith("the path")])
    return figure


# --- agility ---------------------------------------------------------------------------------------------------------


@styled
def agility(analysis: Analysis) -> Figure:
    """The agility ellipsoid of the initial guess: its semi-axes, and where its axes point."""
    if analysis.end_point is None:
        raise ValueError("this analysis has no end point to draw")
    figure, (left, right) = axes_grid(2)
    ellipsoid = analysis.end_point.agility
    places = np.arange(1, len(ellipsoid.semi_axes) + 1)
    plot_semi_axes(left, places, ellipsoid)
    plot_axes(right, places, analysis.problem.system, ellipsoid)
    return figure


def plot_semi_axes(axes: Any, places: Array, ellipsoid: Ellipsoid) -> None:
    """How far the end point moves along each axis for one unit of effort."""
    least = max(ellipsoid.semi_axes[0] * 1e-9, 1e-300)
    axes.bar(places, np.maximum(ellipsoid.semi_axes, least), width=0.62, color=COLOURS[0])
    axes.set(
        yscale="log",
        xticks=places,
        xlabel="principal axis",
        ylabel="semi-axis per $\\sqrt{\\mathrm{effort}}$ [–]",
    )
    axes.set_title(rf"dexterity $\sqrt{{\det D}}$ = {_times_ten(ellipsoid.volume)}", loc="left")
    axes.grid(axis="x", visible=False)


def _times_ten(value: float) -> str:
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    return rf"${mantissa}\cdot 10^{{{int(exponent)}}}$" if exponent else f"${mantissa}$"


def plot_axes(axes: Any, places: Array, system: System, ellipsoid: Ellipsoid) -> None:
    """The components of each axis, a column an axis."""
    shown = ellipsoid.axes * np.sign(
        ellipsoid.axes[np.abs(ellipsoid.axes).argmax(axis=0), range(len(places))]
    )
    mesh = axes.imshow(
        shown,
        cmap=SIGNED,
        vmin=-1,
        vmax=1,
        aspect="auto",
        extent=(0.5, len(places) + 0.5, len(places) + 0.5, 0.5),
    )
    labels = [_component(system, label) for label in ellipsoid.labels]
    axes.set(xticks=places, yticks=places, yticklabels=labels, xlabel="principal axis")
    axes.set_title("its direction in tangent coordinates", loc="left")
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.figure.colorbar(mesh, ax=axes, pad=0.02, aspect=28).outline.set_linewidth(0.4)


def _component(system: System, label: str) -> str:
    """position[0] as the first component of the block's symbol."""
    name, _, place = label.rstrip("]").partition("[")
    return notation(system, name, *([int(place)] if place else [])).symbol


# --- files -----------------------------------------------------------------------------------------------------------

FIGURES: dict[str, Callable[[Analysis], Figure]] = {
    "singularity_map": singularity_map,
    "along_guess": along_guess,
    "agility": agility,
}


def names_of(analysis: Analysis) -> list[str]:
    """The pictures for which there is something to show."""
    path = analysis.path
    there = {
        "singularity_map": analysis.map is not None,
        "along_guess": path is not None and len(path.times) > 1,
        "agility": analysis.end_point is not None,
    }
    return [name for name in FIGURES if there[name]]


def write_pictures(analysis: Analysis, folder: Path, formats: Sequence[str] = ("svg", "png")) -> list[Path]:
    """Every picture in every format, each whole and all or none; the files written."""
    return write_all(FIGURES, analysis, folder, formats, names_of(analysis))
