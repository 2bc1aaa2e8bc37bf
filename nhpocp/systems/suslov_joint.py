"""The Suslov joint: a ball that cannot turn about a direction fixed in itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace
from nhpocp.state_space import StateSpace, rotation, scalar
from nhpocp.systems.solids import body_axes, facet, joint_solids, rod
from nhpocp.systems.system import System


class SuslovJoint(System):
    r"""The other base joint of [Paper] section 2 alone, on SO(3); constraint of [Suslov]:

        Ṙ = R [Ω],   Ω = (u1, u2, 0)

    R: ball to socket, Ω in ball coordinates. The joint cannot turn about r = R ẑ, fixed in the ball. Rᵀ moves as a
    Veselova joint under -u does, so both cost the same.
    """

    model: ClassVar[str] = "suslov_joint"
    example: ClassVar[Mapping[str, Any]] = {  # about the direction about which it cannot turn
        "start": {"orientation": {"rpy": [0, 0, 0]}},
        "goal": {"orientation": {"rpy": [0, 0, "90 deg"]}},
        "control": {"initial": [[0, 0, 4, 0, 0], [0, 4, 0, 0, 0]]},
    }
    state_space = StateSpace([rotation("orientation")])
    input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle")])

    def vector_fields(self, state: Array) -> Array:
        return self.state_space.unpack(state)["orientation"][:, :2]  # ω = R Ω

    def constraints(self, state: Array, velocity: Array) -> Array:
        """ω about r."""
        r = self.state_space.unpack(state)["orientation"][:, 2]
        return namespace(state, velocity).vector([dot(r, velocity)])

    def drawing(self, state: Array) -> dict[str, Any]:
        """The ball's axes, and r beyond the third."""
        xp, turned = namespace(state), self.state_space.unpack(state)["orientation"]
        origin = xp.array([0.0, 0.0, 0.0])
        lines = {"ball": facet(origin, turned, 1.0), **body_axes(origin, turned, 1.0)}
        lines["r"] = xp.rows([turned[:, 2], 1.4 * turned[:, 2]])
        tip = turned[:, 2]
        solids = joint_solids(turned, tip, towards=turned[:, 0])
        solids["r"] = rod(tip, 1.4 * tip, 0.03)
        return {"lines": lines, "points": {"tip": xp.rows([tip])}, "trace": tip, "solids": solids}
