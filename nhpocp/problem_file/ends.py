"""Poses of a problem file that break a bound themselves: start, goal and via poses, before anything is solved.

Plain Python, no NumPy: `nhpocp check` has to answer before NumPy would have been imported.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import hypot, inf
from typing import Any

from nhpocp.problem_file.constraints import Constraints
from nhpocp.problem_file.issues import Issue, Path, dotted
from nhpocp.problem_file.schema import FreeHorizon, ProblemData
from nhpocp.problem_file.states import plain_state
from nhpocp.scales import Scales, coarse, natural_scales, side_size
from nhpocp.systems.system import System

FORGIVEN = 1e-3  # of the limit that is passed: as much as verification forgives


def broken_ends(data: ProblemData, system: System) -> Iterator[Issue]:
    """A warning for every pose of the file and every bound on the pose alone that it breaks, at its worst component."""
    poses: list[tuple[Path, Any, str]] = [(("start",), data.start, "begin"), (("goal",), data.goal, "end")]
    poses += [(("via", i), via.values, "pass") for i, via in enumerate(data.via)]
    scales = file_scales(data, system)
    for path, state, verb in poses:
        quantities = _quantities(system, plain_state(state))
        for label, name, pair in _bounds(data.constraints):
            if name in quantities and (words := _broken(label, quantities[name], pair, _size(scales, name))):
                yield Issue(path, f"{words}; no plan can {verb} there", at_key=True)


def coarse_tolerance(data: ProblemData, system: System) -> Iterator[Issue]:
    """A warning where what the Jacobian method counts as reached is a large part of the motion."""
    tolerance = data.solvers.jacobian.tolerance
    if words := coarse(file_scales(data, system), _poses(data), data.error_length, tolerance):
        yield Issue(("error_length",), words, at_key=True)


def file_scales(data: ProblemData, system: System) -> Scales:
    """What counts as 1 in the problem of a file, as `PlanningProblem.scales`."""
    bounds = data.constraints.given().get("state", {})
    boxes = [
        (name, *(_unbounded(s, e) for s, e in zip(pair, (-inf, inf), strict=True)))
        for name, pair in bounds.items()
    ]
    horizon = data.horizon
    durations: tuple[float | None, ...] = (
        (horizon.initial, horizon.max, horizon.min) if isinstance(horizon, FreeHorizon) else (horizon,)
    )
    return natural_scales(system, _poses(data), boxes, durations, data.error_length, data.length_scale)


def _unbounded(side: Any, instead: float) -> Any:
    """A side of a bound with infinity where it has no limit."""
    if isinstance(side, list):
        return [_unbounded(entry, instead) for entry in side]
    return instead if side is None else side


def _poses(data: ProblemData) -> list[dict[str, Any]]:
    return [plain_state(state) for state in (data.start, *(via.values for via in data.via), data.goal)]


def _size(scales: Scales, name: str) -> tuple[float, bool]:
    """The scale of a quantity of the pose, and whether it is a coordinate."""
    system = scales.system
    blocks = {block.name: block for block in [*system.state_space.blocks, *system.pose_outputs]}
    return scales.of(blocks[name].unit), name in system.state_space.names


def _bounds(constraints: Constraints) -> Iterator[tuple[str, str, list[Any]]]:
    """(label in messages, quantity, [lo, hi]) of every bound that a pose alone may break."""
    given = constraints.given()
    if "leg_length" in given:
        yield "leg_length", "leg_lengths", given["leg_length"]
    for name, pair in given.get("state", {}).items():
        yield dotted(("state", name)), name, pair


def _quantities(system: System, state: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of a pose: its vectors and scalars, and the lengths of the legs where the pose fixes them."""
    found = {
        block.name: state[block.name]
        for block in [*system.state_space.blocks, *system.pose_outputs]
        if block.kind in ("vector", "scalar") and block.name in state
    }
    legs = getattr(system, "legs", None)
    if legs and "position" in state and "orientation" in state:
        found["leg_lengths"] = [
            _length(leg, state["position"], state["orientation"]) for leg in legs if not leg.pinned
        ]
    return found


def _length(leg: Any, position: list[float], rows: list[list[float]]) -> float:
    """l = |p + R b̂ - a|, [Paper] section 2."""
    turned = [sum(r * b for r, b in zip(row, leg.platform, strict=True)) for row in rows]
    return hypot(*(p + b - a for p, b, a in zip(position, turned, leg.base, strict=True)))


def _broken(label: str, values: Any, pair: list[Any], size: tuple[float, bool]) -> str | None:
    """What the worst component is, and which limits it should keep; None where all keep them."""
    components = values if isinstance(values, list) else [values]
    worst, words = FORGIVEN, None
    for i, value in enumerate(components):
        low, high = ((side[i] if isinstance(side, list) else side) for side in pair)
        excess = max(_excess(low, high, value, -1, size), _excess(high, low, value, +1, size))
        if excess > worst:
            name = f"{label}[{i}]" if isinstance(values, list) else label
            worst, words = excess, f"{name} is {value:.4g}, {_limits(low, high)}"
    return words


def _excess(
    limit: float | None, other: float | None, value: float, side: int, size: tuple[float, bool]
) -> float:
    """How far a value is beyond a limit, in units of `side_size`."""
    if limit is None:
        return 0.0
    return side * (value - limit) / side_size(limit, -side * inf if other is None else other, *size)


def _limits(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return f"below {low:g}" if low is not None else f"above {high:g}"
    return f"outside [{low:g}, {high:g}]"
