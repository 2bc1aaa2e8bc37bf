"""Accelerations of the legs, the one quantity of a trajectory that takes the control's derivative."""

from __future__ import annotations

from typing import Any

from nhpocp.arrays import Array, symbolic
from nhpocp.state_space import Block, vector

LEG_ACCELERATIONS = "leg_accelerations"
SPEEDS = "u"  # what the legs' speeds are called, an input or an output


def acceleration_blocks(system: Any) -> tuple[Block, ...]:
    """Their block; none of systems whose legs have no speeds."""
    blocks = *system.input_space.blocks, *(system.output_blocks or ())
    legs = next((block.components for block in blocks if block.name == SPEEDS), 0)
    known = "leg_lengths" in (system.known_outputs or ())
    words = {"symbol": r"\dot u", "words": "leg acceleration"}
    return (vector(LEG_ACCELERATIONS, legs, "length", rate=2, **words),) if legs and known else ()


def leg_accelerations(system: Any, state: Array, control: Array, control_rate: Array) -> Array:
    """u̇ = ∂u/∂x ẋ + ∂u/∂v v̇ along a motion, (legs,), for SX symbols; u(x, v): the legs' speeds, v̇: ``control_rate``."""
    if SPEEDS in system.input_space.names:
        return system.input_space.unpack(control_rate)[SPEEDS]
    xp = symbolic()
    x, v, v_rate = (
        xp.symbol(space.size) for space in (system.state_space, system.input_space, system.input_space)
    )
    speeds = system.quantity(SPEEDS, x, v)
    moving, motion = xp.concatenate([x, v]), xp.concatenate([system.rate(x, v), v_rate])
    rate = xp.along(speeds, moving, motion)
    given = xp.concatenate([state, control, control_rate])  # which may be expressions
    return xp.substitute(rate, xp.concatenate([x, v, v_rate]), given)
