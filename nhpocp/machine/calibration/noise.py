"""How far measurements scatter: what is said of it, or what the residuals say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.written_numbers import parse_number

PATH = "--noise"
LIKELY = 1e-3  # of the robot's length, and of a radian, to begin with
LEAST = 1e-8  # likewise: what is exact is taken to be no better
KINDS = ("position", "angle", "leg_length")


@dataclass(frozen=True)
class Noise:
    """Standard deviations of positions [length], of orientations [rad] and of leg lengths [length]."""

    position: float
    angle: float
    leg_length: float

    @classmethod
    def parsed(cls, text: str | Sequence[float]) -> Noise:
        """From "0.01,0.1deg" or "0.01,0.1deg,0.005"; leg lengths scatter like positions unless said.

        Errors: `InvalidProblemError` for what is no two or three numbers > 0.
        """
        parts = text.split(",") if isinstance(text, str) else list(text)
        try:
            numbers = [_number(part) for part in parts]
        except ValueError as error:
            raise InvalidProblemError(f"{error}; expected POSITION,ANGLE[,LEG]", path=PATH) from None
        if not 2 <= len(numbers) <= 3 or min(numbers) <= 0:
            words = "expected POSITION,ANGLE[,LEG], standard deviations > 0 such as 0.01,0.1deg"
            raise InvalidProblemError(words, path=PATH)
        return cls(numbers[0], numbers[1], numbers[-1] if len(numbers) == 3 else numbers[0])

    @classmethod
    def likely(cls, system: ParallelRobot, factor: float = LIKELY) -> Noise:
        length = system.default_length_scale()
        return cls(factor * length, factor, factor * length)

    def of_rows(self, kinds: Array) -> Array:
        """For rows that are of these `KINDS`, as numbers."""
        return np.array([self.position, self.angle, self.leg_length])[kinds]

    def ratios(self, other: Noise) -> Array:
        """Another's over this one's, (3,)."""
        return np.array([getattr(other, kind) / getattr(self, kind) for kind in KINDS])

    def scaled(self, factors: Array, least: Noise) -> Noise:
        """Each times its factor."""
        values = [
            float(max(getattr(self, k) * f, getattr(least, k))) for k, f in zip(KINDS, factors, strict=True)
        ]
        return Noise(*values)


def kinds_of(system: ParallelRobot) -> Array:
    """Of the rows of a sample, (d + m,): indices of `KINDS`."""
    units = system.state_space.tangent_units
    return np.array(
        [KINDS.index("angle" if unit == "angle" else "position") for unit in units] + [2] * system.motors
    )


def _number(part: object) -> float:
    if not isinstance(part, str):
        return real(part, PATH)
    text = part.strip()
    if text.endswith("deg"):
        return parse_number(f"{text[:-3].strip()} deg")
    try:
        return parse_number(float(text))
    except ValueError:
        return parse_number(text)
