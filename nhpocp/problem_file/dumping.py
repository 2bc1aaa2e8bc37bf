"""A problem built in Python written as a problem file: `parse_problem(dump_problem(p))` is the same problem."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from nhpocp.constraints.registry import block_of
from nhpocp.errors import InvalidProblemError
from nhpocp.poses import goal_blocks
from nhpocp.problem_file.settings import BLOCKS

if TYPE_CHECKING:
    from nhpocp.problem import PlanningProblem

# written one key a line, the rest in one line
_BLOCKS = {"", "control", "constraints", "solvers", "reference"}


def dump_problem(problem: PlanningProblem, settings: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """The problem as YAML: the text that it was read from, or what was made in Python.

    problem: a `PlanningProblem`. settings: of solvers by name, instead of those of the problem's own solver objects.
    Errors: `InvalidProblemError` for what a file has no words for, such as a bound with a label of one's own.
    """
    asked = settings or {}
    own = {name: solver.settings() for name, solver in problem.solvers.items() if name in asked}
    if problem.source is not None and own == dict(asked):
        return problem.source
    return write_data(_data(problem, asked))


def _data(problem: PlanningProblem, settings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    horizon = problem.horizon
    data: dict[str, Any] = {
        "nhpocp": 1,
        "name": problem.name,
        "system": {"model": problem.system.model, **problem.system.parameters()},
        "units": problem.units.stated() or None,
        "start": _state(problem, problem.start),
        "goal": _state(problem, problem.goal),
        "horizon": (
            _without_none({"min": horizon.minimum, "max": horizon.maximum, "initial": horizon.initial})
            if horizon.free
            else horizon.initial
        ),
        "control": {
            "basis": problem.basis.kind,
            **problem.basis.parameters(),
            "initial": "auto" if problem.initial is None else problem.initial.tolist(),
        },
        "objective": problem.objective,
        "error_length": problem.error_length,
        "length_scale": problem.length_scale,
        "via": [{"at": via.share, **_state(problem, via.goal)} for via in problem.via] or None,
        "obstacles": [obstacle.as_data() for obstacle in problem.obstacles] or None,
        "constraints": block_of(problem.bounds, problem.system) or None,
        "solvers": _solvers(problem, settings) or None,
        "output": {"samples": problem.samples, "pictures": problem.pictures},
        "reference": dict(problem.reference) or None,
    }
    return _without_none(data)


def _without_none(data: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in data.items() if value is not None}


def _state(problem: PlanningProblem, values: Any) -> dict[str, Any]:
    import numpy as np

    kinds = {block.name: block.kind for block in goal_blocks(problem.system)}
    plain = {name: np.asarray(value, dtype=float).tolist() for name, value in values.items()}
    return {name: {"matrix": value} if kinds[name] == "rotation" else value for name, value in plain.items()}


def _solvers(problem: PlanningProblem, settings: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Settings under the file's names; what a file has no name for stays behind."""
    given = {name: solver.settings() for name, solver in problem.solvers.items()} | dict(settings)
    return {name: writable(name, values) for name, values in given.items() if name in BLOCKS}


def writable(name: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that a file can state: a step rule of the user's own, say, has no name there."""
    known = {key: value for key, value in settings.items() if key in BLOCKS[name].model_fields}
    known = _without_none(known)
    if _buildable(name, known):
        return known
    return {key: value for key, value in known.items() if _buildable(name, {key: value})}


def _buildable(name: str, settings: Mapping[str, Any]) -> bool:
    from nhpocp.problem_file.building import build_solver

    try:
        build_solver(name, settings)
    except InvalidProblemError:
        return False
    return True


def write_data(data: dict[str, Any], path: str = "", indent: str = "") -> str:
    """A file's data as YAML: block style where it is read line by line, flow style (JSON is YAML) inside."""
    lines = []
    for name, value in data.items():
        here = f"{path}.{name}".lstrip(".")
        if isinstance(value, dict) and value and here in _BLOCKS:
            lines.append(f"{indent}{_flow(name)}:\n" + write_data(value, here, indent + "  "))
        elif here == "control.initial" and isinstance(value, list):
            lines.append(f"{indent}{name}:\n" + "".join(f"{indent}  - {_flow(row)}\n" for row in value))
        else:
            lines.append(f"{indent}{_flow(name)}: {_flow(value)}\n")
    return "".join(lines)


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_flow(name)}: {_flow(item)}" for name, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", value) and not _is_word(value):
        return value
    if hasattr(value, "item"):
        value = value.item()  # a NumPy scalar
    try:
        text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError):
        raise InvalidProblemError(f"{value!r} cannot be written into a problem file") from None
    # JSON leaves characters alone that YAML wants escaped
    return re.sub(r"[\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]", lambda c: f"\\u{ord(c[0]):04x}", text)


def _is_word(text: str) -> bool:
    return text.lower() in ("null", "true", "false", "yes", "no", "on", "off", "y", "n")
