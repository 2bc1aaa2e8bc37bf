"""Where a key belongs that stands somewhere else, such as `gamma` without `solvers.jacobian`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from nhpocp.problem_file import control, settings
from nhpocp.problem_file.schema import Constraints, Output, ProblemData
from nhpocp.systems.system import System

BOXES = "constraints.state."  # of quantities by name


def homes(word: str, place: str, raw: Mapping[str, Any], system: System | None) -> list[str]:
    """The whole paths at which ``word`` is a key of a file with this data; ``system``: None where it is unknown.

    ``place``: where it is none. Those in the same block come before all others; what stands in a list, such as an
    obstacle, has keys of its own, and belongs at most among the constraints.
    """
    found = [path for path in paths(raw, system) if path.rpartition(".")[2] == word and path != place]
    if "[" in place:
        found = [path for path in found if path.startswith("constraints.")]
    beside = [path for path in found if path.startswith(f"{place.partition('.')[0]}.")]
    return beside or [path for path in found if not path.startswith(BOXES)]


def paths(raw: Mapping[str, Any], system: System | None) -> Iterator[str]:
    """Whole paths of the keys that a file with this data may have; ``system``: None where it is unknown."""
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
        yield from (f"{BOXES}{name}" for name in states)
        yield from (f"goal.{block.name}" for block in system.pose_outputs)
