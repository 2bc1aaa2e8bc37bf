"""A Solution as the plain data of solution.json."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from nhpocp.objectives.registry import costs_of_motion, exact_costs
from nhpocp.provenance import environment
from nhpocp.solution import Solution
from nhpocp.solution_folder.stored import SCHEMA_VERSION, StoredBound, StoredVerdict


def to_json(solution: Solution) -> dict[str, Any]:
    """solution.json as plain data; NaN and infinities become None."""
    problem, verdict = solution.problem, solution.verdict
    data = {
        "schema_version": SCHEMA_VERSION,
        "name": problem.name,
        "solver": solution.solver,
        "system": {"model": problem.system.model, **problem.system.parameters()},
        "settings": dict(solution.settings),
        "tolerance": solution.tolerance,
        "outcome": solution.outcome.value,
        "converged": solution.converged,
        "message": solution.message,
        "warnings": [*solution.warnings, *(verdict.warnings if verdict else ())],
        "final_error": solution.final_error,
        "verified": StoredVerdict.written(verdict) if verdict else None,
        "objective": solution.objective,
        **dict.fromkeys(costs_of_motion()),
        **exact_costs(solution.control),
        **solution.costs,
        "iterations": list(solution.iterations),
        "evaluations": solution.evaluations,
        "control": {"input": problem.system.input_label(), **solution.control.to_json()},
        "trajectory": {name: np.asarray(values) for name, values in solution.trajectory.items()},
        "crossings": [crossing.to_json() for crossing in verdict.crossings] if verdict else [],
        "length_scale": problem.scale,
        "constraints": {r.bound.label: StoredBound.written(r) for r in verdict.bounds} if verdict else {},
        "details": dict(solution.details),
        "timing": dict(solution.timing),
        "environment": environment(solution.settings.get("plugin")),
    }
    data = plain(data)
    return {**data, "checksum": checksum(data)}


def checksum(data: Mapping[str, Any]) -> str:
    """SHA-256 of what solution.json says besides: a change of any of it is seen, wherever it cannot be worked out."""
    rest = {key: value for key, value in data.items() if key != "checksum"}
    text = json.dumps(_floats(rest), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _floats(value: Any) -> Any:
    """Numbers as floats: whether 1.0 is written as 1 says nothing."""
    if isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, Mapping):
        return {key: _floats(item) for key, item in value.items()}
    if isinstance(value, list):  # of floats, mostly
        return [item if type(item) is float else _floats(item) for item in value]
    return value


def as_text(data: Mapping[str, Any]) -> str:
    """Strict JSON, a line for each of the document's keys; a line for each number would be no reading either."""
    lines = [
        f"{json.dumps(key)}: {json.dumps(value, allow_nan=False, ensure_ascii=False)}"
        for key, value in data.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def plain(value: Any) -> Any:
    """A value as strict JSON data: NaN and infinities become None, arrays become lists."""
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, np.ndarray):
        # entry by entry only where there is something to replace
        whole = value.dtype.kind != "f" or np.isfinite(value).all()
        return value.tolist() if whole and value.dtype != object else plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
