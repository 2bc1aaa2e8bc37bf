"""Pictures of a Solution in a journal's quality: one function a picture, and `write_pictures` for files.

A failed or partial solution still gives every picture; what is missing is said in it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nhpocp.arrays import Array
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.systems.system import DISTANCE, System
from nhpocp.units import Units
from nhpocp.views import drawing, obstacles, plots, routes
from nhpocp.views import failure as failures
from nhpocp.views.drawing import Pose
from nhpocp.views.finite_path import path_of, quantity
from nhpocp.views.labels import UNNAMED
from nhpocp.views.panels import Panel, crossing_words, margins_of, merged, of_group, panels
from nhpocp.views.records import error_history
from nhpocp.views.style import (
    COLOURS,
    GREY,
    OWN_SIZE,
    Picture,
    Room,
    axes_grid,
    line_style,
    say,
    sheet,
    styled,
)
from nhpocp.views.svg_text import text_svg
from nhpocp.whole import write_files

VIEW = (2.35, 2.42)  # inches: one view of a mechanism
TITLE, LOWEST = 0.17, 1.0  # inches: over a view, and the least height of one of a wide plane


def _only_words(words: str, room: Room) -> Figure:
    width, height = room.panel(1)
    figure = Picture(figsize=(width, room.height or height))
    figure.text(
        0.5, 0.5, textwrap.fill(words, int(12.5 * width)), ha="center", va="center", fontsize=9, color=GREY
    )
    return figure


@styled
def controls(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """Controls and leg lengths, or the state's own numbers where there are no legs. [Paper] Fig. 2.

    Speeds and accelerations of the legs where they are bounded.
    """
    every = panels(solution)
    states, legs = of_group(every, "state"), of_group(every, "leg")
    bounded = [panel for panel in legs[1:] if any(curve.limits for curve in panel.curves)]
    shown = [*legs[:1], *bounded] or ([merged(states)] if states else [])
    return _over_time(solution, [*of_group(every, "control"), *shown], room)


@styled
def relative_pose(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The path relative to the goal, one panel a kind of error. [Paper] Fig. 3."""
    return _over_time(solution, of_group(panels(solution), "error"), room)


@styled
def margins(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """Distance from the singularities along the path, and those that it crosses."""
    shown = of_group(panels(solution), "margin")
    if not shown:
        return _only_words("This system names no matrix whose singularity would have to be watched.", room)
    return _over_time(solution, shown, room, crossing_words(solution))


@styled
def distances(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """How far the bodies are from obstacles and from each other: the pairs that come nearest."""
    shown = of_group(panels(solution), "distance")
    if not shown:
        return _only_words("This problem names no obstacle, and bounds no distance.", room)
    figure = _over_time(solution, shown, room)
    (axes,) = figure.axes
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=1)  # their names are long
    return figure


def _over_time(solution: Solution, shown: Sequence[Panel], room: Room, words: Iterable[str] = ()) -> Figure:
    if not shown:
        return _only_words("This system has neither inputs nor numbers that change over time.", room)
    path = path_of(solution)
    figure, grid = axes_grid(len(shown), room=room)
    for axes, panel in zip(grid, shown, strict=True):
        plots.draw(axes, panel, path)
    say(figure, [*words, path.words])
    return figure


@styled
def convergence(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The error over the iterations, with the decay that theory promises. [Paper] eqs. (9), (17)."""
    if not np.isfinite(error_history(solution)[1]).any():
        return _only_words("The solver recorded no error: there is no convergence to draw.", room)
    figure, (axes,) = axes_grid(1, room=room)
    plots.draw_convergence(axes, solution)
    return figure


@styled
def robot(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The mechanism at the start, in the middle and at the end, or the bare path where a system draws nothing."""
    poses = drawing.poses_of(solution)
    if not poses[0].drawing["lines"]:
        return _bare_path(solution, room)
    path, problem = path_of(solution), solution.problem
    points, goal = drawing.path_points(solution, path), drawing.goal_pose(problem)
    along = routes.route_places(solution)
    figure = mechanism(problem.system, poses, goal, points, problem.units, room, along)
    entries = drawing.legend_entries(poses[0].drawing)
    entries += [("path", {"color": COLOURS[6], "linewidth": 1.1})] if len(points) else []
    entries += [("route", routes.ROUTE)] if along is not None else []
    entries += [("goal", {"color": "0.45", "linewidth": 0.7, "linestyle": (0, (4, 2))})] if goal else []
    handles = [Line2D([], [], label=words, **style) for words, style in entries]
    columns = len(handles) if _columns(len(poses), room) == len(poses) else 4
    figure.legend(handles=handles, loc="lower center", ncols=columns, bbox_to_anchor=(0.5, 0.015))
    say(figure, [path.words])
    return figure


def mechanism(
    system: System,
    poses: Sequence[Pose],
    goal: Pose | None,
    points: Array,
    units: Units = UNNAMED,
    room: Room = OWN_SIZE,
    route: Array | None = None,
) -> Figure:
    """Poses of a mechanism side by side, with the dashed goal and the path (samples, 3 or 2) where there are any.

    route: that the path follows, of as many numbers.
    """
    shown = [pose.drawing for pose in poses] + ([goal.drawing] if goal else [])
    every = points if route is None else np.concatenate([points, route])
    low, high = obstacles.widened(system, *drawing.extent(*shown, points=every))
    names = drawing.axis_names(system, len(low), units)
    (wide, tall), plane = (high - low)[:2], len(low) == 2 and not system.plotted
    figure, boxes = _views(len(poses), room, tall / wide if plane else None)
    for pose, (left, bottom, width, height) in zip(poses, boxes, strict=True):
        # room for the name of the z axis, and for words over the view
        title = TITLE / figure.get_figheight()
        box = (left, bottom, 0.96 * width, height - title)
        zoom = _zoom(box[2] * figure.get_figwidth())
        axes = drawing.add_view(figure, box, low, high, names, zoom, not system.plotted)
        obstacles.plot_obstacles(axes, system, low, high)
        if goal:
            drawing.plot_robot(axes, goal.drawing, ghost=True)
        drawing.plot_robot(axes, pose.drawing)
        if route is not None:
            axes.plot(*route.T, **routes.ROUTE)
        drawing.plot_path(axes, points)
        figure.text(left + width / 2, bottom + height - 0.7 * title, pose.words, ha="center", va="center")
    return figure


def _zoom(width: float) -> float:
    """Of a view of that width [inch]: the name of the z axis takes as much of a narrow one as of a wide one."""
    return max(0.3, min(drawing.ZOOM, 1.19 - 0.79 / width))


def _columns(count: int, room: Room) -> int:
    """How many of so many views stand side by side."""
    return room.columns(count, VIEW[0] / 1.5)


def _views(
    count: int, room: Room, flat: float | None = None
) -> tuple[Figure, list[tuple[float, float, float, float]]]:
    """A figure for so many views, and their boxes in fractions of it, over a legend.

    flat: height over width of what they show at one scale, in the plane; a wide one takes no more room than it fills.
    """
    columns = _columns(count, room)
    rows, foot = -(-count // columns), 0.33 if columns == count else 0.5  # inches
    width, height = room.panel(columns, (max(1.0, 1.5 / count) * VIEW[0], VIEW[1]), 1.1)
    if flat is not None:
        height = min(height, max(LOWEST, TITLE + drawing.height_of(0.96 * width, flat)))
    whole = room.height or rows * height + foot
    figure = Picture(figsize=(columns * width, whole))
    low, tall = foot / whole, (1 - foot / whole) / rows
    places = [divmod(i, columns) for i in range(count)]
    return figure, [(j / columns, low + (rows - 1 - i) * tall, 1 / columns, tall) for i, j in places]


def task(problem: PlanningProblem) -> Figure | None:
    """The mechanism at its start and the goal dashed; nothing for a system that draws nothing."""
    start = Pose("start", problem.system.drawing(problem.start_point))
    goal = drawing.goal_pose(problem)
    return standing(problem.system, start, goal) if start.drawing["lines"] else None


def standing(system: System, pose: Pose, goal: Pose | None = None) -> Figure:
    """A mechanism in one pose."""
    with sheet():
        return mechanism(system, [pose], goal, np.empty((0, drawing.dimension(pose.drawing))))


def _bare_path(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The first numbers of the state against each other, or the tips of the body's axes of a rotation."""
    path, states = path_of(solution), of_group(panels(solution), "state")
    if not path.samples:
        return _only_words(path.words or "There is no path to draw.", room)
    side = room.panel(1)[0]
    figure = Picture(figsize=(side, room.height or side))
    if states:
        curves = merged(states).curves[:3]
        shown = np.column_stack([curve.values for curve in curves])
        drawing.plot_curves(figure, [shown], [curve.label for curve in curves], [{}])
    else:
        turned = quantity(solution, solution.problem.system.state_space.blocks[0].name, path)
        tips = [turned.reshape(-1, 3, 3)[:, :, i] for i in range(3)]
        words = ("tip of the body's $x$", "of $y$", "of $z$")
        looks = [{"label": label, **line_style(i)} for i, label in enumerate(words)]
        drawing.plot_curves(figure, tips, drawing.SPACE, looks)
        figure.legend(loc="lower center", ncols=3)
    say(figure, [path.words])
    return figure


@styled
def trees(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """The poses to which a search for a route came from start and goal, where it found none."""
    if not routes.has_trees(solution):
        return _only_words("No search for a route ended without one here.", room)
    return routes.trees(solution, room)


@styled
def failure(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """Why a solve failed: error and margins by evaluation, and where the last path is in trouble."""
    return failures.failure(solution, room)


FIGURES: dict[str, Callable[..., Figure]] = {
    "controls": controls,
    "relative_pose": relative_pose,
    "convergence": convergence,
    "margins": margins,
    "distances": distances,
    "robot": robot,
    "trees": trees,
    "failure": failure,
}


def names_of(solution: Solution) -> list[str]:
    """The pictures that say something of a solution: what converged has no failure, what nothing watches no margins."""
    silent = {"failure"} if solution.outcome is Outcome.CONVERGED else set()
    if not margins_of(solution, "sigma"):
        silent.add("margins")
    if DISTANCE not in solution.trajectory:
        silent.add("distances")
    if not routes.has_trees(solution):
        silent.add("trees")
    return [name for name in FIGURES if name not in silent]


DATELESS: dict[str, dict[str, Any]] = {
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None, "ModDate": None},
}


def save(figure: Figure, file: Path, text: bool = False) -> Path:
    """A figure as a file whose bytes depend on the figure alone: no date, no random names.

    text: whether the letters of an SVG stay letters, which takes a tenth of a second; else they are outlines.
    """
    kind = file.suffix.lower()
    with sheet():
        if text and kind == ".svg":
            file.write_text(text_svg(figure, DATELESS[kind]), encoding="utf-8")
        else:
            figure.savefig(file, metadata=DATELESS.get(kind, {}))
    return file


def write_pictures(
    solution: Solution,
    folder: Path,
    formats: Sequence[str] = ("svg", "png"),
    names: Iterable[str] | None = None,
    room: Room = OWN_SIZE,
    text: bool = False,
) -> list[Path]:
    """Every picture (`names_of`), or those named, in every format; the files written, in that order.

    room: what each may take of a page; panels that find no place side by side stand one under another. text: as of
    `save`. Each file is written whole, and none unless all can be: a full disk leaves the older ones.
    """
    figures = {name: partial(make, room=room) for name, make in FIGURES.items()}
    return write_all(figures, solution, folder, formats, names_of(solution) if names is None else names, text)


def write_all(
    figures: Mapping[str, Callable[[Any], Figure]],
    subject: Any,
    folder: Path,
    formats: Sequence[str],
    names: Iterable[str],
    text: bool = False,
) -> list[Path]:
    """Those of these figures of a subject that are named, as files."""
    files = {name: [f"{name}.{kind}" for kind in formats] for name in names}

    def draw(scratch: Path) -> None:
        for name, made in files.items():
            figure = figures[name](subject)
            for file in made:
                save(figure, scratch / file, text)

    write_files(Path(folder), draw)
    return [Path(folder) / file for made in files.values() for file in made]
