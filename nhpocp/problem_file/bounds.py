"""The `constraints` block made into bounds on named quantities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nhpocp.constraints import Bound
from nhpocp.errors import InvalidProblemError, refuse
from nhpocp.problem_file.constraints import Constraints
from nhpocp.systems.margins import sigma
from nhpocp.systems.system import System


def bounds_of(given: Constraints, system: System) -> list[Bound]:
    """The block as bounds on named quantities. Errors: `InvalidProblemError` for what the system cannot be asked."""
    wrong, bounds = [], []
    if given.clearance is not None and type(system).regularity is System.regularity:
        words = f"the system {system.model} has no legs, or what else becomes singular; remove it"
        wrong.append(InvalidProblemError(words, path="constraints.clearance", at_key=True))
    known = system.known_outputs
    for name in ("leg_length", "leg_speed"):
        if getattr(given, name) is not None and known is not None and "leg_lengths" not in known:
            words = f"the system {system.model} has no legs; remove it"
            wrong.append(InvalidProblemError(words, path=f"constraints.{name}", at_key=True))
    if isinstance(given.control, list) and len(given.control) != (inputs := system.input_space).size:
        words = f"{len(given.control)} pairs; expected {inputs.size}, one [lo, hi] per input"
        wrong.append(InvalidProblemError(f"{words} ({', '.join(inputs.labels)})", path="constraints.control"))
    refuse(wrong)
    if given.leg_length is not None:
        bounds.append(Bound("leg_length", "leg_lengths", *_sides(given.leg_length)))
    if given.leg_speed is not None:
        bounds.append(Bound("leg_speed", "u", -given.leg_speed, given.leg_speed))
    if given.control is not None:
        bounds += _control_bounds(given.control, system)
    if given.clearance is not None:
        bounds += [Bound(f"clearance.{name}", name, given.clearance) for name in _margins(system)]
    for name, bound in (given.state or {}).items():
        bounds.append(Bound(f"state.{name}", name, *_sides(bound)))
    return bounds


def _margins(system: System) -> list[str]:
    """Names of the distances from what is singular."""
    blocks = system.state_space.blocks
    somewhere = {b.name: np.eye(3) if b.kind == "rotation" else np.zeros(b.shape) for b in blocks}
    with np.errstate(all="ignore"):
        matrices = system.regularity(np.asarray(system.state_space.pack(somewhere)))
    return [sigma(matrix).name for matrix in matrices]


def _control_bounds(given: float | list[list[float | None]], system: System) -> list[Bound]:
    """One bound per input block; ``given`` counts single inputs."""
    blocks, bounds, first = system.input_space.blocks, [], 0
    for block in blocks:
        label = "control" if len(blocks) == 1 else f"control.{block.name}"
        if isinstance(given, list):
            pairs = given[first : first + block.size]
            columns = [[pair[side] for pair in pairs] for side in (0, 1)]
            low, high = _sides(columns if block.kind == "vector" else [column[0] for column in columns])
        else:
            low, high = -given, given
        bounds.append(Bound(label, block.name, low, high))
        first += block.size
    return bounds


def _sides(pair: Sequence[Any]) -> tuple[Any, Any]:
    """Lower and upper bounds; an open side is infinite."""

    def closed(value: Any, infinite: float) -> Any:
        if isinstance(value, list):
            return [closed(x, infinite) for x in value]
        return infinite if value is None else value

    return closed(pair[0], float("-inf")), closed(pair[1], float("inf"))
