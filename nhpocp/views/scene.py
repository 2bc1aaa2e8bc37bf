"""A motion as the parts that an animation moves: the arrays of `System.drawing` along the stored trajectory.

Positions are those of the trajectory, in full precision for ends and corners; nothing here knows a system.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solution import Solution
from nhpocp.systems.system import System
from nhpocp.views import drawing, obstacles, routes
from nhpocp.views.drawing import (
    DARK,
    FILLS,
    bodies_of,
    fills_of,
    is_closed,
    kinds_of,
    open_line_style,
    split_name,
)
from nhpocp.views.finite_path import path_of, thinned
from nhpocp.views.labels import plain_words, symbol
from nhpocp.views.panels import crossing_times

PLAIN = "#e8ebef"  # of balls
PLANNED = "#d1495b"  # of what a machine was to do
TUBE = 0.62  # of the least length of a bar that extends
FEW = 8  # points of a line that are kept in full precision: ends of legs, corners of bodies
DIGITS = 6  # of curves in space, relative to the size of the scene
Part = dict[str, Any]


def drawn(system: System, state: Array) -> Mapping[str, Any]:
    """A system's drawing; for one that draws nothing its first numbers as a point, or its body's axes."""
    own = system.drawing(state)
    if own["lines"] or own["points"] or own.get("solids"):
        return own
    values = system.state_space.unpack(state)
    plain = [np.ravel(values[block.name]) for block in system.state_space.blocks if block.kind != "rotation"]
    if plain:
        numbers = np.concatenate(plain)[:3]
        point = np.pad(numbers, (0, max(0, 2 - len(numbers))))
        return {"lines": {}, "points": {"state": point[None]}, "trace": point}
    turned = values[system.state_space.blocks[0].name]
    axes = {f"axis {i + 1}": np.array([np.zeros(3), turned[:, i]]) for i in range(3)}
    return {"lines": axes, "points": {}, "trace": turned[:, 2]}


def ends_of(solution: Solution) -> dict[str, Mapping[str, Any]]:
    """The drawings of the start and, where it fixes the whole state, of the goal."""
    problem, goal = solution.problem, drawing.goal_pose(solution.problem)
    ends = {"start": drawn(problem.system, problem.start_point)}
    return ends | ({"goal": drawn(problem.system, problem.goal_point)} if goal else {})


def scene(solution: Solution, most: int) -> dict[str, Any]:
    """Plain data of one run's scene: times, parts, trace, ghosts, crossings, and the corners of a box around all.

    ``most``: samples that are shown at most.
    """
    system, chosen = solution.problem.system, thinned(path_of(solution).samples, most)
    times, states = path_of(solution).times[chosen], drawing.states_of(solution, path_of(solution))[chosen]
    points = drawing.path_points(solution, path_of(solution))
    frames = [drawn(system, state) for state in states]
    return composed(solution, times, frames, trace=points[chosen] if len(points) else None)


def composed(
    solution: Solution,
    times: Array,
    frames: list[Mapping[str, Any]],
    planned: list[Mapping[str, Any]] | None = None,
    trace: Array | None = None,
) -> dict[str, Any]:
    """`scene` of drawings at times, with those of a plan as faint lines beside them; start and goal are the plan's.

    trace: where the moving body goes, for drawings that do not say.
    """
    system, parts = solution.problem.system, _parts(frames)
    if "trace" in frames[0]:
        trace = np.array([frame["trace"] for frame in frames], dtype=float)
    moving = {name for name in frames[0]["lines"] if len(_along(frames, _line(name))) > 1}
    ends = ends_of(solution)
    ghosts = [{"words": words, "outlines": _outlines(end, moving)} for words, end in ends.items()]
    if trace is not None:
        trace = _held(trace)
    parts += _faint(planned) if planned else []
    around = _box([*frames, *(planned or []), *ends.values()], trace)
    low, high = obstacles.widened(system, *around)
    parts = [*obstacles.parts(system, low, high), *parts, *_route(solution)]
    grain = DIGITS - int(np.floor(np.log10(max(float((high - low).max()), 1e-9))))
    for part in parts:
        values, exact = part.pop("values"), part.pop("exact", False)
        part["values"] = _plain(values if exact else values.round(max(grain, 0)))
    return {
        "times": times.tolist(),
        "parts": parts,
        "trace": None if trace is None else trace.round(max(grain, 0)).tolist(),
        "ghosts": ghosts,
        "crossings": _crossings(solution, times, trace),
        "stretched": bool(system.plotted),
        "low": low.tolist(),
        "high": high.tolist(),
        "axes": [plain_words(name) for name in drawing.axis_names(system, len(low), solution.problem.units)],
    }


def _crossings(solution: Solution, times: Array, trace: Array | None) -> list[dict[str, Any]]:
    """Changes of sign of determinants in the order of time, each with the place on the trace where it happens."""
    every = sorted((t, which) for which, zeros in crossing_times(solution).items() for t in zeros)
    columns = None if trace is None else trace.T
    return [
        {
            "words": plain_words(f"{symbol(which)} = 0"),
            "t": t,
            "point": None if columns is None else [float(np.interp(t, times, column)) for column in columns],
        }
        for t, which in every
    ]


def _plain(values: Array) -> list[Any]:
    """Nested lists; a sample that is not finite throughout is None, and is not drawn."""
    finite = np.isfinite(values).reshape(len(values), -1).all(axis=1)
    return [value if good else None for value, good in zip(values.tolist(), finite, strict=True)]


def _held(points: Array) -> Array:
    """Points, where one is not finite the last one that was."""
    finite = np.isfinite(points).all(axis=1)
    if not finite.any():
        return np.zeros_like(points)
    last = np.maximum.accumulate(np.where(finite, np.arange(len(points)), int(np.argmax(finite))))
    return points[last]


def _parts(frames: list[Mapping[str, Any]]) -> list[Part]:
    """Every solid, every line and group of points that none replaces; what stands still has one sample."""
    first = frames[0]
    lines = {name: np.asarray(line, dtype=float) for name, line in first["lines"].items()}
    solids, replaced = first.get("solids", {}), replaced_by_solids(first)
    colours, parts = _colours(lines), []
    for name, solid in solids.items():
        made = _rod(frames, name) if "ends" in solid else _ball(frames, name)
        parts.append(
            {"name": name, "colour": colours.get(name, DARK), "radius": float(solid["radius"]), **made}
        )
    for name, line in lines.items():
        if name in replaced or split_name(name)[0] in replaced:
            continue
        values = _along(frames, _line(name))
        kind = "surface" if is_closed(line) else "line"
        part = {
            "name": name,
            "kind": kind,
            "colour": colours[name],
            "values": values,
            "exact": len(line) <= FEW,
        }
        if kind == "line":
            style = open_line_style(list(kinds_of(lines)).index(split_name(name)[0]), None)
            part["width"] = 1.4 * style["linewidth"] * (1.4 if line.shape[1] == 2 else 1.0)
        parts.append(part)
    for name in first["points"]:
        if name not in replaced:
            values = _along(frames, lambda frame, n=name: frame["points"][n])
            parts.append({"name": name, "kind": "points", "colour": "#ffffff", "values": values})
    return parts


def _faint(frames: list[Mapping[str, Any]]) -> list[Part]:
    """A plan's outlines of bodies and its open lines that move, thin."""
    parts = []
    for name, line in frames[0]["lines"].items():
        values = _along(frames, _line(name))
        if len(values) > 1:
            width = 1.6 if is_closed(np.asarray(line)) else 0.9
            look = {"name": f"planned {name}", "kind": "line", "colour": PLANNED, "width": width}
            parts.append({**look, "values": values})
    return parts


def _route(solution: Solution) -> list[Part]:
    """The route that a plan follows, which stands still."""
    places = routes.route_places(solution)
    if places is None:
        return []
    return [
        {
            "name": "route",
            "kind": "line",
            "colour": routes.ROUTE["color"],
            "width": 1.6,
            "values": places[None],
        }
    ]


def _rod(frames: list[Mapping[str, Any]], name: str) -> Part:
    """Both ends of a bar; where its length changes a tube, out of which a piston comes."""
    ends = _along(frames, lambda frame: frame["solids"][name]["ends"])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    lengths = lengths[np.isfinite(lengths)]
    extends = len(lengths) and np.ptp(lengths) > 1e-6 * lengths.max()
    tube = {"tube": TUBE * float(lengths.min())} if extends else {}
    return {"kind": "rod", "values": ends, "exact": True, **tube}


def _ball(frames: list[Mapping[str, Any]], name: str) -> Part:
    """A ball's centre and its own three axes, four rows a sample."""
    centres = _along(frames, lambda frame: frame["solids"][name]["centre"])
    turned = _along(frames, lambda frame: frame["solids"][name]["rotation"])
    rows = max(len(centres), len(turned))
    centre, axes = (np.broadcast_to(some, (rows, *some.shape[1:])) for some in (centres, turned))
    values = np.concatenate([centre[:, None], axes.transpose(0, 2, 1)], axis=1)
    return {"kind": "ball", "colour": PLAIN, "values": values}


def replaced_by_solids(shown: Mapping[str, Any]) -> set[str]:
    """Names and kinds of the lines and points that a drawing's solids stand for."""
    return {
        name for key, solid in shown.get("solids", {}).items() for name in (key, *solid.get("replaces", ()))
    }


def _line(name: str) -> Callable[[Mapping[str, Any]], Any]:
    return lambda frame: frame["lines"][name]


def _along(frames: list[Mapping[str, Any]], of: Any) -> Array:
    """One array over all frames, samples first; a single sample where it never changes."""
    values = np.array([np.asarray(of(frame), dtype=float) for frame in frames])
    return (
        values[:1]
        if np.array_equal(values, np.broadcast_to(values[0], values.shape), equal_nan=True)
        else values
    )


def _colours(lines: Mapping[str, Array]) -> dict[str, str]:
    """The colours that the pictures on paper give to lines."""
    kinds, colours = list(kinds_of(lines)), {}
    fills = fills_of({name: line for name, line in lines.items() if is_closed(line)})
    for name in lines:
        kind, number = split_name(name)
        if name in fills:
            colours[name] = fills[name]
        else:
            colours[name] = str(open_line_style(kinds.index(kind), number)["color"])
    return {name: "#b8b8b8" if colour == FILLS[0] else colour for name, colour in colours.items()}


def _outlines(shown: Mapping[str, Any], moving: set[Any]) -> list[list[list[float]]]:
    """What a ghost shows: the outlines of bodies that move, or where there are none every line that does."""
    lines = {name: np.asarray(line, dtype=float) for name, line in shown["lines"].items()}
    closed = {name: line for name, line in lines.items() if is_closed(line)}
    bodies = {name: line for name, line in bodies_of(closed).items() if name in moving} or {
        name: line for name, line in lines.items() if name in moving or not moving
    }
    return [line.tolist() for line in (bodies or closed or lines).values() if np.isfinite(line).all()]


def _box(shown: list[Mapping[str, Any]], trace: Array | None) -> tuple[Array, Array]:
    """(low, high) corners of a box around everything that is ever drawn."""
    numbers = drawing.dimension(shown[0])
    low, high = drawing.extent(*shown, points=np.empty((0, numbers)) if trace is None else trace)
    for frame in shown:
        for solid in frame.get("solids", {}).values():
            places = np.reshape(solid["ends"] if "ends" in solid else solid["centre"], (-1, numbers))
            low = np.fmin(low, places.min(axis=0) - solid["radius"])
            high = np.fmax(high, places.max(axis=0) + solid["radius"])
    return low, high
