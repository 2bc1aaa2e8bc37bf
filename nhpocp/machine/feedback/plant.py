"""The contract of a machine that plans are run on: three methods, which a robot's driver offers too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from nhpocp.arrays import Array
from nhpocp.systems.system import System


@runtime_checkable
class Plant(Protocol):
    """A machine: it can be measured, commanded, and given time. Whatever it raises ends the steering.

    Set-points, (n,), are what `System.actuator_positions` gives, the lengths of legs [length], or where a system has
    none its inputs [their units]; inputs are held until the next command, and zeros end a run. The first command that a
    machine is ever given names the place where its actuators stand (homing): set-points go on from there without jumps,
    from one run to the next as well, so that an offset of an encoder moves nothing.
    """

    def measure(self) -> Mapping[str, Any]:
        """A value for every block of the system's state, written as a problem's `start`."""
        ...

    def command(self, set_points: Array) -> None:
        """Where the actuators have to be at the end of the `advance` that follows, or the inputs during it."""
        ...

    def advance(self, seconds: float) -> None:
        """Lets the machine run for so long [time]; a driver waits."""
        ...


@runtime_checkable
class TrialPlant(Plant, Protocol):
    """A plant in a computer, which is known without noise too."""

    @property
    def system(self) -> System:
        """With its own parameters."""
        ...

    @property
    def point(self) -> Array:
        """The packed state (size,) as it is."""
        ...


class Workshop(Protocol):
    """Makes machines of one kind in a computer, each where its problem starts."""

    def made(self, system: System, gains: Array | None, seed: int | Sequence[int]) -> TrialPlant:
        """A machine that has this system's parameters, inputs times ``gains``, and noise of this seed."""
        ...

    @property
    def facts(self) -> Mapping[str, Any]:
        """What its machines have in common, as plain data."""
        ...
