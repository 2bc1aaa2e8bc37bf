"""What a plan can cost: integrals over the motion, said once for every solver, and what is smooth in their place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nhpocp.arrays import Array, dot, namespace, norm
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.system import System

Integrand = Callable[..., Any]  # (system, x, u, length_scale) ↦ the expression to integrate over time
# speeds below which a search takes path_length for its square, as shares of the problem's length over its duration
SOFTENINGS = (1.0, 0.1, 0.05)


def effort(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """|control|²: of v for the feedback-transformed robot, [Paper] eq. (7)."""
    return dot(control, control)


def leg_effort(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """|u|² of the leg speeds, [length²/time²]."""
    speeds = quantity(system, "u", state, control)
    return dot(speeds, speeds)


def path_length(system: System, state: Array, control: Array, length_scale: float) -> Array:
    """√(|ṗ|² + (length_scale |ω|)²), the speed of the pose [length/time]; angles count by length_scale."""
    return norm(_pose_speeds(system, state, control, length_scale))


def _pose_speeds(system: System, state: Array, control: Array, length_scale: float) -> Array:
    xp, space = namespace(state, control), system.state_space
    weights = [length_scale if b.unit == "angle" else 1.0 for b in space.blocks for _ in range(b.dimension)]
    return xp.array(weights) * system.velocity(state, control)


def softened_path_length(
    system: System, state: Array, control: Array, length_scale: float, rest: Any
) -> Array:
    """√(speed² + rest²) - rest, written so that nothing cancels: what stands for `path_length` in a search.

    The length has no derivative at rest, and no second one along the many paces of one path: with them a minimiser gets
    stuck, or wanders. This has both, is 0 at rest, and is least for the same path at an even pace wherever the pace is
    free; elsewhere it is less than the length by at most ``rest`` times the duration.
    """
    velocity = _pose_speeds(system, state, control, length_scale)
    squared = dot(velocity, velocity)
    return squared / (namespace(state, control).sqrt(squared + rest * rest) + rest)


def searched(
    name: str, system: System, state: Array, control: Array, length_scale: float, rest: Any
) -> Array:
    """The integrand that a solver differentiates for an objective: smooth everywhere."""
    if name == "path_length":
        return softened_path_length(system, state, control, length_scale, rest)
    return INTEGRANDS[name](system, state, control, length_scale)


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
