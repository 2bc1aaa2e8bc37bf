"""The passive sphere: a ball held by steered rollers, which a hand pushes and the rollers guide."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, sin
from typing import Any, ClassVar

from nhpocp.arrays import Array, cross, dot, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems.solids import ball, disc, facet, great_circle, rod
from nhpocp.systems.system import Parameter, System

AZIMUTHS = (0.0, 2 * pi / 3, -2 * pi / 3)  # of the rollers, seen from above


class PassiveSphere(System):
    r"""The programmable constraint of [Peshkin, Colgate & Moore] on SO(3) × R²:

        α̇_1, α̇_2 and u3 are the inputs,   Ṙ = [ω] R,   ω = u3 c_1 × c_2,   c_i = n_i × w_i(α_i)

    Three rollers touch the ball at n_i, at an angle `polar` from straight down; w_i, in the tangent plane, is the axle
    of roller i, steered by α_i from the meridian. A roller keeps the ball from sliding along its axle: ω·c_i = 0. Three
    rollers at random lock it; two leave one axis to turn about, and the third is steered to allow it: `alpha3`.
    """

    model: ClassVar[str] = "passive_sphere"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "polar": Parameter(
            "number", pi / 3, "angle of the rollers from straight down, between 0 and 180°", unit="angle"
        ),
        "radius": Parameter("positive", 1.0, "of the ball; it is drawn by it", unit="length"),
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"orientation": {"rpy": [0, 0, 0]}, "alpha": [0, "90 deg"]},
        "goal": {"orientation": {"rpy": ["30 deg", "20 deg", "40 deg"]}, "alpha": [0, "90 deg"]},
        "control": {"harmonics": 2},
    }
    state_space = StateSpace([rotation("orientation"), vector("alpha", 2, "angle", symbol=r"\alpha")])
    input_space = StateSpace(
        [
            scalar("alpha1_dot", "angle", symbol=r"\dot\alpha_1"),
            scalar("alpha2_dot", "angle", symbol=r"\dot\alpha_2"),
            scalar("u3", "angle", symbol="u_3"),
        ]
    )
    output_blocks = (scalar("alpha3", "angle", symbol=r"\alpha_3", words="third roller", wraps=True),)
    polar: float
    radius: float

    def __init__(self, polar: float = pi / 3, radius: float = 1.0) -> None:
        super().__init__(polar=polar, radius=radius)
        if not 0 < self.polar < pi:
            raise InvalidProblemError("expected an angle between 0 and 180 deg", path="system.polar")

    def _frame(self, i: int) -> tuple[Array, Array, Array]:
        """Where roller i touches, and the tangents along the meridian (upwards) and along the parallel."""
        xp, a, p = namespace(), AZIMUTHS[i], self.polar
        n = xp.array([sin(p) * cos(a), sin(p) * sin(a), -cos(p)])
        return n, xp.array([cos(p) * cos(a), cos(p) * sin(a), sin(p)]), xp.array([-sin(a), cos(a), 0.0])

    def axle(self, i: int, angle: Array) -> Array:
        """w_i, the unit vector (3,) along the axle of roller i."""
        xp, (_, up, sideways) = namespace(angle), self._frame(i)
        return xp.cos(angle) * up + xp.sin(angle) * sideways

    def normal(self, i: int, angle: Array) -> Array:
        """c_i, the axis (3,) about which roller i keeps the ball from turning."""
        xp, (_, up, sideways) = namespace(angle), self._frame(i)
        return xp.sin(angle) * up - xp.cos(angle) * sideways

    def _axis(self, state: Array) -> Array:
        alpha = self.state_space.unpack(state)["alpha"]
        return cross(self.normal(0, alpha[0]), self.normal(1, alpha[1]))

    def vector_fields(self, state: Array) -> Array:
        xp, axis = namespace(state), self._axis(state)
        turning = [[0.0, 0.0, axis[i]] for i in range(3)]
        return xp.matrix([*turning, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """How fast the surface slides along the two axles."""
        xp, alpha = namespace(state, velocity), self.state_space.unpack(state)["alpha"]
        surface = [cross(velocity[:3], self._frame(i)[0]) for i in range(2)]
        return xp.vector([dot(surface[i], self.axle(i, alpha[i])) for i in range(2)])

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        """How the third roller has to be steered: c_3·(c_1 × c_2) = 0."""
        xp, axis, (_, up, sideways) = namespace(state), self._axis(state), self._frame(2)
        return {"alpha3": xp.arctan2(dot(sideways, axis), dot(up, axis))}

    def drawing(self, state: Array) -> dict[str, Any]:
        """The ball, and the rollers under it as they are steered."""
        size, values = self.radius, self.state_space.unpack(state)
        turned, alpha = values["orientation"], values["alpha"]
        centre = 0.0 * turned[:, 2]
        lines = {f"circle {i + 1}": great_circle(centre, turned, i, size) for i in range(3)}
        lines["octant"] = facet(centre, turned, size, bend=8)
        solids = {"ball": ball(centre, turned, size, "circle", "octant")}
        steered = [alpha[0], alpha[1], self.outputs(state, state[:3])["alpha3"]]
        for i, angle in enumerate(steered):
            middle, axle = 1.3 * size * self._frame(i)[0], self.axle(i, angle)
            lines[f"roller {i + 1}"] = disc(middle, axle, 0.3 * size)
            solids[f"roller {i + 1}"] = rod(
                middle - 0.08 * size * axle, middle + 0.08 * size * axle, 0.3 * size
            )
        return {"lines": lines, "points": {}, "trace": size * turned[:, 2], "solids": solids}
