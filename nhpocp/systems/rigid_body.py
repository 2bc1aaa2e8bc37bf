"""A free rigid body turned by torques: attitude with drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any, ClassVar

from nhpocp.arrays import Array, cross, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, rotation, vector
from nhpocp.systems.solids import body_axes, cuboid
from nhpocp.systems.system import Parameter, System


class RigidBody(System):
    r"""Euler's equations and the attitude on SO(3) × R³, [Bilimoria & Wie]:

        Ṙ = R [Ω],   I Ω̇ = τ - Ω × I Ω

    R: body to space, Ω: the angular velocity and τ: the torques about the principal axes, both in the body. With drift:
    a spinning body goes on spinning. About a principal axis alone it is a double integrator.
    """

    model: ClassVar[str] = "rigid_body"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "inertia": Parameter("vector", [1.2, 1.0, 0.6], "I, the three principal moments; each > 0")
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"orientation": {"rpy": [0, 0, 0]}, "omega": [0, 0, 0]},
        "goal": {"orientation": {"rpy": ["90 deg", 0, 0]}, "omega": [0, 0, 0]},
        "control": {"harmonics": 1, "initial": [[0, 8, 0], [0, 0, 0], [0, 0, 0]]},
    }
    state_space = StateSpace(
        [rotation("orientation"), vector("omega", 3, "angle", symbol=r"\Omega", rate=True)]
    )
    input_space = StateSpace([vector("torque", 3, symbol=r"\tau")])
    inertia: tuple[float, ...]

    def __init__(self, inertia: Sequence[float] = (1.2, 1.0, 0.6)) -> None:
        super().__init__(inertia=inertia)
        if not all(moment > 0 for moment in self.inertia):
            raise InvalidProblemError("expected three moments > 0", path="system.inertia")

    def vector_fields(self, state: Array) -> Array:
        xp = namespace(state)
        torques = [
            [1.0 / moment if i == k else 0.0 for k in range(3)] for i, moment in enumerate(self.inertia)
        ]
        return xp.block([[xp.array([[0.0] * 3] * 3)], [xp.array(torques)]])

    def drift(self, state: Array) -> Array:
        xp, values = namespace(state), self.state_space.unpack(state)
        omega, moments = values["omega"], xp.array(list(self.inertia))
        gyration = cross(moments * omega, omega)
        return xp.concatenate([values["orientation"] @ omega, gyration / moments])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The attitude's own rate, seen from the body, against Ω."""
        values = self.state_space.unpack(state)
        return values["orientation"].T @ velocity[:3] - values["omega"]

    def drawing(self, state: Array) -> dict[str, Any]:
        """The cuboid that has these moments of inertia, to a scale, and its axes; a corner of it is followed."""
        turned, centre = self.state_space.unpack(state)["orientation"], 0.0 * state[:3]
        total = sum(self.inertia)
        squares = [max(total - 2.0 * moment, 0.01 * total) for moment in self.inertia]
        half = [0.8 * sqrt(square / max(squares)) for square in squares]
        lines = {**cuboid(centre, turned, half), **body_axes(centre, turned, 1.1)}
        corner = sum(half[i] * turned[:, i] for i in range(3))
        return {"lines": lines, "points": {"corner": namespace(state).rows([corner])}, "trace": corner}
