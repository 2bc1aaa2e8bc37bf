"""Several solutions of one problem in the same pictures: a panel a quantity, a colour and a dash a run."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nhpocp.comparison import Entry
from nhpocp.solution import Solution
from nhpocp.systems.system import DISTANCE
from nhpocp.views import drawing, obstacles, plots, routes
from nhpocp.views.finite_path import FinitePath, path_of, quantity
from nhpocp.views.labels import axis_label
from nhpocp.views.panels import Panel, merged, of_group, panels
from nhpocp.views.records import column, decays, error_history, positive
from nhpocp.views.style import Picture, Room, axes_grid, line_style, sheet

WIDTH, HEIGHT = 7.2, 1.75  # inches: a page's text, and a row of panels
FLAT = 1e-9  # height over width, from which a path in space is shown from above


@dataclass(frozen=True)
class Overlay:
    """A picture with its words; the caption is markup. ``abscissa``: t or k where curves run over one."""

    name: str
    title: str
    caption: Markup
    figure: Figure
    abscissa: str = ""


@dataclass(frozen=True)
class _Motion:
    """What the pictures need of a run: its solution, name, number among the runs, path and panels."""

    solution: Solution
    name: str
    number: int
    path: FinitePath
    panels: Sequence[Panel]

    @property
    def look(self) -> dict[str, Any]:
        return {**line_style(self.number), "linewidth": 1.2}


def overlays(
    entries: Sequence[Entry], names: Sequence[str], wanted: Container[str] | None = None
) -> list[Overlay]:
    """Every picture that these runs have in common, in the order of a report; none where nothing was tried.

    ``wanted``: names of those to make, all unless said.
    """
    motions = []
    for i, (entry, name) in enumerate(zip(entries, names, strict=True)):
        if entry.tried and (path := path_of(entry.solution)).samples:
            motions.append(_Motion(entry.solution, name, i, path, panels(entry.solution)))
    if not motions:
        return []
    turned = any(block.kind == "rotation" for block in motions[0].solution.problem.system.state_space.blocks)
    over_time = partial(_over_time, motions)
    relative = RELATIVE + ROTATIONS * turned
    makers: dict[str, Callable[[], Overlay | None]] = {
        "controls": lambda: over_time("controls", "Controls", CONTROLS, "control"),
        "legs": lambda: over_time("legs", "Legs", LEGS, "leg", 0),
        "relative_pose": lambda: over_time("relative_pose", "Relative pose", relative, "error"),
        "path": lambda: _path(motions) or _plain_path(motions),
        "trees": lambda: _trees(motions),
        "distances": lambda: _distances(motions),
        "margins": lambda: over_time("margins", "Singularity margins", MARGINS, "margin", 2),
        "convergence": lambda: _convergence(motions),
    }
    with sheet():
        every = [make() for name, make in makers.items() if wanted is None or name in wanted]
    return [overlay for overlay in every if overlay is not None]


CONTROLS = Markup(
    "The control of every run over time; jumps of piecewise constant controls are drawn as jumps."
)
LEGS = Markup("Lengths and speeds of the legs of every run over time, speeds where they are no controls.")
RELATIVE = Markup("The path relative to the goal: zero at the end is the goal reached.")
ROTATIONS = Markup(
    " Rotations by the rotation vector <i>r</i> of <i>R</i>&#8239;<i>R</i><sub>d</sub><sup>T</sup>, undefined at a "
    "half turn (red)."
)
MARGINS = Markup(
    "Least singular values along the path, rotation columns divided by the length scale: zero is a singularity. "
    "Red lines mark changes of sign of the determinant."
)
DISTANCES = Markup(
    "The least distance of any body from an obstacle, or from a body that it does not touch by construction."
)
CONVERGENCE = Markup(
    "Convergence by iteration; an iteration of one method is not the work of one of the other. Jacobian method: "
    "the error <i>E</i> at the goal, the tolerance (dotted), in grey the decay (1 − γ)<sup><i>k</i></sup> of "
    "theory. NLP: the greatest violation of the constraints (thick) and the optimizer's stationarity residual "
    "(thin)."
)


def _legend(figure: Figure, motions: Sequence[_Motion], place: str = "outside upper left") -> None:
    handles = [Line2D([], [], label=motion.name, **motion.look) for motion in motions]
    figure.legend(handles=handles, loc=place, ncols=min(len(handles), 4))


def _over_time(
    motions: Sequence[_Motion], name: str, title: str, caption: Markup, group: str, columns: int = 3
) -> Overlay | None:
    """Axes for every curve of the panels of a group, with that curve of every run; 0 columns: as many as curves."""
    shown = [(panel, i) for panel in of_group(motions[0].panels, group) for i in range(len(panel.curves))]
    if not shown:
        return None
    columns = min(columns or min(len(shown[0][0].curves), 4), len(shown))
    figure, grid = axes_grid(len(shown), columns, (WIDTH / columns, HEIGHT), 0.3)
    last = max(motion.path.horizon for motion in motions)
    for axes, (panel, i) in zip(grid, shown, strict=True):
        _draw(axes, motions, panel, i)
        plots.time_axis(axes, last, last, motions[0].path.time_unit)
    _legend(figure, motions)
    return Overlay(name, title, caption, figure, "t")


def _draw(axes: Any, motions: Sequence[_Motion], panel: Panel, place: int) -> None:
    """One curve of a panel, of every run that has it."""
    own = panel.curves[place]
    drawn = []
    for motion in motions:
        for other in motion.panels:
            if other.name != panel.name or len(other.curves) <= place:
                continue
            curve = other.curves[place]
            axes.plot(curve.times, curve.values, label=motion.name, **motion.look)
            drawn.append(curve.values)
            marks = [mark for mark in other.marks if mark.curve in ("", curve.name)]
            plots.draw_marks(axes, marks, motion.look["linestyle"], labelled=False)
    if panel.zero:
        plots.zero_line(axes)
    if panel.margin:
        plots.margin_axis(axes, drawn)
    plots.draw_limits(axes, own.limits)
    axes.set_ylabel(axis_label("" if panel.margin else panel.words, own.symbol, own.unit))


def _path(motions: Sequence[_Motion]) -> Overlay | None:
    """The mechanism at the start with every path, and the paths alone."""
    first = motions[0].solution
    paths = [drawing.path_points(motion.solution, motion.path) for motion in motions]
    if not any(len(points) for points in paths):
        return None
    pose, goal = drawing.poses_of(first)[0], drawing.goal_pose(first.problem)
    every = np.concatenate(paths)
    followed = [along for motion in motions if (along := routes.route_places(motion.solution)) is not None]
    system = first.problem.system
    names = drawing.axis_names(system, every.shape[1], first.problem.units)
    figure = Picture(figsize=(WIDTH, 3.6))
    views = [(pose, "start, goal (dashed) and paths")] if pose.drawing["lines"] else []
    count = len(views) + 1
    for i, (shown, words) in enumerate([*views, (None, "the paths alone")]):
        if not shown and every.shape[1] == 3 and np.ptp(every[:, 2]) < FLAT * np.ptp(every[:, :2]):
            paths, every, names = [points[:, :2] for points in paths], every[:, :2], names[:2]  # from above
        boxes = [shown.drawing, *([goal.drawing] if goal else [])] if shown else []
        corners = drawing.extent(*boxes, points=every)
        if shown:
            corners = obstacles.widened(system, *corners)
        place = ((i + 0.03) / count, 0.05, 0.9 / count, 0.8)
        axes = drawing.add_view(figure, place, *corners, names, 1.0 if shown else 0.85, not system.plotted)
        if shown:
            obstacles.plot_obstacles(axes, system, *corners)
            if goal:
                drawing.plot_robot(axes, goal.drawing, ghost=True)
            _mechanism(axes, shown.drawing)
        for points, motion in zip(paths, motions, strict=True):
            drawing.plot_path(axes, points, **motion.look)
        for along in followed:
            axes.plot(*along.T[: len(names)], **routes.ROUTE)
        if not shown and len(names) == 3:
            axes.zaxis.labelpad = 0  # the narrow box leaves its numbers no room
            axes.tick_params(axis="z", pad=3)
        figure.text((i + 0.5) / count, 0.9, words, ha="center", va="center")
    _legend(figure, motions, "upper left")
    scale = "" if system.plotted else ", at the same scale on all axes"
    route = " Pale: the route of poses that a plan follows by manoeuvres." if followed else ""
    caption = Markup("The path of the moving body, from the open to the full dot{}.{}").format(scale, route)
    return Overlay("path", "Path in space", caption, figure)


def _plain_path(motions: Sequence[_Motion]) -> Overlay | None:
    """The first numbers of the state against each other, for systems without a body in space."""
    states = [of_group(motion.panels, "state") for motion in motions]
    if not states[0]:
        return None
    # three numbers at one scale only where they have one unit
    some, most = (states, 3) if len(states[0][0].curves) > 1 else ([[merged(own)] for own in states], 2)
    shown = [own[0].curves[:most] for own in some]
    names = [curve.label for curve in shown[0]]
    if len(names) < 2:
        return None
    curves = [np.column_stack([curve.values for curve in own]) for own in shown]
    figure = Picture(figsize=(WIDTH, 3.4))
    drawing.plot_curves(figure, curves, names, [motion.look for motion in motions])
    _legend(figure, motions, "upper left")
    caption = Markup(
        "The first numbers of the state against each other, from the open to the full dot, at one scale."
    )
    return Overlay("path", "Path", caption, figure)


def _mechanism(axes: Any, shown: Any) -> None:
    """A drawing in grey: colours belong to the runs."""
    for line in shown["lines"].values():
        points = np.asarray(line, dtype=float)
        if np.isfinite(points).all():
            axes.plot(*points.T, color="0.55", linewidth=0.9, zorder=5)


def _trees(motions: Sequence[_Motion]) -> Overlay | None:
    """Of the first run that has them the trees of a search for a route without one."""
    searched = next((motion for motion in motions if routes.has_trees(motion.solution)), None)
    if searched is None:
        return None
    figure = routes.trees(searched.solution, Room(WIDTH))
    caption = Markup(
        "Poses to which the search for a route came from start and goal, of {}: where the moving body is, and how "
        "far each is from the goal."
    ).format(searched.name)
    return Overlay("trees", "Search for a route", caption, figure)


def _distances(motions: Sequence[_Motion]) -> Overlay | None:
    """The nearest of all pairs of bodies, of every run."""
    near = [motion for motion in motions if DISTANCE in motion.solution.trajectory]
    if not near:
        return None
    figure, (axes,) = axes_grid(1, 1, (WIDTH / 2, HEIGHT), 0.3)
    for motion in near:
        values = quantity(motion.solution, DISTANCE, motion.path).reshape(motion.path.samples, -1)
        axes.plot(motion.path.times, values.min(axis=1), label=motion.name, **motion.look)
    plots.zero_line(axes)
    bounds = [bound for bound in near[0].solution.problem.bounds if bound.quantity == DISTANCE]
    plots.draw_limits(axes, {float(np.min(bound.lower)) for bound in bounds}, wherever=True)
    last, first = max(motion.path.horizon for motion in near), near[0]
    plots.time_axis(axes, last, last, first.path.time_unit)
    axes.set_ylabel(axis_label("least distance", "$d$", first.solution.problem.units.words("length")))
    _legend(figure, near)
    return Overlay("distances", "Distances", DISTANCES, figure, "t")


def _convergence(motions: Sequence[_Motion]) -> Overlay | None:
    """A panel a method: E for the Jacobian method, the violation of the constraints for the NLP."""
    recorded = [motion for motion in motions if np.isfinite(error_history(motion.solution)[1]).any()]
    methods = list(dict.fromkeys(motion.solution.solver for motion in recorded))
    if not recorded:
        return None
    columns = min(2, len(methods))
    figure, grid = axes_grid(len(methods), columns, (WIDTH / columns, 2.1), 0.3)
    for axes, method in zip(grid, methods, strict=True):
        mine = [motion for motion in recorded if motion.solution.solver == method]
        for motion in mine:
            ks, errors = error_history(motion.solution)
            mark = {"marker": "o", "markersize": 1.8} if len(ks) < 40 else {}
            axes.plot(ks, errors, label=motion.name, **motion.look, **mark)
            if method == "nlp":
                duals = positive(column(motion.solution.iterations, "dual_infeasibility"))
                thin = {**motion.look, "linewidth": 0.7, "alpha": 0.55}
                axes.plot(ks, duals, label=f"{motion.name}, stationarity", **thin)
        _references(axes, mine)
        plots.error_axis(axes, "iteration $k$")
        if method == "nlp":
            axes.set_ylabel("violation (thin: stationarity)")
    _legend(figure, recorded)
    return Overlay("convergence", "Convergence", CONVERGENCE, figure, "k")


def _references(axes: Any, mine: Sequence[_Motion]) -> None:
    """Tolerances, and the decay that theory promises for the steps that were taken."""
    for tolerance in {motion.solution.tolerance for motion in mine}:
        axes.axhline(tolerance, **plots.REFERENCE)
    for motion in mine:
        predicted = decays(motion.solution)
        if predicted is not None and np.isfinite(predicted[1]).all():
            axes.plot(error_history(motion.solution)[0], predicted[1], color="0.6", linewidth=0.7, zorder=1)
