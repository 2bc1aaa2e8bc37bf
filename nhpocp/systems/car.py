"""The car: two axles, the front one steered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.planar import across, along, vehicle, vehicle_footprint, wheels
from nhpocp.systems.system import Parameter, System

if TYPE_CHECKING:
    from nhpocp.bodies.hull import Hull
    from nhpocp.systems.chained_form import ChainedForm


class Car(System):
    r"""The car with rear-wheel drive on R² × R², [Laumond, ch. 1]:

        ẋ = v cos θ,   ẏ = v sin θ,   θ̇ = v tan φ / L,   φ̇ = w

    (x, y): the middle of the rear axle, θ: the heading, φ: the steering angle of the front wheels, L: the wheelbase.
    Not defined at φ = ±90°, where the front wheels stand across.
    """

    model: ClassVar[str] = "car"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "wheelbase": Parameter("positive", 1.0, "L, between the axles", unit="length")
    }
    example: ClassVar[Mapping[str, Any]] = {  # sideways into a gap
        "start": {"x": 0, "y": 0, "theta": 0, "phi": 0},
        "goal": {"x": 0, "y": 0.5, "theta": 0, "phi": 0},
        "control": {"harmonics": 3},
    }
    state_space = StateSpace(
        [
            scalar("x", "length"),
            scalar("y", "length"),
            scalar("theta", "angle", symbol=r"\theta"),
            scalar("phi", "angle", symbol=r"\varphi"),
        ]
    )
    input_space = StateSpace([scalar("v", "length"), scalar("w", "angle")])
    wheelbase: float

    def __init__(self, wheelbase: float = 1.0) -> None:
        super().__init__(wheelbase=wheelbase)

    def vector_fields(self, state: Array) -> Array:
        xp, (theta, phi) = namespace(state), (state[2], state[3])
        turning = xp.tan(phi) / self.wheelbase
        return xp.matrix([[xp.cos(theta), 0.0], [xp.sin(theta), 0.0], [turning, 0.0], [0.0, 1.0]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The speeds of the rear and of the front axle across their wheels."""
        front = velocity[:2] + self.wheelbase * velocity[2] * across(state[2])
        slips = [dot(velocity[:2], across(state[2])), dot(front, across(state[2] + state[3]))]
        return namespace(state, velocity).vector(slips)

    def default_length_scale(self) -> float:
        return self.wheelbase

    def chained_form(self, near: Array) -> ChainedForm:
        """z_1 and z_4 are the place along and across the heading of ``near``; headings within 90° of it."""
        from nhpocp.systems.chained_form import ChainedForm

        axis, side = along(near[2]), across(near[2])

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            xp = namespace(first)
            theta = near[2] + xp.arctan(slopes[0])
            return xp.concatenate([first * axis + last * side, theta, xp.arctan(slopes[1])])

        return ChainedForm(self, 0, lambda x: dot(axis, x[:2]), lambda x: dot(side, x[:2]), assemble)

    def bodies(self, state: Array) -> dict[str, Hull]:
        return {"car": vehicle_footprint(state[:2], state[2], 1.0, self.wheelbase)}

    def drawing(self, state: Array) -> dict[str, Any]:
        """The body and four wheels, the front ones steered."""
        here, theta, size = state[:2], state[2], self.wheelbase
        front = here + size * along(theta)
        return {
            "lines": {
                **wheels("rear wheel", here, theta, 0.23 * size, size),
                **wheels("front wheel", front, theta, 0.23 * size, size, state[3]),
                **vehicle("body", here, theta, 1.0, size),
            },
            "points": {},
            "trace": here,
        }
