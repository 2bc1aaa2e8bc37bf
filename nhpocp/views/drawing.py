"""Mechanisms in space or in the plane, from the plain arrays of `System.drawing`; closed lines are filled.

Lines are named "kind" or "kind number" (leg 1, r 1): the number gives the colour, the kind the weight.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.systems.system import System
from nhpocp.units import Units
from nhpocp.views.finite_path import FinitePath, path_of, quantity
from nhpocp.views.labels import UNNAMED, axis_label, symbol
from nhpocp.views.style import COLOURS, GREY, line_style

ELEVATION, AZIMUTH = 20.0, -62.0  # degrees
ZOOM = 0.84  # of a view with room for the names of its axes
SPACE = ("$x$", "$y$", "$z$")
MARGINS = (0.32, 0.05)  # inches: below and above the axes of a view of the plane
DARK, PARTS = "#4b5563", {"wheel", "roller", "drawbar", "window"}  # closed lines that are a part of some body
FILLS = ("0.72", "#F0C05A", "#9CCBE8", "#B7DDB0")
_THIN = ("#AA4499", "#117733", "#7A5C00", "#882255")  # the path is black
THIN = 0.12  # of the longest axis: a shorter one has no room for numbers
_MARKERS = ("o", "s", "^", "D")


@dataclass(frozen=True)
class Pose:
    """A moment of a motion and its drawing."""

    words: str
    drawing: Mapping[str, Any]


def poses_of(solution: Solution) -> list[Pose]:
    """Start, middle and end of the path, as far as it is finite; the start of the problem where there is none."""
    system, path = solution.problem.system, path_of(solution)
    if not path.samples:
        return [Pose("start $t$ = 0", system.drawing(solution.problem.start_point))]
    middle = int(np.argmin(np.abs(path.times - 0.5 * (path.times[0] + path.times[-1]))))
    chosen = {0: "start", middle: "middle", path.samples - 1: "end"}
    states = states_of(solution, path)
    return [
        Pose(f"{words}, $t$ = {path.times[k]:.3g}", system.drawing(states[k])) for k, words in chosen.items()
    ]


def states_of(solution: Solution, path: FinitePath) -> Array:
    """The packed points of a path, (samples, size)."""
    names = solution.problem.system.state_space.names
    return np.hstack([quantity(solution, name, path) for name in names])


def goal_pose(problem: PlanningProblem) -> Pose | None:
    """The wanted pose, where the goal fixes the whole state."""
    return Pose("goal", problem.system.drawing(problem.goal_point)) if problem.goal_is_a_pose else None


def path_points(solution: Solution, path: FinitePath) -> Array:
    """Where the moving body goes, (samples, 3 or 2): the drawing's trace, else the state's first vector of lengths."""
    system = solution.problem.system
    if not path.samples:
        return np.empty((0, dimension(system.drawing(solution.problem.start_point))))
    return places_of(system, states_of(solution, path))


def places_of(system: System, states: Array) -> Array:
    """Where the moving body is in packed states, as `path_points`; at least one state."""
    first = system.drawing(states[0])
    numbers = dimension(first)
    if "trace" in first:
        return np.array([system.drawing(state)["trace"] for state in states], dtype=float)
    for block in system.state_space.blocks:
        if block.kind == "vector" and block.unit == "length" and block.components in (2, 3):
            values = system.state_space.split(states)[block.name]
            return np.pad(values, ((0, 0), (0, max(0, numbers - values.shape[1]))))
    return np.empty((0, numbers))


def dimension(drawn: Mapping[str, Any]) -> int:
    """2 for a mechanism in the plane, 3 for one in space."""
    trace = [drawn["trace"]] if "trace" in drawn else []
    items = [*drawn["lines"].values(), *drawn["points"].values(), *trace]
    return int(np.shape(items[0])[-1]) if items else 3


def axis_names(system: System, numbers: int, units: Units = UNNAMED) -> list[str]:
    """x, y, z, with the unit of a state that has lengths; what a system plots where that is no place."""
    if system.plotted:
        return [f"${name}$" for name in system.plotted]
    lengths = any(block.unit == "length" for block in system.state_space.blocks)
    return [axis_label("", name, units.words("length") if lengths else "") for name in SPACE[:numbers]]


def extent(*drawings: Mapping[str, Any], points: Array) -> tuple[Array, Array]:
    """(low, high) corners of a box around everything, never flat."""
    parts = [np.asarray(line, dtype=float) for drawing in drawings for line in drawing["lines"].values()]
    parts += [np.asarray(dots, dtype=float) for drawing in drawings for dots in drawing["points"].values()]
    every = np.concatenate([*parts, points])
    every = every[np.isfinite(every).all(axis=1)]
    numbers = points.shape[1]
    low, high = (
        (every.min(axis=0), every.max(axis=0)) if len(every) else (np.zeros(numbers), np.ones(numbers))
    )
    least = 0.05 * max(float((high - low).max()), 1e-9)
    grow = 0.5 * np.maximum(least - (high - low), 0) + 0.03 * (high - low).max()
    return low - grow, high + grow


def height_of(width: float, flat: float) -> float:
    """Of a view of the plane [inches] that its axes fill, where they show what is ``flat`` times as high as wide."""
    return _across(width)[1] * flat + sum(MARGINS)


def _across(width: float) -> tuple[float, float]:
    """Before the axes of a view of the plane, where the numbers of y and its name stand, and of these axes [inches]."""
    before = max(0.21 * width, 0.45)
    return before, 0.97 * width - before


def add_view(
    figure: Any,
    box: tuple[float, float, float, float],
    low: Array,
    high: Array,
    names: Sequence[str],
    zoom: float = 1.0,
    one_scale: bool = True,
) -> Any:
    """Axes in a box of the figure at one scale: in space, or for corners of two numbers the plane from above.

    one_scale: of both axes; False where a plane shows numbers that are no places.
    """
    if len(low) == 3:
        axes = figure.add_axes(box, projection="3d", computed_zorder=False)
        set_view(axes, low, high, names, zoom)
        return axes
    left, bottom, width, height = box
    below, above = (margin / figure.get_figheight() for margin in MARGINS)
    before, across = (part / figure.get_figwidth() for part in _across(width * figure.get_figwidth()))
    axes = figure.add_axes((left + before, bottom + below, across, height - below - above))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=names[0], ylabel=names[1])
    axes.set_aspect("equal" if one_scale else "auto")
    for axis, size in zip((axes.xaxis, axes.yaxis), high - low, strict=True):
        axis.set_major_locator(_few_ticks(3 if not one_scale or size > 0.6 * (high - low).max() else 1))
    return axes


def set_view(axes: Any, low: Array, high: Array, names: Sequence[str], zoom: float = 1.0) -> None:
    """One scale on all three axes, few ticks, quiet walls."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=zoom)
    axes.set_proj_type("ortho")
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    # words come as much nearer to the axes as these are smaller, and do not shrink
    nearer = min(1.0, zoom / ZOOM)
    for axis, name, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), names, high - low, strict=True):
        share = size / (high - low).max()
        axis.set_major_locator(_few_ticks(3 if share > 0.4 else 2 if share > THIN else 0))
        axis.set_pane_color((1, 1, 1, 0))
        axis.line.set_color("0.5")
        axis._axinfo["grid"].update(color="0.9", linewidth=0.4)
        axis.set_label_text(name)
        axis.labelpad = 15 / nearer - 21
    axes.tick_params(pad=5 / nearer - 8, labelsize=6.5)


def _few_ticks(count: int) -> Any:
    from matplotlib.ticker import MaxNLocator, NullLocator

    if not count:
        return NullLocator()
    return MaxNLocator(nbins=count + 1, steps=[1, 2, 2.5, 5, 10])


def _depth(points: Array) -> float:
    """How near to the eye the middle of some points is: what is nearer is painted later; all the same in the plane."""
    if points.shape[1] == 2:
        return 0.0
    elevation, azimuth = np.radians([ELEVATION, AZIMUTH])
    eye = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    return float(np.mean(points, axis=0) @ eye)


def is_closed(line: Array) -> bool:
    return len(line) > 3 and np.allclose(line[0], line[-1])


def bodies_of(closed: Mapping[str, Array]) -> dict[str, Array]:
    """The closed lines that are no wheel, roller, drawbar or window of another."""
    return {name: line for name, line in closed.items() if not PARTS & set(name.split())}


def fills_of(closed: Mapping[str, Array]) -> dict[str, str]:
    """The colour of each closed line: bodies in turn, their parts dark."""
    bodies = list(bodies_of(closed))
    return {name: FILLS[bodies.index(name) % len(FILLS)] if name in bodies else DARK for name in closed}


def kinds_of(lines: Mapping[str, Array]) -> dict[str, float]:
    """Kinds of the open lines with their mean length, the longest first; equal ones, up to rounding, as they came."""
    sizes: dict[str, list[float]] = {}
    for name, line in lines.items():
        if not is_closed(line):
            sizes.setdefault(split_name(name)[0], []).append(
                float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
            )
    means = {kind: float(f"{np.mean(some):.6g}") for kind, some in sizes.items()}
    return dict(sorted(means.items(), key=lambda item: -item[1]))


def split_name(name: str) -> tuple[str, int | None]:
    numbered = re.fullmatch(r"(.*?)\s+(\d+)", name)
    return (numbered[1], int(numbered[2]) - 1) if numbered else (name, None)


def plot_robot(axes: Any, drawing: Mapping[str, Any], *, ghost: bool = False) -> None:
    """One drawing on its axes: filled bodies, coloured legs, thin axes; a ghost is its bodies' outlines, dashed."""
    lines = {name: np.asarray(line, dtype=float) for name, line in drawing["lines"].items()}
    lines = {name: line for name, line in lines.items() if np.isfinite(line).all()}
    closed = {name: line for name, line in lines.items() if is_closed(line)}
    if ghost:
        for line in (bodies_of(closed) or lines).values():
            axes.plot(*line.T, color="0.45", linewidth=0.7, linestyle=(0, (4, 2)), zorder=2)
        return
    points = {name: np.asarray(dots, dtype=float) for name, dots in drawing["points"].items()}
    order = {name: _depth(item) for name, item in {**lines, **points}.items()}
    rank = {name: 10 + i for i, name in enumerate(sorted(order, key=lambda name: order[name]))}
    flat = dimension(drawing) == 2
    fills = fills_of(closed)
    for name, line in closed.items():
        look = {"facecolor": fills[name], "edgecolor": "0.2", "linewidth": 0.9, "alpha": 0.75}
        if flat:
            axes.fill(*line.T, zorder=rank[name], **look)
            continue
        fill = Poly3DCollection([line], **look)
        fill.set_zorder(rank[name])
        axes.add_collection3d(fill)
    kinds = list(kinds_of(lines))
    for name, line in lines.items():
        if name in closed:
            continue
        kind, number = split_name(name)
        axes.plot(*line.T, zorder=rank[name], **open_line_style(kinds.index(kind), number))
    for i, (name, dots) in enumerate(points.items()):
        size, marker = (22, 9, 9, 9)[i % 4], _MARKERS[i % len(_MARKERS)]
        axes.scatter(
            *dots.T,
            s=size,
            marker=marker,
            color="white",
            edgecolor="0.15",
            linewidth=0.7,
            zorder=rank[name] + 100,
            **({} if flat else {"depthshade": False}),
        )


def open_line_style(kind: int, number: int | None) -> dict[str, Any]:
    """The longest kind is drawn thick in the colour of its number, the others thin in the colour of their kind."""
    if kind == 0:
        return {**line_style(number or 0), "linewidth": 2.0}
    return {"color": _THIN[(kind - 1) % len(_THIN)], "linewidth": 1.2, "linestyle": "-"}


def legend_entries(drawing: Mapping[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """(words, line style) of every leg and every other kind of line, for a legend."""
    lines = {name: np.asarray(line, dtype=float) for name, line in drawing["lines"].items()}
    kinds, entries = list(kinds_of(lines)), []
    for name, line in lines.items():
        kind, number = split_name(name)
        if not is_closed(line) and kind == kinds[0]:
            entries.append((name.replace("_", " "), open_line_style(0, number)))
    return entries + [(symbol(kind), open_line_style(i, None)) for i, kind in enumerate(kinds) if i]


def plot_path(axes: Any, points: Array, **line: Any) -> None:
    """The moving body's path with its start (open) and its end (full)."""
    if not len(points):
        return
    axes.plot(*points.T, **{"color": COLOURS[6], "linewidth": 1.1, "zorder": 200, **line})
    for k, fill in ((0, "white"), (-1, "black")):
        axes.plot(
            *points[[k]].T,
            marker="o",
            markersize=2.6,
            markeredgewidth=0.7,
            color=GREY,
            markeredgecolor="black",
            markerfacecolor=fill,
            zorder=201,
        )


def plot_curves(
    figure: Any, curves: Sequence[Array], names: Sequence[str], looks: Sequence[Mapping[str, Any]]
) -> Any:
    """Curves of one, two or three numbers against each other, at one scale; one number against the sample."""
    columns = curves[0].shape[1]
    if columns == 3:
        axes = add_view(figure, (0.02, 0.06, 0.88, 0.84), *extent(points=np.concatenate(curves)), names, 0.95)
    else:
        axes = figure.add_axes((0.18, 0.14, 0.76, 0.76))
        axes.set(xlabel=names[0], ylabel=names[1] if columns == 2 else "")
        axes.set_aspect("equal" if columns == 2 else "auto", adjustable="datalim")
    for curve, look in zip(curves, looks, strict=True):
        plot_path(axes, curve if columns > 1 else np.c_[curve, np.arange(len(curve))], **look)
    return axes
