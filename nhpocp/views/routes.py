"""Routes of poses that a plan follows, and trees of a search that found none, as solutions keep them in `details`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem
from nhpocp.relative import relative_to
from nhpocp.solution import Solution
from nhpocp.state_space import Block
from nhpocp.views import drawing, obstacles
from nhpocp.views.labels import axis_label
from nhpocp.views.style import COLOURS, OWN_SIZE, Room, axes_grid, legend_above, say

# faint, and over the path, whose loops would hide it
ROUTE = {"color": COLOURS[3], "linewidth": 1.6, "alpha": 0.85, "linestyle": "-", "zorder": 202}
PARTS = 12  # of each straight part of a route, which turns on its way
SIDE = (0, 2)  # of x, y, z: where trees in space are looked at from the front
LOOKS = {"start": (COLOURS[0], "o"), "goal": (COLOURS[1], "s")}


def route_states(solution: Solution) -> Array | None:
    """Packed poses along the route that a plan follows, (k, size); None where it follows none."""
    waypoints = _poses(solution.problem, solution.details.get("route"))
    if waypoints is None or len(waypoints) < 2:
        return None
    space, shares = solution.problem.system.state_space, np.arange(PARTS) / PARTS
    states = [
        space.retract(here, share * np.asarray(space.difference(there, here)))
        for here, there in pairwise(waypoints)
        for share in shares
    ]
    return np.array([*states, waypoints[-1]], dtype=float)


def route_places(solution: Solution) -> Array | None:
    """Where the moving body is along the route, (k, 3 or 2), None where there is nothing to draw."""
    states = route_states(solution)
    places = drawing.places_of(solution.problem.system, states) if states is not None else np.empty((0, 3))
    return places if len(places) else None


def _poses(problem: PlanningProblem, stored: Any) -> Array | None:
    """Packed poses as a solution keeps them; None for what are none of this system's."""
    try:
        poses = np.array(stored, dtype=float)
    except (TypeError, ValueError):
        return None
    fits = poses.ndim == 2 and poses.shape[1] == problem.system.state_space.size and len(poses) > 0
    return poses if fits and np.isfinite(poses).all() else None


def _trees(solution: Solution) -> Iterator[tuple[str, Array, Array, int]]:
    """Of each tree its name, poses (k, size), parents (k,) and how many poses it has grown."""
    stored = solution.details.get("trees")
    for name in LOOKS:
        tree = stored.get(name) if isinstance(stored, Mapping) else None
        if not isinstance(tree, Mapping):
            continue
        poses, parents = _poses(solution.problem, tree.get("poses")), tree.get("parents")
        if poses is None or not isinstance(parents, list) or len(parents) != len(poses):
            continue
        if all(isinstance(place, int | float) and 0 <= place < len(poses) for place in parents):
            yield name, poses, np.array(parents, dtype=int), int(tree.get("grown") or len(poses))


def has_trees(solution: Solution) -> bool:
    """Whether a search for a route that found none is among what is kept of a solution."""
    return next(_trees(solution), None) is not None


def trees(solution: Solution, room: Room = OWN_SIZE) -> Figure:
    """Both trees where the moving body is, and by how far each pose is from the goal."""
    problem, every = solution.problem, list(_trees(solution))
    views = [_plot_places] if len(drawing.places_of(problem.system, every[0][1])) else []
    plots = [*views, *([_plot_differences] if len(_measures(problem)) == 2 else [])]
    figure, grid = axes_grid(len(plots) or 1, room=room)
    for axes, plot in zip(grid, plots or [_plot_numbers], strict=True):
        plot(axes, problem, every)
        for name in LOOKS:
            colour, marker = LOOKS[name]
            axes.plot([], [], label=name, color=colour, marker=marker, markersize=5, markeredgecolor="black")
        legend_above(axes, 4)
    counts = " and ".join(f"{grown} from the {name}" for name, _, _, grown in every)
    say(figure, [f"The poses of both trees of the search for a route, {counts}: they did not meet."])
    return figure


def _plot_places(axes: Any, problem: PlanningProblem, every: list[Any]) -> None:
    """In the plane from above among the obstacles, in space from the front."""
    system = problem.system
    flat = [drawing.places_of(system, poses) for _, poses, _, _ in every]
    names = drawing.axis_names(system, flat[0].shape[1], problem.units)
    if flat[0].shape[1] == 2:
        low, high = obstacles.widened(system, *drawing.extent(points=np.concatenate(flat)))
        obstacles.plot_obstacles(axes, system, low, high)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        sides: tuple[int, ...] = (0, 1)
    else:
        sides = SIDE
    for (name, _, parents, _), places in zip(every, flat, strict=True):
        _plot_tree(axes, name, places[:, sides], parents)
    axes.set(xlabel=names[sides[0]], ylabel=names[sides[1]])
    if not system.plotted:
        axes.set_aspect("equal", adjustable="datalim")


def _measures(problem: PlanningProblem) -> dict[str, list[Block]]:
    """Blocks of the state by unit, lengths and angles, that the goal fixes."""
    units: dict[str, list[Block]] = {}
    for block in problem.system.state_space.blocks:
        if block.name in problem.goal:
            units.setdefault(block.unit, []).append(block)
    return {unit: units[unit] for unit in ("length", "angle") if unit in units}


def _from_goal(problem: PlanningProblem, poses: Array) -> Array:
    """Tangents (k, dimension) from the goal to poses; NaN in the rotations of those half a turn away."""
    space, goal = problem.system.state_space, problem.goal_point
    ends, parts = space.split(goal[None]), space.split(poses)
    return np.hstack([relative_to(ends[block.name][0], parts[block.name], block) for block in space.blocks])


def _plot_differences(axes: Any, problem: PlanningProblem, every: list[Any]) -> None:
    """Distance and turn of every pose from the goal."""
    space = problem.system.state_space
    for name, poses, parents, _ in every:
        apart = _from_goal(problem, poses)
        columns = []
        for blocks in _measures(problem).values():
            parts = [apart[:, space.tangent_slice(block.name)] for block in blocks]
            columns.append(np.linalg.norm(np.hstack(parts), axis=1))
        _plot_tree(axes, name, np.column_stack([columns[0], np.degrees(columns[1])]), parents)
    axes.set_xlabel(axis_label("distance from the goal", "", problem.units.words("length")))
    axes.set_ylabel("turn from the goal [deg]")


def _plot_numbers(axes: Any, problem: PlanningProblem, every: list[Any]) -> None:
    """The first two numbers by which poses differ from the goal; of a single one, in the order of growth."""
    space = problem.system.state_space
    names = [f"{label} from the goal" for label in space.tangent_labels[:2]]
    for name, poses, parents, _ in every:
        apart = _from_goal(problem, poses)
        alone = len(names) == 1
        shown = np.column_stack([np.arange(len(poses)), apart[:, 0]]) if alone else apart[:, :2]
        _plot_tree(axes, name, shown, parents)
    words = ["pose", *names] if len(names) == 1 else names
    axes.set(xlabel=words[0], ylabel=words[1])


def _plot_tree(axes: Any, name: str, places: Array, parents: Array) -> None:
    """Poses as dots, edges faint, the root marked."""
    colour, marker = LOOKS[name]
    edges = np.stack([places[parents], places], axis=1)
    axes.add_collection(LineCollection(list(edges), colors=colour, linewidths=0.5, alpha=0.35, zorder=2))
    axes.plot(*places.T, linestyle="none", marker=".", markersize=3.0, color=colour, alpha=0.8, zorder=3)
    axes.plot(*places[:1].T, marker=marker, markersize=6.5, color=colour, markeredgecolor="black", zorder=5)
