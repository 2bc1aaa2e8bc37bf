"""The objectives by name: choices, messages, stored costs and the rows of reports follow from these lines."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from nhpocp.family import Family, Group
from nhpocp.objectives.objective import Objective
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from nhpocp.controls.control import Control

# a cost stands beside these in the settings, among a solver's reference values, and in solution.json
RESERVED = (
    "none", "horizon", "iterations", "evaluations", "tolerance", "source",
    "schema_version", "name", "solver", "system", "settings", "outcome", "converged", "message", "warnings",
    "final_error", "verified", "objective", "control", "trajectory", "crossings", "length_scale", "constraints",
    "details", "timing", "environment", "checksum", "folder",
)  # fmt: skip
OBJECTIVES: Family[Objective] = Family(
    {
        "effort": "nhpocp.objectives.effort:Effort",
        "leg_effort": "nhpocp.objectives.leg_effort:LegEffort",
        "control_rate": "nhpocp.objectives.control_rate:ControlRate",
        "path_length": "nhpocp.objectives.path_length:PathLength",
        "time": "nhpocp.objectives.duration:Duration",
    },
    made=lambda cls: cls(),
    group=Group(
        "nhpocp.objectives", "nhpocp.objectives.objective:Objective", "name", "an objective", RESERVED
    ),
)


def costs_of_motion() -> list[str]:
    """Names of what motions of one duration differ in: the costs that are stored."""
    return [name for name, objective in OBJECTIVES.items() if objective.of_motion]


def available(system: System) -> Iterator[Objective]:
    """The objectives that a system has."""
    return (objective for objective in OBJECTIVES.values() if not objective.lacking(system))


def exact_costs(control: Control) -> dict[str, float]:
    """The costs of a motion that its control tells exactly, effort among them."""
    costs = {name: OBJECTIVES[name].of_control(control) for name in costs_of_motion()}
    return {name: cost for name, cost in costs.items() if cost is not None}
