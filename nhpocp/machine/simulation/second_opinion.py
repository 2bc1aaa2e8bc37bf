"""A second opinion on a plan: what a machine of bodies and contacts makes of it."""

from __future__ import annotations

from typing import Any

from nhpocp.errors import InvalidProblemError
from nhpocp.machine.simulation.building import drive_of
from nhpocp.machine.simulation.machine import require_engine
from nhpocp.machine.simulation.playing import play
from nhpocp.solution import Solution

FACTS = ("outcome", "position_error", "angle_error", "slip", "duration", "engine", "failure")


def opinion(solution: Solution) -> dict[str, Any] | None:
    """Numbers of a `Simulation` by name; None for a plan that is none, and a system that cannot be built.

    Errors: `MissingDependencyError` without MuJoCo.
    """
    require_engine()
    if not solution.converged:
        return None
    try:
        drive_of(solution.problem.system)
        played = play(solution)
    except InvalidProblemError:
        return None
    return None if played.interrupted else {name: getattr(played, name) for name in FACTS}
