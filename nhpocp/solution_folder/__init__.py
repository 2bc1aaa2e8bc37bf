"""Solutions as folders: written whole or not at all, read back without executing anything they contain.

problem.yaml, solution.json, trajectory.csv, arrays.npz, solver.log, iterations.csv on request, and the pictures.
Loaded lazily, PEP 562.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.solution_folder.auditing import audit as audit
    from nhpocp.solution_folder.plain_data import plain as plain
    from nhpocp.solution_folder.plain_data import to_json as to_json
    from nhpocp.solution_folder.reading import load_solution as load_solution
    from nhpocp.solution_folder.target import check_target as check_target
    from nhpocp.solution_folder.target import folder_name as folder_name
    from nhpocp.solution_folder.target import is_solution_folder as is_solution_folder
    from nhpocp.solution_folder.target import unwritable as unwritable
    from nhpocp.solution_folder.writing import save_solution as save_solution
    from nhpocp.solution_folder.writing import store_solution as store_solution

_HOMES = {
    "audit": "auditing",
    "check_target": "target",
    "folder_name": "target",
    "is_solution_folder": "target",
    "load_solution": "reading",
    "plain": "plain_data",
    "save_solution": "writing",
    "store_solution": "writing",
    "to_json": "plain_data",
    "unwritable": "target",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
