"""The friction-drive wrist: two motors on the arm turn a ball, and with it a hand, to any orientation."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, sin
from typing import Any, ClassVar

from nhpocp.arrays import Array, cross, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, rotation, scalar
from nhpocp.systems.solids import ball, disc, facet, great_circle, rod
from nhpocp.systems.system import Parameter, System


class FrictionDriveWrist(System):
    r"""The wrist of [Stammers, Prest & Mobley] on SO(3): two rollers touch a ball on its equator, axles level.

        ρ (ω × n_i)·ẑ = r u_i,   (ω × n_i)·(ẑ × n_i) = 0,   n_i = (cos α_i, sin α_i, 0),   Ṙ = [ω] R

    u_i: the rollers' speeds, r and ρ: the radii of rollers and ball, α_i: where they touch, at ± half of `spread`. A
    roller moves the surface up and down and holds it along the equator: ω_z = 0. The ball is a Veselova joint, driven.
    """

    model: ClassVar[str] = "friction_drive_wrist"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "ball_radius": Parameter("positive", 1.0, "ρ, of the ball", unit="length"),
        "roller_radius": Parameter("positive", 0.25, "r, of the rollers", unit="length"),
        "spread": Parameter(
            "number", pi / 2, "angle between the rollers' contacts; not a multiple of 180°", unit="angle"
        ),
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"orientation": {"rpy": [0, 0, 0]}},
        "goal": {"orientation": {"rpy": [0, 0, "60 deg"]}},
        "control": {"harmonics": 1, "initial": [[0, 8, 0], [0, 0, 8]]},
    }
    state_space = StateSpace([rotation("orientation")])
    input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle")])
    ball_radius: float
    roller_radius: float
    spread: float

    def __init__(self, ball_radius: float = 1.0, roller_radius: float = 0.25, spread: float = pi / 2) -> None:
        super().__init__(ball_radius=ball_radius, roller_radius=roller_radius, spread=spread)
        if abs(sin(self.spread)) < 1e-6:
            words = "the rollers turn the ball about the same axis; expected another angle"
            raise InvalidProblemError(words, path="system.spread")

    def vector_fields(self, state: Array) -> Array:
        """(ω × n)·ẑ = ω_x sin α - ω_y cos α at α = ±spread/2, solved for ω."""
        ratio, half = self.roller_radius / self.ball_radius, 0.5 * self.spread
        x, y = 0.5 * ratio / sin(half), -0.5 * ratio / cos(half)
        return namespace(state).array([[-x, x], [y, y], [0.0, 0.0]])

    def _contacts(self) -> list[tuple[float, float, float]]:
        return [(cos(a), sin(a), 0.0) for a in (-0.5 * self.spread, 0.5 * self.spread)]

    def constraints(self, state: Array, velocity: Array) -> Array:
        """How fast the surface slides along a roller's axle: the same at both."""
        xp = namespace(state, velocity)
        n = xp.array(list(self._contacts()[0]))
        slip = cross(velocity, n)
        return xp.vector([n[0] * slip[1] - n[1] * slip[0]])

    def default_length_scale(self) -> float:
        return self.ball_radius

    def drawing(self, state: Array) -> dict[str, Any]:
        """The ball with the hand on it, and the two rollers at its equator."""
        xp, size = namespace(state), self.ball_radius
        turned = self.state_space.unpack(state)["orientation"]
        centre, tip = 0.0 * turned[:, 2], 1.8 * size * turned[:, 2]
        lines = {f"circle {i + 1}": great_circle(centre, turned, i, size) for i in range(3)}
        lines |= {"octant": facet(centre, turned, size, bend=8), "hand": xp.rows([size * turned[:, 2], tip])}
        solids = {
            "ball": ball(centre, turned, size, "circle", "octant"),
            "hand": rod(size * turned[:, 2], tip, 0.08 * size),
        }
        for i, contact in enumerate(self._contacts()):
            n = xp.array(list(contact))
            middle, axle = (size + self.roller_radius) * n, xp.array([-contact[1], contact[0], 0.0])
            thick = 0.5 * self.roller_radius * axle
            lines[f"roller {i + 1}"] = disc(middle, axle, self.roller_radius)
            solids[f"roller {i + 1}"] = rod(middle - thick, middle + thick, self.roller_radius)
        return {"lines": lines, "points": {}, "trace": tip, "solids": solids}
