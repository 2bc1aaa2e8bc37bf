"""The trident snake: a plate on three links with a wheel each, that wriggles wherever it likes."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.bodies import hull
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.planar import across, along, link, wheel
from nhpocp.systems.system import Parameter, System

AZIMUTHS = (0.0, 2 * pi / 3, -2 * pi / 3)  # of the links' joints on the plate


class TridentSnake(System):
    r"""The trident snake robot on R³ × R³, [Ishikawa]:

        φ̇_i = -(-ẋ sin β_i + ẏ cos β_i + (l + r cos φ_i) θ̇) / l,   β_i = θ + α_i + φ_i,   α = (0, ±120°)

    (x, y, θ): the pose of the plate of radius r, φ_i: the angle of link i about its joint at azimuth α_i, l: from the
    joint to the wheel, which does not slip across the link. The joints' motors drive it; where the three wheels' axes
    allow, they turn the plate as the inputs say. Growth vector (3, 6), like the robot's of the paper.
    """

    model: ClassVar[str] = "trident_snake"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "link": Parameter("positive", 1.0, "l, from each joint to its wheel", unit="length"),
        "radius": Parameter("positive", 1.0, "r, of the joints on the plate", unit="length"),
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "theta": 0, "phi": [0, 0, 0]},
        "goal": {"x": 0.3, "y": 0.2, "theta": 0, "phi": [0, 0, 0]},
        "control": {"harmonics": 2},
    }
    state_space = StateSpace(
        [
            scalar("x", "length"),
            scalar("y", "length"),
            scalar("theta", "angle", symbol=r"\theta"),
            vector("phi", 3, "angle", symbol=r"\varphi"),
        ]
    )
    input_space = StateSpace(
        [
            scalar("x_dot", "length", symbol=r"\dot x"),
            scalar("y_dot", "length", symbol=r"\dot y"),
            scalar("theta_dot", "angle", symbol=r"\dot\theta"),
        ]
    )
    link: float
    radius: float

    def __init__(self, link: float = 1.0, radius: float = 1.0) -> None:
        super().__init__(link=link, radius=radius)

    def vector_fields(self, state: Array) -> Array:
        xp, length = namespace(state), self.link
        rows = []
        for i, azimuth in enumerate(AZIMUTHS):
            phi = state[3 + i]
            beta = state[2] + azimuth + phi
            rows.append(
                [xp.sin(beta) / length, -xp.cos(beta) / length, -1.0 - self.radius / length * xp.cos(phi)]
            )
        return xp.block([[xp.eye(3)], [xp.matrix(rows)]])

    def _joints(self, state: Array) -> list[tuple[Array, Array]]:
        """Of each link its joint's place relative to the plate's centre, and its heading."""
        places = [self.radius * along(state[2] + azimuth) for azimuth in AZIMUTHS]
        return [
            (place, state[2] + a + state[3 + i])
            for i, (place, a) in enumerate(zip(places, AZIMUTHS, strict=True))
        ]

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The speed of each wheel across its link."""
        slips = []
        for i, (place, beta) in enumerate(self._joints(state)):
            joint = velocity[:2] + velocity[2] * namespace(place).vector([-place[1], place[0]])
            wheel = joint + self.link * (velocity[2] + velocity[3 + i]) * across(beta)
            slips.append(dot(wheel, across(beta)))
        return namespace(state, velocity).vector(slips)

    def default_length_scale(self) -> float:
        return self.radius

    def bodies(self, state: Array) -> dict[str, hull.Hull]:
        here, bodies = state[:2], {"plate": hull.ball(state[:2], self.radius)}
        for i, (place, beta) in enumerate(self._joints(state), start=1):
            bar = hull.capsule(here + place, here + place + self.link * along(beta), 0.06 * self.link)
            bodies[f"link {i}"] = bar.touching("plate")
        return bodies

    def drawing(self, state: Array) -> dict[str, Any]:
        """The plate, and three links with the wheels at their ends."""
        xp, here, joints = namespace(state), state[:2], self._joints(state)
        around = [self.radius * along(state[2] + 2 * pi * k / 36) for k in range(37)]
        lines = {"plate": xp.rows([here + place for place in around])}
        for i, (place, beta) in enumerate(joints):
            end = here + place + self.link * along(beta)
            lines[f"link {i + 1}"] = link(here + place, end, 0.06 * self.link)
            lines[f"wheel of link {i + 1}"] = wheel(end, beta, 1.4 * self.link)
        return {
            "lines": lines,
            "points": {"joints": xp.rows([here + place for place, _ in joints])},
            "trace": here,
        }
