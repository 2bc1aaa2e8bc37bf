"""Several solutions of one problem in the same pictures: a panel a quantity, a colour and a dash a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from nhpocp.arrays import Array
from nhpocp.comparison import Entry
from nhpocp.solution import Solution
from nhpocp.views import drawing, plots
from nhpocp.views.finite_path import path_of, quantity
from nhpocp.views.style import ALARM, GREY, line_style, sheet, symbol, with_unit

WIDTH, PANEL_HEIGHT = 7.2, 1.75  # inches: a page's text
FLAT = 1e-9  # height over width, from which a path in space is shown from above
Curve = Callable[[Solution], tuple[Array, Array]]  # times and one value each


@dataclass(frozen=True)
class Overlay:
    """A picture with its words; the caption is markup. ``abscissa``: t or k where curves run over one."""

    name: str
    title: str
    caption: Markup
    figure: Figure
    abscissa: str = ""


@dataclass(frozen=True)
class Panel:
    """One quantity over time: its axis label and where a solution has it; ``bound``: what limits it.

    ``unit``: of what has no room for it on the axis.
    """

    words: str
    curve: Curve
    bound: str = ""
    zero: bool = False
    logarithmic: bool = False
    unit: str = ""


def overlays(entries: Sequence[Entry], names: Sequence[str]) -> list[Overlay]:
    """Every picture that these runs have in common, in the order of a report; none where nothing was tried."""
    drawn = [(entry.solution, name, i) for i, (entry, name) in enumerate(zip(entries, names, strict=True))]
    drawn = [item for item in drawn if entries[item[2]].tried and path_of(item[0]).samples]
    if not drawn:
        return []
    with sheet():
        found = [
            _controls(drawn),
            _legs(drawn),
            _relative(drawn),
            _path(drawn),
            _margins(drawn),
            _convergence(drawn),
        ]
    return [overlay for overlay in found if overlay is not None]


Drawn = Sequence[tuple[Solution, str, int]]  # a solution, its name, its number among the runs


def _style(number: int) -> dict[str, Any]:
    return {**line_style(number), "linewidth": 1.2}


def _legend(figure: Figure, drawn: Drawn) -> None:
    handles = [Line2D([], [], label=name, **_style(number)) for _, name, number in drawn]
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 4))


def _grid(count: int, columns: int = 3, height: float = PANEL_HEIGHT) -> tuple[Figure, list[Any]]:
    columns = min(columns, count)
    rows = -(-count // columns)
    figure = Figure(
        figsize=(WIDTH, rows * height + 0.3), layout=ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05)
    )
    return figure, [figure.add_subplot(rows, columns, i + 1) for i in range(count)]


def _over_time(drawn: Drawn, panels: Sequence[Panel], columns: int = 3) -> Figure:
    """Every panel with every run in it."""
    figure, axes = _grid(len(panels), columns)
    last = max(path_of(solution).horizon for solution, _, _ in drawn)
    for axis, panel in zip(axes, panels, strict=True):
        for solution, name, number in drawn:
            times, values = panel.curve(solution)
            if len(values):
                axis.plot(times, values, label=name, **_style(number))
        if panel.zero:
            axis.axhline(0, color=GREY, linewidth=0.6, zorder=1)
        _limits(axis, panel)
        if panel.bound:
            plots.draw_bounds(axis, drawn[0][0], panel.bound)
        axis.set(xlim=(0, last), xlabel="time $t$ [–]", ylabel=panel.words)
        axis.set_label(panel.words + panel.unit)  # not drawn: for `readout`
    _legend(figure, drawn)
    return figure


def _limits(axis: Any, panel: Panel) -> None:
    """Margins begin at zero, or are on a log axis where they differ by more than a factor of 30."""
    if not panel.logarithmic:
        return
    seen = np.concatenate(
        [np.asarray(line.get_ydata(), dtype=float) for line in axis.get_lines()] or [np.ones(1)]
    )
    seen = seen[np.isfinite(seen) & (seen > 0)]
    if seen.size and seen.max() > 30 * seen.min():
        axis.set_yscale("log")
    else:
        axis.set_ylim(0, 1.08 * seen.max(initial=1e-9))


def _component(name: str, index: int) -> Curve:
    def curve(solution: Solution) -> tuple[Array, Array]:
        path = path_of(solution)
        values = quantity(solution, name, path)
        return path.times, values[:, index] if values.shape[1] > index else np.empty(0)

    return curve


def _input(index: int) -> Curve:
    def curve(solution: Solution) -> tuple[Array, Array]:
        path, blocks = path_of(solution), solution.problem.system.input_space.blocks
        columns = np.hstack([quantity(solution, block.name, path) for block in blocks])
        if columns.shape[1] <= index:
            return path.times, np.empty(0)
        times, values = plots.with_jumps(solution, path.times, columns)
        return times, values[:, index]

    return curve


def _controls(drawn: Drawn) -> Overlay | None:
    """Every input over time; nothing where the system has none."""
    panels: list[Panel] = []
    for block in drawn[0][0].problem.system.input_space.blocks:
        for i in range(block.size):
            words = f"control {symbol(block.name, i if block.kind == 'vector' else None)}"
            panels.append(Panel(with_unit(words, block.unit, rate=True), _input(len(panels)), block.name))
    if not panels:
        return None
    words = Markup(
        "The control of every run over time; jumps of piecewise constant controls are drawn as jumps."
    )
    return Overlay("controls", "Controls", words, _over_time(drawn, panels), "t")


def _legs(drawn: Drawn) -> Overlay | None:
    """Leg lengths over leg speeds, for systems with legs."""
    trajectory = drawn[0][0].trajectory
    if "leg_lengths" not in trajectory:
        return None
    panels = []
    for name, words, rate in (("leg_lengths", "leg length", False), ("u", "leg speed", True)):
        if name in trajectory:
            count = np.asarray(trajectory[name]).reshape(len(trajectory["t"]), -1).shape[1]
            unit = with_unit("", "length", rate)
            panels += [
                Panel(f"{words} {symbol(name, i)}", _component(name, i), name, unit=unit)
                for i in range(count)
            ]
    columns = np.asarray(trajectory["leg_lengths"]).shape[-1]
    caption = Markup("Leg lengths [length] and leg speeds [length per unit time] of every run over time.")
    return Overlay("legs", "Legs", caption, _over_time(drawn, panels, min(columns, 4)), "t")


def _relative(drawn: Drawn) -> Overlay:
    panels = []
    for block in [block for blocks in plots.goal_groups(drawn[0][0]) for block in blocks]:
        rotation, count = block.kind == "rotation", 3 if block.kind == "rotation" else block.components
        for i in range(count):
            name = (
                f"$r_{i + 1}$ [rad]"
                if rotation
                else symbol(block.name, None if block.kind == "scalar" else i)
            )
            words = name if rotation else with_unit(f"{name} – goal", block.unit)
            panels.append(Panel(words, _relative_curve(block, i), zero=True))
    caption = Markup("The path relative to the goal: zero at the end is the goal reached.")
    if any(block.kind == "rotation" for block in drawn[0][0].problem.system.state_space.blocks):
        caption += Markup(
            " Rotations by the rotation vector <i>r</i> of <i>R</i>&#8239;<i>R</i><sub>d</sub><sup>T</sup>, "
            "undefined at a half turn."
        )
    return Overlay("relative_pose", "Relative pose", caption, _over_time(drawn, panels), "t")


def _relative_curve(block: Any, index: int) -> Curve:
    def curve(solution: Solution) -> tuple[Array, Array]:
        values = plots.relative_values(solution, block)
        return path_of(solution).times, values[:, index] if values.size else np.empty(0)

    return curve


def _margins(drawn: Drawn) -> Overlay | None:
    names = [name for name in drawn[0][0].trajectory if name.startswith("sigma_")]
    if not names:
        return None
    panels = [
        Panel(
            rf"$\sigma_{{\min}}({name.removeprefix('sigma_').upper()})$ [–]",
            _component(name, 0),
            name,
            logarithmic=True,
        )
        for name in names
    ]
    figure = _over_time(drawn, panels, 2)
    for axis, name in zip(figure.axes, names, strict=True):
        for solution, _, number in drawn:
            for time in plots.crossing_times(solution).get(name.replace("sigma_", "det_"), []):
                style = {"color": ALARM, "linewidth": 0.9, "linestyle": line_style(number)["linestyle"]}
                axis.axvline(time, zorder=1.5, **style)
    caption = Markup(
        "Least singular values along the path, rotation columns divided by the length scale: zero is a singularity. "
        "Red lines mark changes of sign of the determinant."
    )
    return Overlay("margins", "Singularity margins", caption, figure, "t")


def _path(drawn: Drawn) -> Overlay | None:
    """The mechanism at the start with every path, and the paths alone."""
    first = drawn[0][0]
    paths = [drawing.path_points(solution, path_of(solution)) for solution, _, _ in drawn]
    if not any(len(points) for points in paths):
        return _plain_path(drawn)
    pose, goal = drawing.poses_of(first)[0], drawing.goal_pose(first)
    every = np.concatenate(paths)
    names = drawing.axis_names(first.problem.system, every.shape[1])
    figure = Figure(figsize=(WIDTH, 3.6))
    views = [(pose, "start, goal (dashed) and paths")] if pose.drawing["lines"] else []
    count = len(views) + 1
    for i, (shown, words) in enumerate([*views, (None, "the paths alone")]):
        if not shown and every.shape[1] == 3 and np.ptp(every[:, 2]) < FLAT * np.ptp(every[:, :2]):
            paths, every, names = [points[:, :2] for points in paths], every[:, :2], names[:2]  # from above
        boxes = [shown.drawing, *([goal.drawing] if goal else [])] if shown else []
        corners = drawing.extent(*boxes, points=every)
        place = ((i + 0.03) / count, 0.05, 0.9 / count, 0.8)
        axes = drawing.add_view(figure, place, *corners, names, zoom=1.0 if shown else 0.85)
        if shown:
            if goal:
                drawing.plot_robot(axes, goal.drawing, ghost=True)
            _mechanism(axes, shown.drawing)
        for points, (_, _, number) in zip(paths, drawn, strict=True):
            drawing.plot_path(axes, points, **_style(number))
        if not shown and len(names) == 3:
            axes.zaxis.labelpad = 0  # the narrow box leaves its numbers no room
            axes.tick_params(axis="z", pad=3)
        figure.text((i + 0.5) / count, 0.9, words, ha="center", va="center")
    handles = [Line2D([], [], label=name, **_style(number)) for _, name, number in drawn]
    figure.legend(handles=handles, loc="upper left", ncols=min(len(handles), 4))
    caption = Markup(
        "The path of the moving body, from the open to the full dot, at the same scale on all axes."
    )
    return Overlay("path", "Path in space", caption, figure)


def _plain_path(drawn: Drawn) -> Overlay | None:
    """The first numbers of the state against each other, for systems without a body in space."""
    blocks = [block for block in drawn[0][0].problem.system.state_space.blocks if block.kind != "rotation"]
    names = [name for block in blocks for name in plots.labels_with_unit(block)][:3]
    if len(names) < 2 or {block.unit for block in blocks[:3]} != {blocks[0].unit}:
        names = names[:2]  # at one scale only what has one unit
    if len(names) < 2:
        return None
    curves = [
        np.hstack([quantity(solution, block.name, path_of(solution)) for block in blocks])[:, : len(names)]
        for solution, _, _ in drawn
    ]
    figure = Figure(figsize=(WIDTH, 3.4))
    axes: Any = figure.add_axes((0.1, 0.13, 0.86, 0.74), projection="3d" if len(names) == 3 else None)
    if len(names) == 3:
        drawing.set_view(axes, *drawing.extent(points=np.concatenate(curves)), names, zoom=0.85)
    else:
        axes.set(xlabel=names[0], ylabel=names[1])
        axes.set_aspect("equal", adjustable="datalim")
    for curve, (_, _, number) in zip(curves, drawn, strict=True):
        drawing.plot_path(axes, curve, **_style(number))
    handles = [Line2D([], [], label=name, **_style(number)) for _, name, number in drawn]
    figure.legend(handles=handles, loc="upper left", ncols=min(len(handles), 4))
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


def _convergence(drawn: Drawn) -> Overlay | None:
    """A panel a method: E for the Jacobian method, the violation of the constraints for the NLP."""
    recorded = [item for item in drawn if np.isfinite(plots.error_history(item[0])[1]).any()]
    methods = list(dict.fromkeys(solution.solver for solution, _, _ in recorded))
    if not recorded:
        return None
    figure, axes = _grid(len(methods), 2, 2.1)
    for axis, method in zip(axes, methods, strict=True):
        mine = [item for item in recorded if item[0].solver == method]
        for solution, name, number in mine:
            ks, errors = plots.error_history(solution)
            mark = {"marker": "o", "markersize": 1.8} if len(ks) < 40 else {}
            axis.plot(ks, errors, label=name, **{**_style(number), **mark})
            if method == "nlp":
                duals = [record.get("dual_infeasibility") or np.nan for record in solution.iterations]
                thin = {**_style(number), "linewidth": 0.7, "alpha": 0.55}
                axis.plot(ks, duals, label=f"{name}, stationarity", **thin)
        _references(axis, mine)
        axis.set_yscale("log")
        axis.set_xlabel("iteration $k$")
        axis.xaxis.get_major_locator().set_params(integer=True)
        words = "violation (thin: stationarity)" if method == "nlp" else r"error $\mathcal{E}$ [–]"
        axis.set_ylabel(words)
    _legend(figure, recorded)
    caption = Markup(
        "Convergence by iteration; an iteration of one method is not the work of one of the other. Jacobian method: "
        "the error <i>E</i> at the goal, the tolerance (dotted), in grey the decay (1 − γ)<sup><i>k</i></sup> of "
        "theory. NLP: the greatest violation of the constraints (thick) and the optimizer's stationarity residual "
        "(thin)."
    )
    return Overlay("convergence", "Convergence", caption, figure, "k")


def _references(axis: Any, mine: Drawn) -> None:
    """Tolerances, and the decay promised by a fixed γ."""
    for tolerance in {solution.tolerance for solution, _, _ in mine}:
        axis.axhline(tolerance, color=GREY, linewidth=0.8, linestyle=":", zorder=1)
    for solution, _, _ in mine:
        sums, (ks, errors) = plots.step_sums(solution), plots.error_history(solution)
        if sums is not None and np.isfinite(errors[0]) and np.isfinite(sums[1]).all():
            promised = errors[0] * np.exp(sums[1] - sums[1][0])
            axis.plot(ks, promised, color="0.6", linewidth=0.7, zorder=1)
