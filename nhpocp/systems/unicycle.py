"""The unicycle: one wheel on the plane, or two on an axle, that cannot slip sideways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.parameter import Parameter
from nhpocp.systems.planar import NOSE, footprint, outline, wheel
from nhpocp.systems.system import System

if TYPE_CHECKING:
    from nhpocp.bodies.hull import Hull
    from nhpocp.systems.chained_form import ChainedForm


class Unicycle(System):
    r"""The unicycle on R² × R, [Laumond, ch. 1]:

        ẋ = v cos θ,   ẏ = v sin θ,   θ̇ = w

    (x, y): the wheel's contact point, θ: its heading from the x axis. θ counts whole turns: 0 and 2π are two states.
    """

    model: ClassVar[str] = "unicycle"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "width": Parameter(
            "positive", 0.2, "of the body, which is 1.9 times as long", unit="length", of_motion=False
        )
    }
    example: ClassVar[Mapping[str, Any]] = {  # sideways
        "start": {"x": 0, "y": 0, "theta": 0},
        "goal": {"x": 0, "y": 1, "theta": 0},
        "control": {"harmonics": 1, "initial": [[0.5, 0, -2], [0, 3, 0]]},
    }
    state_space = StateSpace([scalar("x", "length"), scalar("y", "length"), scalar("theta", "angle")])
    input_space = StateSpace([scalar("v", "length"), scalar("w", "angle")])
    width: float

    def __init__(self, width: float = 0.2) -> None:
        super().__init__(width=width)

    def vector_fields(self, state: Array) -> Array:
        xp = namespace(state)
        return xp.matrix([[xp.cos(state[2]), 0.0], [xp.sin(state[2]), 0.0], [0.0, 1.0]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """The speed across the heading."""
        xp = namespace(state, velocity)
        return xp.vector([velocity[1] * xp.cos(state[2]) - velocity[0] * xp.sin(state[2])])

    def chained_form(self, near: Array) -> ChainedForm:
        """The place as the wheel sees it, everywhere: z_1 = θ, z_2 = x cos θ + y sin θ, z_3 = x sin θ - y cos θ."""
        from nhpocp.systems.chained_form import ChainedForm

        def last(state: Array) -> Array:
            xp = namespace(state)
            return state[0] * xp.sin(state[2]) - state[1] * xp.cos(state[2])

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            xp, along = namespace(first), slopes[0]
            c, s = xp.cos(first), xp.sin(first)
            return xp.vector([along * c + last * s, along * s - last * c, first])

        return ChainedForm(self, 1, lambda x: x[2], last, assemble)

    def bodies(self, state: Array) -> dict[str, Hull]:
        return {"body": footprint(state[:2], state[2], NOSE, self.width)}

    def drawing(self, state: Array) -> dict[str, Any]:
        """The body with its nose ahead, from above, and the wheel."""
        here, theta = state[:2], state[2]
        return {
            "lines": {
                "body": outline(here, theta, NOSE, self.width),
                "wheel": wheel(here, theta, 2.0 * self.width),
            },
            "points": {},
            "trace": here,
        }
