"""What may be said of a machine beside its geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from nhpocp.constructed import Constructed
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError


@dataclass(frozen=True)
class MachineSettings(Constructed):
    """What may be said of a machine beside its geometry, in SI units.

    gravity: [m/s²], along -z of the base. payload: a point mass at the platform's origin [kg]. friction: of rollers on
    balls, Coulomb's coefficient. press: the force by which a roller is held against its ball [N]. stiffness, damping:
    of the motors' position servos [N/m, N s/m]. noise: standard deviations of the measured position [length] and
    orientation [rad]. latency: from a command until the servos have it [s]. seed: of the noise. errors: by how much the
    machine's parameters differ from the model's, as `ModelErrors` reads it: "roller_tilt=2deg,base_radius=1%". Errors:
    `InvalidProblemError` for what is none.
    """

    gravity: float = 0.0
    payload: float = 0.0
    friction: float = 3.0
    press: float = 50.0
    stiffness: float = 2e4
    damping: float = 200.0
    noise: tuple[float, float] = (0.0, 0.0)
    latency: float = 0.0
    seed: int | Sequence[int] = 0
    errors: str = ""

    def __post_init__(self) -> None:
        for name in ("gravity", "payload", "friction", "press", "stiffness", "damping", "latency"):
            value = real(getattr(self, name), name)
            positive = name in ("friction", "press", "stiffness")
            if not isfinite(value) or (value <= 0 if positive else value < 0):
                words = f"{value:g}; expected a number {'> 0' if positive else '>= 0'}"
                raise InvalidProblemError(words, path=name)
            object.__setattr__(self, name, value)
        if len(self.noise) != 2 or min(self.noise) < 0:
            raise InvalidProblemError(f"{self.noise}; expected two numbers >= 0", path="noise")

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {**values, "noise": list(self.noise)}
