"""What can be said of a problem before it is solved: poses that break bounds, bounds that exclude each other, costs
that have no least."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound, BoundReport, check_bounds, in_shape
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS
from nhpocp.systems.margins import det, margin, sigma
from nhpocp.systems.system import DISTANCE

FORGIVEN = 2e-3  # of its size: by how much each bound is widened first, twice what verification forgives
AFFINE = 1e-9  # relative
ON_THE_SURFACE = 1e-9  # σ_min below which the sign of a determinant is rounding


@dataclass(frozen=True)
class _Sides:
    """lower ≤ A u + b ≤ upper: what one bound asks of the control at one pose."""

    bound: Bound
    A: Array  # numbers × inputs
    b: Array
    lower: Array
    upper: Array


def broken_poses(problem: PlanningProblem) -> Iterator[tuple[str, BoundReport]]:
    """Poses with the bounds that they break themselves, whatever the control; of every bound its worst component.

    A pose is named "start", "goal" or "via[0]".
    """
    poses = {"start": problem.start, "goal": problem.goal}
    poses |= {f"via[{i}]": via.goal for i, via in enumerate(problem.via)}
    for place, pose in poses.items():
        values = {**of_the_pose(problem, pose, [bound.quantity for bound in problem.bounds]), **pose}
        bounds = [bound for bound in problem.bounds if bound.quantity in values]
        batch = {name: np.asarray(value, dtype=float)[None] for name, value in values.items()}
        for report in check_bounds(bounds, np.zeros(1), batch):
            if not report.ok:
                yield place, report


def of_the_pose(problem: PlanningProblem, pose: Mapping[str, Any], names: Iterable[str]) -> dict[str, Array]:
    """Those named of the outputs and margins of a whole pose that no control changes."""
    system, space = problem.system, problem.system.state_space
    if not set(space.names) <= set(pose):
        return {}
    point, inputs = np.asarray(space.pack(pose)), system.input_space.size
    wanted = {*names} - {*space.names, *system.input_space.names, LEG_ACCELERATIONS}
    values: dict[str, Array] = {}
    for name in wanted:
        if bounded := margin(name):
            scaled = system.regularity(point)[bounded.matrix]
            scaled = scaled / system.column_scales(bounded.matrix, problem.scale)
            least = svd(scaled, compute_uv=False)[-1] if np.isfinite(scaled).all() else np.nan
            values[name] = least
            continue
        if name == DISTANCE:  # no control changes it
            values[name] = np.asarray(system.quantity(name, point, np.zeros(inputs)), dtype=float)
            continue
        try:
            with np.errstate(all="ignore"):
                still, moving = (system.quantity(name, point, np.full(inputs, u)) for u in (0.0, 1.0))
        except np.linalg.LinAlgError:  # a singular pose has no such output
            continue
        if np.array_equal(still, moving):
            values[name] = np.squeeze(still)
    return values


def singular_goal(problem: PlanningProblem) -> tuple[str, str]:
    """`singular_pose` of the goal."""
    return singular_pose(problem, problem.goal)


def singular_pose(problem: PlanningProblem, pose: Mapping[str, Any]) -> tuple[str, str]:
    """The matrix that is singular at a pose and separates what the machine can do, and what is so in words.

    Both empty where none is.
    """
    system = problem.system
    names = {sigma(name).name: name for name in system.separating()}
    with np.errstate(all="ignore"):  # of a pose where a joint has no direction
        margins = of_the_pose(problem, pose, names)
    for quantity, least in margins.items():
        if least <= ON_THE_SURFACE:
            letter = det(names[quantity]).letter
            words = f"lies on det {letter} = 0, where σ_min({letter}) is {least:.2g}"
            return names[quantity], words
    return "", ""


def other_side(problem: PlanningProblem) -> str:
    """Determinants that no path of the machine changes for good, and that differ in sign at the goal, in words.

    Empty where there are none, or where the goal is no pose.
    """
    system, sentences = problem.system, {}
    names = system.separating() if problem.goal_is_a_pose else ()
    if not names:
        return ""
    with np.errstate(all="ignore"):  # of a pose where a joint has no direction
        start, goal = (system.regularity(point) for point in (problem.start_point, problem.goal_point))
        for name in names:
            first, last = np.linalg.det(start[name]), np.linalg.det(goal[name])
            if first * last < 0:  # not where one is no number
                words = f"det {det(name).letter} is {first:.3g} at the start and {last:.3g} at the goal"
                sentences[name] = words
    if any(singular_pose(problem, pose)[0] for pose in (problem.start, problem.goal) if sentences):
        return ""  # where signs are rounding
    words = "; ".join(sentences.values())
    if words and (actuated := system.actuated()) and not set(sentences) & set(actuated[0].separating()):
        words += ", which eq. (7) cannot cross; `form: original` may"
    return words


def contradiction(problem: PlanningProblem) -> str:
    """Bounds that exclude each other, in words; empty where none are seen to.

    On one quantity, or because no control at all keeps them at the start, or at a goal that is a pose.
    """
    for quantity in dict.fromkeys(bound.quantity for bound in problem.bounds):
        bounds = [bound for bound in problem.bounds if bound.quantity == quantity]
        lower = np.max(np.broadcast_arrays(*(np.asarray(b.lower, dtype=float) for b in bounds)), axis=0)
        upper = np.min(np.broadcast_arrays(*(np.asarray(b.upper, dtype=float) for b in bounds)), axis=0)
        lower, upper = np.broadcast_arrays(lower, upper)
        if (lower > upper).any():
            place = np.unravel_index(int(np.argmax(lower - upper)), lower.shape)
            least, most = (bounds[0].figure(side[place]) for side in (lower, upper))
            return f"{_names(bounds)} leave nothing: {quantity} is to be at least {least} and at most {most}"
    ends = {"start": problem.start_point}
    if problem.goal_is_a_pose:
        ends["goal"] = problem.goal_point
    for where, point in ends.items():
        sides = _asked_of_the_control(problem, point)
        if sides and not _meetable(sides):
            return f"no control at the {where} keeps {_names([side.bound for side in _least(sides)])}"
    return ""


def endless(problem: PlanningProblem) -> str:
    """Why no duration costs least, in words; empty where one may.

    A driftless motion may be run slower, for less effort, as long as no bound asks for a pace.
    """
    horizon = problem.horizon
    free = horizon.free and horizon.maximum is None and problem.system.driftless
    if not free or OBJECTIVES[problem.objective].pace >= 0:
        return ""
    if all(task.error(problem.start_point) == 0 for task in problem.tasks):
        return ""  # to stay costs nothing
    still = np.zeros(problem.system.input_space.size)
    for side in _asked_of_the_control(problem, problem.start_point):
        value = side.A @ still + side.b
        if (value < side.lower).any() or (value > side.upper).any():
            return ""
    least = f"min: {horizon.minimum:g}, " if horizon.minimum is not None else ""
    return (
        f"no horizon costs least: the longer it takes, the less {problem.objective}, down to 0. Give it a max, as in "
        f"`horizon: {{{least}max: {10 * problem.scales.time:g}}}`"
    )


def _asked_of_the_control(problem: PlanningProblem, point: Array) -> list[_Sides]:
    """What the bounds ask of the control at a pose, as far as their quantities are affine in it."""
    from nhpocp.systems.numeric import numeric_system  # and CasADi, which `check` does without

    if not problem.bounds or not problem.system.input_space.size:
        return []
    inputs = problem.scales.inputs
    mixed = np.linspace(1.0, 2.0, len(inputs)) * inputs
    controls = np.vstack([np.zeros(len(inputs)), np.diag(inputs), mixed])
    values = numeric_system(problem.system).trajectory(
        np.tile(point, (len(controls), 1)), controls, problem.scale
    )
    sides_of_bounds = []
    for bound in problem.bounds:
        numbers = np.asarray(values[bound.quantity]).reshape(len(controls), -1)
        if not np.isfinite(numbers).all():
            continue
        b, A = numbers[0], ((numbers[1:-1] - numbers[0]) / inputs[:, None]).T
        affine = np.abs(A @ mixed + b - numbers[-1]).max() <= AFFINE * np.abs(numbers).max()
        if not affine or not A.any():
            continue
        shape = np.shape(values[bound.quantity])[1:]
        (below, above), sides = bound.sizes, (bound.lower, bound.upper)
        lower, upper = (
            in_shape(np.asarray(side) + sign * FORGIVEN * size, shape).ravel()
            for side, sign, size in zip(sides, (-1, 1), (below, above), strict=True)
        )
        sides_of_bounds.append(_Sides(bound, A, b, lower, upper))
    return sides_of_bounds


def _meetable(sides: Sequence[_Sides]) -> bool:
    """Whether one control meets them all."""
    from scipy.optimize import linprog  # a third of a second, which `check` can do without

    rows, limits = [], []
    for side in sides:
        rows += [side.A, -side.A]
        limits += [side.upper - side.b, side.b - side.lower]
    A, b = np.vstack(rows), np.concatenate(limits)
    kept = np.isfinite(b)
    sizes = np.linalg.norm(A[kept], axis=1)
    sizes[sizes == 0] = 1.0
    columns = np.abs(A[kept] / sizes[:, None]).max(axis=0, initial=0.0)
    columns[columns == 0] = 1.0
    answer = linprog(
        np.zeros(A.shape[1]), A[kept] / sizes[:, None] / columns, b[kept] / sizes, bounds=(None, None)
    )
    return bool(answer.status != 2)  # 2: infeasible


def _least(sides: Sequence[_Sides]) -> list[_Sides]:
    """Those without any of which the rest could be met."""
    kept = list(sides)
    for side in sides:
        rest = [other for other in kept if other is not side]
        if rest and not _meetable(rest):
            kept = rest
    return kept


def _names(bounds: Sequence[Bound]) -> str:
    return " and ".join(dict.fromkeys(bound.label for bound in bounds))
