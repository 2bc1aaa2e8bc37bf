"""Poses as a user writes them, values by the names of blocks, held against what a system has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError, describe
from nhpocp.frozen import FixedDict
from nhpocp.state_space import Block, StateSpace
from nhpocp.systems.system import System


def goal_blocks(system: System) -> list[Block]:
    """What a goal may be made of: the state's blocks and the outputs that depend on the pose alone."""
    return [*system.state_space.blocks, *system.pose_outputs]


def checked_start(
    space: StateSpace, values: Mapping[str, Any], wrong: list[InvalidProblemError]
) -> Mapping[str, Array]:
    """A value for every block of the start, as `_checked_values`."""
    before = len(wrong)
    checked = _checked_values(space.blocks, values, "start", wrong)
    if not isinstance(values, Mapping):
        return checked
    if not any(error.at_key for error in wrong[before:]):  # a name misspelt is one that is missing too
        wrong += [
            InvalidProblemError(f"required key is missing; expected {b.written}", path=f"start.{b.name}")
            for b in space.blocks
            if b.name not in values
        ]
    return checked


def checked_goal(
    system: System, values: Mapping[str, Any], part: str, wrong: list[InvalidProblemError]
) -> Mapping[str, Array]:
    """Values of a goal or via pose, as `_checked_values`: of some `goal_blocks`, no more numbers than the state has."""
    blocks, before = goal_blocks(system), len(wrong)
    if isinstance(values, Mapping) and not values:
        known = ", ".join(f"{block.name}: {block.written}" for block in blocks)
        wrong.append(InvalidProblemError(f"empty; expected some of {known}", path=part))
    checked = _checked_values(blocks, values, part, wrong)
    if not isinstance(values, Mapping):
        return checked
    count, room = sum(b.dimension for b in blocks if b.name in values), system.state_space.dimension
    if count > room and len(wrong) == before:
        words = f"fixes {count} numbers of a state that has {room}; leave out one of {', '.join(values)}"
        wrong.append(InvalidProblemError(words, path=part))
    return checked


def _checked_values(
    blocks: Sequence[Block], values: Mapping[str, Any], part: str, wrong: list[InvalidProblemError]
) -> Mapping[str, Array]:
    """Values by the names of blocks, frozen, as `Block.checked`; what cannot be one is added to ``wrong``."""
    names, checked = [block.name for block in blocks], {}
    if not isinstance(values, Mapping):
        shown = ", ".join(f"{block.name!r}: …" for block in blocks)
        wrong.append(
            InvalidProblemError(f"expected a mapping {{{shown}}}, got {describe(values)}", path=part)
        )
        return FixedDict()
    wrong += [
        InvalidProblemError("unknown key", path=f"{part}.{name}", word=str(name), known=names)
        for name in values
        if name not in names
    ]
    for block in blocks:
        if block.name in values:
            try:
                value = block.checked(values[block.name])
            except InvalidProblemError as error:
                wrong.append(error.under(f"{part}.{block.name}"))
                continue
            value.flags.writeable = False
            checked[block.name] = value
    return FixedDict(checked)
