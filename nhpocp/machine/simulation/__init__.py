"""A robot as bodies, joints and contacts in a physics engine; nothing here knows an equation of [Paper] section 2.

Begin with `playing.play`, which has a `machine.Machine` follow a plan; `building` says what that is made of, and
`base_joints` how each kind of joint is built. Loaded lazily, PEP 562.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nhpocp.machine.simulation.building import build as build
    from nhpocp.machine.simulation.machine import Machine as Machine
    from nhpocp.machine.simulation.machine import require_engine as require_engine
    from nhpocp.machine.simulation.playing import Simulation as Simulation
    from nhpocp.machine.simulation.playing import play as play
    from nhpocp.machine.simulation.second_opinion import opinion as opinion
    from nhpocp.machine.simulation.settings import MachineSettings as MachineSettings
    from nhpocp.machine.simulation.workshop import PhysicsWorkshop as PhysicsWorkshop

_HOMES = {
    "Machine": "machine",
    "MachineSettings": "settings",
    "PhysicsWorkshop": "workshop",
    "Simulation": "playing",
    "build": "building",
    "opinion": "second_opinion",
    "play": "playing",
    "require_engine": "machine",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
