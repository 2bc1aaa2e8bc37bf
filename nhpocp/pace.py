"""How fast a motion has to be: legs too far apart for their speeds, and the horizon in which a motion keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, floor, log10
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound
from nhpocp.foreseen import FORGIVEN, of_the_pose
from nhpocp.problem import PlanningProblem
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS

ROOM = 1.05  # times the least horizon that a motion needs: between its samples it may be a little faster


def too_far(problem: PlanningProblem, horizon: float | None, tolerance: float) -> str:
    """Why no motion at all keeps the bounds on the legs' speeds, in words; empty where that is not proved.

    A leg's length changes by the integral of its speed, at most by the speed's limit times the time between two poses
    that fix it. horizon: the longest T [time], None for no limit. tolerance: on E, by which lengths may be off.
    """
    bounds = [bound for bound in problem.bounds if bound.quantity == "u"]
    legs = any(block.name == "leg_lengths" for _, block in problem.quantities)  # others call inputs u, too
    if not bounds or horizon is None or not legs:
        return ""
    known = [(0.0, "the start", problem.start), *((via.share, "a via pose", via.goal) for via in problem.via)]
    before: tuple[float, str, Array] | None = None
    for share, name, pose in [*known, (1.0, "the goal", problem.goal)]:
        lengths = _lengths(problem, pose)
        if lengths is None:
            continue
        if before is not None:
            # a pose that is off by E: as far as its place, and as its turn moves the platform's farthest joint
            lever = len(lengths) * (problem.system.own_length or 0.0)
            slack = 2 * 1.01 * tolerance * (problem.error_length + lever)  # at either end
            place = f"between {before[1]} and {name}"
            time = (share - before[0]) * horizon
            for bound in bounds:
                if words := _beyond(bound, lengths - before[2], time, horizon, slack, place):
                    return words
        before = share, name, lengths
    return ""


def _lengths(problem: PlanningProblem, pose: Mapping[str, Any]) -> Array | None:
    """The lengths of the legs at a pose that fixes them, of machines whose every such leg has a motor."""
    lengths = pose.get("leg_lengths")
    if lengths is None:
        lengths = of_the_pose(problem, pose, ["leg_lengths"]).get("leg_lengths")
    motors = next(block.components for _, block in problem.quantities if block.name == "u")
    return None if lengths is None or np.size(lengths) != motors else np.asarray(lengths, dtype=float)


def _beyond(bound: Bound, travel: Array, time: float, horizon: float, slack: float, place: str) -> str:
    limits = np.where(travel > 0, bound.upper, -np.asarray(bound.lower, dtype=float))
    needed = np.maximum(np.abs(travel) - slack, 0.0) / time
    allowed = np.maximum(limits, 0.0) * (1.0 + FORGIVEN)
    worst = int(np.argmax(np.where(np.isfinite(allowed), needed - allowed, -np.inf)))
    if not needed[worst] > allowed[worst]:
        return ""
    least = horizon * needed[worst] / limits[worst] if limits[worst] > 0 else np.inf
    change = "longer" if travel[worst] > 0 else "shorter"
    slower = f"horizon: {_up(least)} or " if np.isfinite(least) else ""
    return (
        f"{bound.label} and horizon exclude each other, whatever the motion: leg_lengths[{worst}] becomes "
        f"{abs(travel[worst]):.4g} {change} {place}, and {bound.label} {limits[worst]:.4g} allows "
        f"{max(limits[worst], 0.0) * time:.4g} in {time:.4g}. The least that could do is {slower}{bound.label}: "
        f"{_up(needed[worst])}"
    )


def patient_horizon(bounds: list[Bound], trajectory: Mapping[str, Array]) -> str | None:
    """T [time], in words, in which the same path keeps bounds on rates; None where no time is enough."""
    factor = 1.0
    for bound in bounds:
        values = np.asarray(trajectory[bound.quantity])
        for limit, most in (
            (bound.upper, values.max(axis=0)),
            (-np.asarray(bound.lower), -values.min(axis=0)),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                factors = np.where(most > 0, most / np.asarray(limit, dtype=float), 0.0)
            if np.any((most > 0) & (np.asarray(limit) <= 0)):
                return None
            power = 2 if bound.quantity == LEG_ACCELERATIONS else 1  # of the pace
            factor = max(factor, float(np.max(factors)) ** (1 / power))
    return _up(ROOM * factor * float(trajectory["t"][-1])) if np.isfinite(factor) else None


def _up(value: float) -> str:
    """A number in three figures that is no less."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return f"{ceil(value / unit * (1 - 1e-12)) * unit:.6g}"
