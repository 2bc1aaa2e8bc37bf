"""What may cost something or be bounded, by the name that a trajectory has for it."""

from __future__ import annotations

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS, leg_accelerations
from nhpocp.systems.system import System


def quantity(
    system: System, name: str, state: Array, control: Array, control_rate: Array | None = None
) -> Array:
    """A state block, an input or an output by name.

    control_rate: du/dt, for accelerations of the legs, which are for symbols only.
    Errors: `InvalidProblemError` naming what there is.
    """
    if name == LEG_ACCELERATIONS and control_rate is not None:
        return leg_accelerations(system, state, control, control_rate)
    inputs = system.input_space.unpack(control)
    if name in inputs:
        return inputs[name]
    values = system.state_space.unpack(state)
    if name in values:
        return values[name]
    try:
        return system.quantity(name, state, control)
    except KeyError:
        known = [*inputs, *values, *system.quantities(state, control)]
        raise InvalidProblemError(f"no quantity {name!r} here; there are {', '.join(known)}") from None
