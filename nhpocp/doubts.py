"""What is legal in a problem and hardly meant: said by `nhpocp check`, and in Python as a warning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import inf, pi
from typing import Any

import numpy as np

from nhpocp.bodies.obstacles import KINDS
from nhpocp.constraints.registry import part_of
from nhpocp.declared import Degrees
from nhpocp.errors import InvalidProblemError
from nhpocp.foreseen import broken_poses, other_side, singular_goal, singular_pose
from nhpocp.pace import too_far
from nhpocp.poses import goal_blocks
from nhpocp.problem import PlanningProblem
from nhpocp.scales import coarse
from nhpocp.systems.system import DISTANCE
from nhpocp.via import Via

TURN = 2 * pi
# turns above which an angle is doubted; coordinates such as a wheel's count theirs
ORIENTATION, COORDINATE, LIMIT = 1, 5, 1


def doubts(
    problem: PlanningProblem, tolerance: float, file: Mapping[str, Any] | None = None
) -> Iterator[InvalidProblemError]:
    """Each doubt with its place, of a pose that of the via poses as they were written.

    tolerance: of the method that is to solve it, on E. file: the plain data that were read; None where the problem was
    made in Python.
    """
    start, goal = problem.start, problem.goal
    written = file if file is not None else _in_python(problem)
    vias = written.get("via") or ()
    order = sorted(range(len(vias)), key=lambda i: float(vias[i]["at"]))
    if problem.system.driftless and all(
        name in start and np.allclose(goal[name], start[name], 1e-12, 1e-12) for name in goal
    ):
        words = "the same as start; the shortest plan is to stand still"
        yield InvalidProblemError(words, path="goal", at_key=True)
    for pose, report in broken_poses(problem):
        verb = {"start": "begin", "goal": "end"}.get(pose, "pass")
        words = f"{report.name} is {report.value_words()}, {report.limit_words()}; no plan can {verb} there"
        place = f"via[{order[int(pose[4:-1])]}]" if pose.startswith("via[") else pose
        yield InvalidProblemError(words, path=place, at_key=True)
    if on_the_surface := singular_goal(problem)[1]:
        yield InvalidProblemError(f"{on_the_surface}; no plan can end there", path="goal", at_key=True)
    if on_the_surface := singular_pose(problem, start)[1]:
        words = f"{on_the_surface}; the machine is singular where it begins"
        yield InvalidProblemError(words, path="start", at_key=True)
    if words := other_side(problem):
        yield InvalidProblemError(f"{words}; no path leads there", path="goal", at_key=True)
    if problem.obstacles and all(bound.quantity != DISTANCE for bound in problem.bounds):
        words = (
            "nothing asks to keep away from them; write constraints: {distance: 0.1}, in the problem's length"
        )
        yield InvalidProblemError(words, path="obstacles", at_key=True)
    horizon = problem.horizon
    if words := too_far(problem, horizon.maximum if horizon.free else horizon.initial, tolerance):
        yield InvalidProblemError(words, path="constraints.leg_speed", at_key=True)
    poses = [start, *(via.goal for via in problem.via), goal]
    if words := coarse(problem.scales, poses, problem.error_length, tolerance):
        yield InvalidProblemError(words, path="error_length", at_key=True)
    degrees = "{:g} deg" if file is not None else "{:g} * nhpocp.deg"
    yield from _probable_degrees(_angles(written, problem), degrees)
    if problem.objective == "time" and not problem.horizon.free:
        words = "time is fixed by horizon; write horizon: {min: …, max: …} to free it"
        yield InvalidProblemError(words, path="objective", at_key=True)


def _in_python(problem: PlanningProblem) -> dict[str, Any]:
    """What the maker of a problem wrote, as a file would have it, limits by the labels of their bounds."""
    vias = [{"at": via.share, **via.goal} if isinstance(via, Via) else via for via in problem.written["via"]]
    limits = {bound.label: [bound.lower, bound.upper] for bound in problem.bounds if not bound.degrees}
    obstacles = [obstacle.as_data() for obstacle in problem.obstacles]
    system = problem.system.parameters()
    return {"system": system, **problem.written, "via": vias, "constraints": limits, "obstacles": obstacles}


def _probable_degrees(
    angles: Iterable[tuple[str, Any, float]], degrees: str
) -> Iterator[InvalidProblemError]:
    """Angles that are plain numbers too large for radians: many turns are seldom meant."""
    for written_at, written, turns in angles:
        for path, value in _entries(written, written_at):
            plain = isinstance(value, int | float) and not isinstance(value, bool | Degrees)
            if plain and turns * TURN < abs(value) < inf:
                words = f"{value:g} radians are {abs(value) / TURN:.3g} turns; if degrees are meant, write "
                yield InvalidProblemError(words + degrees.format(value), path=path)


def _angles(written: Mapping[str, Any], problem: PlanningProblem) -> Iterator[tuple[str, Any, float]]:
    """Each angle, or several, with its path and the turns above which it is doubted."""
    system, block = problem.system, written["system"]
    for name, parameter in system.declared.items():
        if parameter.unit == "angle" and name in block:
            yield f"system.{name}", block[name], ORIENTATION
    poses = [("start", written["start"]), ("goal", written["goal"])]
    poses += [(f"via[{i}]", via) for i, via in enumerate(written.get("via") or ())]
    for path, pose in poses:
        for part in goal_blocks(system):
            value = pose.get(part.name)
            if part.kind == "rotation" and isinstance(value, Mapping):
                for name in ("rpy", "rotvec"):
                    yield f"{path}.{part.name}.{name}", value.get(name), ORIENTATION
            elif part.unit == "angle" and part.kind != "rotation":
                yield f"{path}.{part.name}", value, COORDINATE
    angles = [
        b.name for kind, b in problem.quantities if kind != "input" and b.unit == "angle" and not b.rate
    ]
    limits = written.get("constraints") or {}
    for label in (bound.label for bound in problem.bounds if bound.quantity in angles):
        key = label.partition(".")[0]
        yield (
            f"constraints.{label}",
            limits[label] if label in limits else part_of(limits.get(key), label),
            LIMIT,
        )
    for i, each in enumerate(written.get("obstacles") or ()):
        kind = problem.obstacles[i].kind
        for name, entry in KINDS[kind].entries.items():
            if entry.kind in ("angle", "angles"):
                yield f"obstacles[{i}].{kind}.{name}", each[kind].get(name), ORIENTATION


def _entries(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every entry of nested lists and mappings, with its path."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _entries(part, f"{path}.{name}")
    elif isinstance(value, list | tuple):
        for i, part in enumerate(value):
            yield from _entries(part, f"{path}[{i}]")
    else:
        yield path, value
