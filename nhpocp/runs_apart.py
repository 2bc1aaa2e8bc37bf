"""What makes two runs two: which are on one task, and how those that are called alike are told apart."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nhpocp import variant_label
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution


def task_of(problem: PlanningProblem) -> str:
    """What makes two problems the same task: everything but names, solvers and the control to begin with."""
    bounds = {bound.label: [bound.lower, bound.upper] for bound in problem.bounds}
    poses = (problem.start, problem.goal, *(via.goal for via in problem.via))
    parts = [
        [problem.system.model, problem.system.parameters()],
        poses,
        [via.share for via in problem.via],
        [problem.horizon.initial, problem.horizon.minimum, problem.horizon.maximum],
        [problem.objective, problem.error_length, problem.scale, bounds],
        [obstacle.as_data() for obstacle in problem.obstacles],
    ]
    return json.dumps(_rounded(parts), sort_keys=True, default=str)


def _rounded(value: Any) -> Any:
    """Plain data in which -pi/6 is -30 deg, and 1 is 1.0."""
    if isinstance(value, Mapping):
        return {name: _rounded(part) for name, part in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        return 0.0 if abs(float(value)) < 1e-15 else float(f"{float(value):.12g}")
    return value


def told_apart(runs: Sequence[tuple[Solution, str]]) -> list[str]:
    """Names for solutions that are called so: those of one task and one name get what differs between them as a
    variant's settings, else a number."""
    tasks = [task_of(solution.problem) for solution, _ in runs]
    same: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for task, (solution, name) in zip(tasks, runs, strict=True):
        same.setdefault((task, name), []).append(_traits(solution))
    used: set[tuple[str, str]] = set()
    names = []
    for task, (solution, label) in zip(tasks, runs, strict=True):
        twins, mine = same[task, label], _traits(solution)
        differing = [key for key in mine if any(other.get(key) != mine[key] for other in twins)]
        base = name = variant_label.joined(label, [f"{key}={mine[key]}" for key in differing])
        count = 1
        while (task, name) in used:
            count += 1
            name = f"{base} ({count})"
        used.add((task, name))
        names.append(name)
    return names


def _traits(solution: Solution) -> dict[str, Any]:
    """What may differ between runs on one task: the settings, and the control to begin with under the file's names."""
    basis = solution.problem.basis
    return {
        "name": solution.problem.name,
        **solution.settings,
        "control.basis": basis.kind,
        **{f"control.{key}": value for key, value in basis.parameters().items()},
        "control.initial": "auto" if solution.problem.initial is None else "given",
    }
