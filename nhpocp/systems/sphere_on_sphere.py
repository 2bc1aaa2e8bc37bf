"""A ball that rolls on a fixed ball, without slipping."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, cross, dot, namespace
from nhpocp.bodies import hull
from nhpocp.state_space import StateSpace, direction, rotation, scalar, vector
from nhpocp.systems.solids import ball, facet, great_circle
from nhpocp.systems.system import Parameter, System


class SphereOnSphere(System):
    r"""A ball of radius one that rolls on a fixed ball of radius ρ, on S² × SO(3), [Koiller & Ehlers]:

        γ̇ = u1 e_1 + u2 e_2,   Ṙ = [ω] R,   ω = (ρ + 1) γ × γ̇ + ω_γ γ

    γ: the unit vector from the fixed ball's centre to the rolling one's, e_1, e_2: orthonormal tangents of the sphere
    at γ, along the coordinate lines of s. contact `rubber`: no spinning about γ, ω_γ = 0; `marble`: ω_γ is the
    third input. The state's `contact_point` s = (s_1, s_2) is the stereographic projection of γ from the lowest point,
    γ = (2 s_1, 2 s_2, 1 - |s|²)/(1 + |s|²): the top is s = 0, the equator |s| = 1, and only the lowest point has none.
    Rubber at ρ = 1 is integrable, R = (2γγᵀ - 1)(2γ_0γ_0ᵀ - 1) R_0: the orientation follows from the place. Elsewhere
    the growth vector is (2, 3, 5), at ρ = 3 (or 1/3) with the exceptional Lie algebra G₂ as symmetries.
    """

    model: ClassVar[str] = "sphere_on_sphere"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "ratio": Parameter("positive", 3.0, "ρ, radius of the fixed ball by that of the rolling one"),
        "contact": Parameter(
            "choice", "rubber", "rubber: no spinning; marble: spins as it likes", ("rubber", "marble")
        ),
    }
    example: ClassVar[Mapping[str, Any]] = {  # on the spot, turned
        "start": {"contact_point": [0, 0], "orientation": {"rpy": [0, 0, 0]}},
        "goal": {"contact_point": [0, 0], "orientation": {"rpy": [0, 0, "30 deg"]}},
        "control": {"harmonics": 2, "initial": [[0, 2, 0, 0, 0], [0, 0, 2, 0, 0]]},
    }
    state_space = StateSpace(
        [vector("contact_point", 2, symbol="s", words="contact"), rotation("orientation")]
    )
    output_blocks = (direction("gamma", symbol=r"\gamma", words="line of centres", of_pose=True),)
    ratio: float
    contact: str

    def __init__(self, ratio: float = 3.0, contact: str = "rubber") -> None:
        super().__init__(ratio=ratio, contact=contact)
        spin = [scalar("omega_gamma", "angle", symbol=r"\omega_\gamma")] if contact == "marble" else []
        self.input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle"), *spin])

    def line_of_centres(self, state: Array) -> tuple[Array, Array, Array]:
        """γ, e_1 and e_2, (3,) each: the chart is conformal, so its coordinate lines are orthogonal."""
        xp, (a, b) = namespace(state), (state[0], state[1])
        size = 1.0 + a * a + b * b
        gamma = xp.vector([2.0 * a, 2.0 * b, 2.0 - size]) / size
        first = xp.vector([size - 2.0 * a * a, -2.0 * a * b, -2.0 * a]) / size
        return gamma, first, xp.vector([-2.0 * a * b, size - 2.0 * b * b, -2.0 * b]) / size

    def vector_fields(self, state: Array) -> Array:
        xp, (gamma, first, second) = namespace(state), self.line_of_centres(state)
        stretch = 0.5 * (1.0 + state[0] ** 2 + state[1] ** 2)  # γ̇ = u1 e_1 is ṡ_1 = stretch u1
        axes = [(self.ratio + 1.0) * cross(gamma, e) for e in (first, second)]
        rows = [[stretch, 0.0], [0.0, stretch], *([axes[0][i], axes[1][i]] for i in range(3))]
        if self.input_space.size == 3:
            rows = [[*row, 0.0 if i < 2 else gamma[i - 2]] for i, row in enumerate(rows)]
        return xp.matrix(rows)

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The velocity of the point that touches the fixed ball, along e_1 and e_2, and for rubber the spin."""
        xp, (gamma, first, second) = namespace(state, velocity), self.line_of_centres(state)
        stretch = 0.5 * (1.0 + state[0] ** 2 + state[1] ** 2)
        centre = (self.ratio + 1.0) * (velocity[0] * first + velocity[1] * second) / stretch
        slip = centre - cross(velocity[2:5], gamma)
        spins = [] if self.input_space.size == 3 else [dot(velocity[2:5], gamma)]
        return xp.vector([dot(slip, first), dot(slip, second), *spins])

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        return {"gamma": self.line_of_centres(state)[0]}

    def bodies(self, state: Array) -> dict[str, hull.Hull]:
        return {"sphere": hull.ball((self.ratio + 1.0) * self.line_of_centres(state)[0], 1.0)}

    def drawing(self, state: Array) -> dict[str, Any]:
        """Both balls by their great circles, one octant of the rolling one, and where they touch."""
        xp, turned, size = namespace(state), self.state_space.unpack(state)["orientation"], self.ratio
        gamma = self.line_of_centres(state)[0]
        centre, touching = (size + 1.0) * gamma, size * gamma
        still, middle = xp.eye(3) + 0.0 * turned, 0.0 * gamma
        lines = {f"circle {i + 1}": great_circle(centre, turned, i, 1.0) for i in range(3)}
        lines["octant"] = facet(centre, turned, 1.0, bend=8)
        lines |= {f"fixed circle {i + 1}": great_circle(middle, still, i, size) for i in range(3)}
        solids = {
            "sphere": ball(centre, turned, 1.0, "circle", "octant"),
            "fixed sphere": ball(middle, still, size, "fixed circle"),
        }
        return {
            "lines": lines,
            "points": {"contact": xp.rows([touching])},
            "trace": touching,
            "solids": solids,
        }
