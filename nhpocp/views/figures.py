"""Pictures of a Solution in a journal's quality: one function a picture, and `write_pictures` for files.

A failed or partial solution still gives every picture; what is missing is said in it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from nhpocp.solution import Outcome, Solution
from nhpocp.views import drawing, plots
from nhpocp.views import failure as failures
from nhpocp.views.style import COLOURS, COMPACT, GREY, PANEL, legend_above, say, sheet
from nhpocp.whole import write_files


def _styled(make: Callable[[Solution], Figure]) -> Callable[[Solution], Figure]:
    @wraps(make)
    def styled(solution: Solution) -> Figure:
        with sheet():
            return make(solution)

    return styled


def _panels(count: int, columns: int = 2) -> tuple[Figure, list[Any]]:
    """A figure of equal panels, a journal's column wide each; as many axes as asked for."""
    columns = min(columns, count)
    rows = -(-count // columns)
    figure = Figure(
        figsize=(columns * PANEL[0], rows * PANEL[1]), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    )
    axes = [figure.add_subplot(rows, columns, i + 1) for i in range(count)]
    return figure, axes


def _only_words(words: str) -> Figure:
    figure = Figure(figsize=PANEL)
    figure.text(0.5, 0.5, textwrap.fill(words, 44), ha="center", va="center", fontsize=9, color=GREY)
    return figure


@_styled
def controls(solution: Solution) -> Figure:
    """Controls and leg lengths, or the state's own numbers where there are no legs. [Paper] Fig. 2."""
    legs = "leg_lengths" in solution.trajectory
    blocks = [block for block in solution.problem.system.state_space.blocks if block.kind != "rotation"]
    figure, axes = _panels(2 if legs or blocks else 1)
    plots.plot_controls(axes[0], solution)
    if legs:
        plots.plot_quantity(axes[1], solution, "leg_lengths", "leg length", "length")
    elif blocks:
        plots.plot_blocks(axes[1], solution, blocks)
    for panel in axes:
        legend_above(panel)
    say(figure, [plots.path_of(solution).words])
    return figure


@_styled
def relative_pose(solution: Solution) -> Figure:
    """The path relative to the goal, one panel a kind of error. [Paper] Fig. 3."""
    groups = plots.goal_groups(solution)
    figure, axes = _panels(len(groups))
    for panel, blocks in zip(axes, groups, strict=True):
        plots.plot_relative(panel, solution, blocks)
        legend_above(panel)
    say(figure, [plots.path_of(solution).words])
    return figure


@_styled
def convergence(solution: Solution) -> Figure:
    """The error over the iterations, with the decay that theory promises. [Paper] eqs. (9), (17)."""
    if not np.isfinite(plots.error_history(solution)[1]).any():
        return _only_words("The solver recorded no error: there is no convergence to draw.")
    figure, (axes,) = _panels(1)
    plots.plot_convergence(axes, solution)
    legend_above(axes, 2, **COMPACT)
    return figure


@_styled
def margins(solution: Solution) -> Figure:
    """Distance from the singularities along the path, and those that it crosses."""
    if not any(name.startswith("sigma_") for name in solution.trajectory):
        return _only_words("This system names no matrix whose singularity would have to be watched.")
    figure, (axes,) = _panels(1)
    plots.plot_margins(axes, solution)
    legend_above(axes)
    say(figure, [*plots.crossing_words(solution), plots.path_of(solution).words])
    return figure


@_styled
def robot(solution: Solution) -> Figure:
    """The mechanism at the start, in the middle and at the end, or the bare path where a system draws nothing."""
    poses = drawing.poses_of(solution)
    if not poses[0].drawing["lines"]:
        return _bare_path(solution)
    path = plots.path_of(solution)
    points, goal = drawing.path_points(solution, path), drawing.goal_pose(solution)
    shown = [pose.drawing for pose in poses] + ([goal.drawing] if goal else [])
    low, high = drawing.extent(*shown, points=points)
    names, count = drawing.axis_names(solution.problem.system, len(low)), len(poses)
    figure = Figure(figsize=(max(count, 1.5) * 2.35, 2.75))
    for i, pose in enumerate(poses):
        box = (i / count, 0.12, 0.96 / count, 0.82)  # room for the name of the z axis
        axes = drawing.add_view(figure, box, low, high, names, zoom=0.84)
        if goal:
            drawing.plot_robot(axes, goal.drawing, ghost=True)
        drawing.plot_robot(axes, pose.drawing)
        drawing.plot_path(axes, points)
        figure.text((i + 0.5) / count, 0.955, pose.words, ha="center", va="center")
    entries = drawing.legend_entries(poses[0].drawing)
    entries += [("path", {"color": COLOURS[6], "linewidth": 1.1})] if len(points) else []
    entries += [("goal", {"color": "0.45", "linewidth": 0.7, "linestyle": (0, (4, 2))})] if goal else []
    handles = [Line2D([], [], label=words, **style) for words, style in entries]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), bbox_to_anchor=(0.5, 0.015))
    say(figure, [path.words])
    return figure


def _bare_path(solution: Solution) -> Figure:
    """The first numbers of the state against each other, or the tips of the body's axes of a rotation."""
    path, blocks = plots.path_of(solution), solution.problem.system.state_space.blocks
    plain = [block for block in blocks if block.kind != "rotation"]
    values = np.hstack([plots.quantity(solution, block.name, path) for block in plain or blocks[:1]])
    if not values.size:
        return _only_words(path.words or "There is no path to draw.")
    figure = Figure(figsize=(PANEL[0], PANEL[0]))
    if plain:
        names = [name for block in plain for name in plots.labels_with_unit(block)]
        drawing.plot_curves(figure, [values[:, :3]], names[:3], [None])
    else:
        tips = [values.reshape(-1, 3, 3)[:, :, i] for i in range(3)]
        drawing.plot_curves(
            figure, tips, ["$x$", "$y$", "$z$"], ["tip of the body's $x$", "of $y$", "of $z$"]
        )
    say(figure, [path.words])
    return figure


@_styled
def failure(solution: Solution) -> Figure:
    """Why a solve failed: error and margins by evaluation, and where the last path is in trouble."""
    return failures.failure(solution)


FIGURES: dict[str, Callable[[Solution], Figure]] = {
    "controls": controls,
    "relative_pose": relative_pose,
    "convergence": convergence,
    "margins": margins,
    "robot": robot,
    "failure": failure,
}


def names_of(solution: Solution) -> list[str]:
    """The pictures that say something of a solution: what converged has no failure, what nothing watches no margins."""
    silent = {"failure"} if solution.outcome is Outcome.CONVERGED else set()
    if not any(name.startswith("sigma_") for name in solution.trajectory):
        silent.add("margins")
    return [name for name in FIGURES if name not in silent]


def save(figure: Figure, file: Path) -> Path:
    """A figure as a file whose bytes depend on the figure alone: no date, no random names."""
    dateless = {".svg": {"Date": None}, ".pdf": {"CreationDate": None, "ModDate": None}}
    with sheet():
        figure.savefig(file, metadata=dateless.get(file.suffix.lower(), {}))
    return file


def write_pictures(
    solution: Solution,
    folder: Path,
    formats: Sequence[str] = ("svg", "png"),
    names: Iterable[str] | None = None,
) -> list[Path]:
    """Every picture (`names_of`), or those named, in every format; the files written, in that order.

    Each is written whole, and none unless all can be: a full disk leaves the older ones.
    """
    return write_all(FIGURES, solution, folder, formats, names_of(solution) if names is None else names)


def write_all(
    figures: Mapping[str, Callable[[Any], Figure]],
    subject: Any,
    folder: Path,
    formats: Sequence[str],
    names: Iterable[str],
) -> list[Path]:
    """Those of these figures of a subject that are named, as files."""
    files = {name: [f"{name}.{kind}" for kind in formats] for name in names}

    def draw(scratch: Path) -> None:
        for name, made in files.items():
            figure = figures[name](subject)
            for file in made:
                save(figure, scratch / file)

    write_files(Path(folder), draw)
    return [Path(folder) / file for made in files.values() for file in made]
