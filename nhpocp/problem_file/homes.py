"""Where a key belongs that stands somewhere else, such as `gamma` without `solvers.jacobian`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from nhpocp.problem_file import control, settings
from nhpocp.problem_file.schema import Constraints, Output, ProblemData
from nhpocp.systems.system import System


def homes(word: str, raw: Mapping[str, Any], system: System | None) -> list[str]:
    """The whole paths at which ``word`` is a key of a file with this data; ``system``: None where it is unknown."""
    return [path for path in _paths(raw, system) if path.rpartition(".")[2] == word]


def _paths(raw: Mapping[str, Any], system: System | None) -> Iterator[str]:
    yield from ProblemData.model_fields
    block = raw.get("control")
    basis = block.get("basis", control.DEFAULT) if isinstance(block, dict) else control.DEFAULT
    blocks: dict[str, Any] = {"constraints": Constraints, "output": Output, "solvers": settings.Solvers}
    if isinstance(basis, str) and basis in control.BLOCKS:
        blocks["control"] = control.BLOCKS[basis]
    blocks |= {f"solvers.{name}": block for name, block in settings.BLOCKS.items()}
    for name, model in blocks.items():
        yield from (f"{name}.{key}" for key in model.model_fields)
    if system is not None:
        yield from (f"system.{key}" for key in ("model", "preset", *system.declared))
        states = [block.name for block in system.state_space.blocks]
        yield from (f"{end}.{name}" for name in states for end in ("start", "goal"))
        yield from (f"goal.{block.name}" for block in system.pose_outputs)
