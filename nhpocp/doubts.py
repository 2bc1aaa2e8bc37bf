"""What is legal in a problem and hardly meant: said by `nhpocp check`, and in Python as a warning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Any

import numpy as np

from nhpocp.errors import InvalidProblemError
from nhpocp.foreseen import broken_poses, other_side, singular_goal, singular_pose
from nhpocp.pace import too_far
from nhpocp.problem import PlanningProblem
from nhpocp.scales import coarse
from nhpocp.systems.system import DISTANCE, System
from nhpocp.via import Via

TURN = 2 * pi
# turns above which an angle is doubted; coordinates such as a wheel's count theirs
ORIENTATION, COORDINATE = 1, 5


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
    yield from _probable_degrees(written, problem.system, "{:g} deg" if file else "{:g} * nhpocp.deg")
    if problem.objective == "time" and not problem.horizon.free:
        words = "time is fixed by horizon; write horizon: {min: …, max: …} to free it"
        yield InvalidProblemError(words, path="objective", at_key=True)


def _in_python(problem: PlanningProblem) -> dict[str, Any]:
    """What the maker of a problem wrote, as a file would have it."""
    vias = [{"at": via.share, **via.goal} if isinstance(via, Via) else via for via in problem.written["via"]]
    return {"system": problem.system.parameters(), **problem.written, "via": vias}


def _probable_degrees(
    written: Mapping[str, Any], system: System, degrees: str
) -> Iterator[InvalidProblemError]:
    """Angles that are plain numbers too large for radians: many turns are seldom meant."""
    for path, value, turns in _angles(written, system):
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if plain and abs(value) > turns * TURN:
            words = f"{value:g} radians are {abs(value) / TURN:.3g} turns; if degrees are meant, write "
            yield InvalidProblemError(words + degrees.format(value), path=path)


def _angles(written: Mapping[str, Any], system: System) -> Iterator[tuple[str, Any, float]]:
    block = written["system"]
    for name, parameter in system.declared.items():
        if parameter.unit == "angle" and name in block:
            yield f"system.{name}", block[name], ORIENTATION
    poses = [("start", written["start"]), ("goal", written["goal"])]
    poses += [(f"via[{i}]", via) for i, via in enumerate(written.get("via") or ())]
    for path, pose in poses:
        for part in system.state_space.blocks:
            value = pose.get(part.name)
            if part.kind == "rotation" and isinstance(value, Mapping):
                for name in ("rpy", "rotvec"):
                    for i, angle in enumerate(_listed(value.get(name))):
                        yield f"{path}.{part.name}.{name}[{i}]", angle, ORIENTATION
            elif part.unit == "angle" and part.kind != "rotation":
                for i, angle in enumerate(_listed(value)):
                    place = f"[{i}]" if part.kind == "vector" else ""
                    yield f"{path}.{part.name}{place}", angle, COORDINATE


def _listed(value: Any) -> Sequence[Any]:
    value = value.tolist() if hasattr(value, "tolist") else value
    return value if isinstance(value, list | tuple) else [] if value is None else [value]
