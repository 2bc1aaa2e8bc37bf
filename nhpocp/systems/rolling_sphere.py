"""A sphere that rolls on the plane z = 0 without slipping."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, cross, namespace
from nhpocp.bodies import hull
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems.solids import ball, facet, great_circle
from nhpocp.systems.system import Parameter, System


class RollingSphere(System):
    r"""The plate-ball system on R² × SO(3), [Jurdjevic], driven by the velocity of the sphere's centre:

        ṗ = (u1, u2),   Ṙ = [ω] R,   ω = (-u2/ρ, u1/ρ, ω_z)

    p: the contact point, R: sphere to plane, ω in the plane's coordinates, ρ: the radius. The contact point of the
    sphere stands still. contact `rubber`: no spinning either, ω_z = 0; `marble`: ω_z is the third input.
    """

    model: ClassVar[str] = "rolling_sphere"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "contact": Parameter(
            "choice", "rubber", "rubber: no spinning; marble: spins as it likes", ("rubber", "marble")
        ),
        "radius": Parameter("positive", 1.0, "ρ", unit="length"),
    }
    example: ClassVar[Mapping[str, Any]] = {  # on the spot, turned
        "start": {"position": [0, 0], "orientation": {"rpy": [0, 0, 0]}},
        "goal": {"position": [0, 0], "orientation": {"rpy": [0, 0, "90 deg"]}},
        "control": {"harmonics": 2, "initial": [[0, 4, 0, 0, 0], [0, 0, 4, 0, 0]]},
    }
    state_space = StateSpace(
        [vector("position", 2, "length", symbol="p", words="position"), rotation("orientation")]
    )
    contact: str
    radius: float

    def __init__(self, contact: str = "rubber", radius: float = 1.0) -> None:
        super().__init__(contact=contact, radius=radius)
        spin = [scalar("omega_z", "angle")] if contact == "marble" else []
        self.input_space = StateSpace([scalar("u1", "length"), scalar("u2", "length"), *spin])

    def vector_fields(self, state: Array) -> Array:
        turn, spins = 1.0 / self.radius, self.input_space.size == 3
        rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -turn, 0.0], [turn, 0.0, 0.0], [0.0, 0.0, 1.0]]
        return namespace(state).matrix([row if spins else row[:2] for row in rows])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The velocity of the sphere's lowest point, and for rubber its spin."""
        xp = namespace(state, velocity)
        centre = xp.vector([velocity[0], velocity[1], 0.0 * velocity[0]])
        slip = centre + cross(velocity[2:5], xp.array([0.0, 0.0, -self.radius]))
        return slip[:2] if self.input_space.size == 3 else xp.concatenate([slip[:2], velocity[4]])

    def default_length_scale(self) -> float:
        return self.radius

    def bodies(self, state: Array) -> dict[str, hull.Hull]:
        return {"sphere": hull.ball(namespace(state).vector([state[0], state[1], self.radius]), self.radius)}

    def drawing(self, state: Array) -> dict[str, Any]:
        """The sphere's three great circles, one octant of it, and where it touches."""
        xp, values = namespace(state), self.state_space.unpack(state)
        p, turned = values["position"], values["orientation"]
        centre = xp.vector([p[0], p[1], self.radius])
        touching = xp.vector([p[0], p[1], 0.0])
        lines = {f"circle {i + 1}": great_circle(centre, turned, i, self.radius) for i in range(3)}
        lines["octant"] = facet(centre, turned, self.radius, bend=8)
        solids = {"sphere": ball(centre, turned, self.radius, "circle", "octant")}
        return {
            "lines": lines,
            "points": {"contact": xp.rows([touching])},
            "trace": touching,
            "solids": solids,
        }
