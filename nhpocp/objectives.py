"""What a plan can cost: integrals over the motion, said once for every solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nhpocp.arrays import Array, dot, namespace, norm
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.system import System

Integrand = Callable[..., Any]  # (system, x, u, length_scale) ↦ the expression to integrate over time


def effort(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """|control|²: of v for the feedback-transformed robot, [Paper] eq. (7)."""
    return dot(control, control)


def leg_effort(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """|u|² of the leg speeds, [length²/time²]."""
    speeds = quantity(system, "u", state, control)
    return dot(speeds, speeds)


def path_length(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """√(|ṗ|² + (length_scale |ω|)²), the speed of the pose [length/time]; angles count by length_scale."""
    xp, space = namespace(state, control), system.state_space
    weights = [length_scale if b.unit == "angle" else 1.0 for b in space.blocks for _ in range(b.dimension)]
    return norm(xp.array(weights) * system.velocity(state, control))


INTEGRANDS: dict[str, Integrand] = {"effort": effort, "leg_effort": leg_effort, "path_length": path_length}


def quantity(system: System, name: str, state: Array, control: Array) -> Array:
    """A state block, an input or an output by name. Errors: `InvalidProblemError` naming what there is."""
    inputs = system.input_space.unpack(control)
    if name in inputs:
        return inputs[name]
    values = system.state_space.unpack(state)
    if name in values:
        return values[name]
    try:
        return system.output(name, state, control)
    except KeyError:
        known = [*inputs, *values, *system.outputs(state, control)]
        raise InvalidProblemError(f"no quantity {name!r} here; there are {', '.join(known)}") from None


def available(system: System) -> list[str]:
    """The integrands that this system has: leg_effort needs leg speeds."""
    return [name for name in INTEGRANDS if name != "leg_effort" or hasattr(system, "legs")]
