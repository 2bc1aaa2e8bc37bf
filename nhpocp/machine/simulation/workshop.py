"""Machines of bodies, joints and contacts, made one like the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from nhpocp.arrays import Array
from nhpocp.machine.simulation.building import as_robot
from nhpocp.machine.simulation.machine import Machine
from nhpocp.machine.simulation.settings import MachineSettings
from nhpocp.systems.system import System


@dataclass(frozen=True)
class PhysicsWorkshop:
    """A `Workshop` of `Machine`s with one start and settings, whose errors and seed do not count."""

    start: Mapping[str, Any]
    settings: MachineSettings

    def made(self, system: System, gains: Array | None, seed: int | Sequence[int]) -> Machine:
        """Motors that are told lengths have no gains. Errors: as of `Machine`."""
        return Machine(as_robot(system), self.start, replace(self.settings, seed=seed))

    @property
    def facts(self) -> dict[str, Any]:
        own = self.settings.to_json()
        return {"kind": "physics", **{name: own[name] for name in own if name not in ("errors", "seed")}}
