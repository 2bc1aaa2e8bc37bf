"""YAML <-> PlanningProblem: the one place where a file's names meet classes. Loaded lazily, PEP 562."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.problem_file.building import build_solver as build_solver
    from nhpocp.problem_file.building import control_from_json as control_from_json
    from nhpocp.problem_file.dumping import dump_problem as dump_problem
    from nhpocp.problem_file.editor_schema import json_schema as json_schema
    from nhpocp.problem_file.reading import ProblemFile as ProblemFile
    from nhpocp.problem_file.reading import build as build
    from nhpocp.problem_file.reading import load_problem as load_problem
    from nhpocp.problem_file.reading import parse_problem as parse_problem
    from nhpocp.problem_file.reading import read as read
    from nhpocp.problem_file.reading import read_text as read_text
    from nhpocp.problem_file.registry import systems as systems
    from nhpocp.problem_file.starters import starter as starter
    from nhpocp.problem_file.variants import variant as variant

_HOMES = {
    "ProblemFile": "reading",
    "build": "reading",
    "build_solver": "building",
    "control_from_json": "building",
    "dump_problem": "dumping",
    "json_schema": "editor_schema",
    "load_problem": "reading",
    "parse_problem": "reading",
    "read": "reading",
    "read_text": "reading",
    "starter": "starters",
    "systems": "registry",
    "variant": "variants",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
