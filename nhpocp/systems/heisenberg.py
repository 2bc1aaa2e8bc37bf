"""Brockett's integrator: the simplest system that reaches sideways only by loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.system import Parameter, System

if TYPE_CHECKING:
    from nhpocp.systems.chained_form import ChainedForm

PATCH = 0.12  # half of a side of the drawn patch


class Heisenberg(System):
    r"""The non-holonomic integrator on R³, [Brockett]:

        ẋ = u1,   ẏ = u2,   ż = c (x u2 - y u1)

    A closed loop in the (x, y) plane that turns about an area A moves z by 2 c A, so least effort ∫|u|² is a circle:
    2π |z| for c = 1, and 2N tan(π/N) |z| with N piecewise constant values. The Lie algebra is Heisenberg's.
    """

    model: ClassVar[str] = "heisenberg"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "scale": Parameter("number", 1.0, "c in ż = c (x u2 - y u1); not 0")
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": 0, "y": 0, "z": 0},
        "goal": {"x": 0, "y": 0, "z": 1},
        "control": {"harmonics": 1, "initial": [[0, 0, 1], [0, 1, 0]]},
    }
    state_space = StateSpace([scalar("x"), scalar("y"), scalar("z")])
    input_space = StateSpace([scalar("u1"), scalar("u2")])
    scale: float

    def __init__(self, scale: float = 1.0) -> None:
        super().__init__(scale=scale)
        if not self.scale:
            raise InvalidProblemError("0 leaves z where it is; expected another number", path="system.scale")

    def vector_fields(self, state: Array) -> Array:
        xp, c = namespace(state), self.scale
        return xp.matrix([[1.0, 0.0], [0.0, 1.0], [-c * state[1], c * state[0]]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        swept = state[0] * velocity[1] - state[1] * velocity[0]  # twice the area, per unit time
        return namespace(state, velocity).vector([velocity[2] - self.scale * swept])

    def chained_form(self, near: Array) -> ChainedForm:
        """z_1 = x, z_3 = (c x y - z)/2c, and so z_2 = y."""
        from nhpocp.systems.chained_form import ChainedForm

        c = self.scale

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            return namespace(first).vector([first, slopes[0], c * first * slopes[0] - 2.0 * c * last])

        return ChainedForm(self, 0, lambda x: x[0], lambda x: 0.5 * x[0] * x[1] - x[2] / (2.0 * c), assemble)

    def drawing(self, state: Array) -> dict[str, Any]:
        """The patch of the plane in which every velocity lies."""
        xp, fields = namespace(state), self.vector_fields(state)
        first, second = PATCH * fields[:, 0], PATCH * fields[:, 1]
        corners = [state + i * first + j * second for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1))]
        return {"lines": {"plane": xp.rows(corners)}, "points": {}, "trace": state}
