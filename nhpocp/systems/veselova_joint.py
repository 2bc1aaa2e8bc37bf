"""The Veselova joint: a ball that cannot turn about a direction fixed in its socket."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.state_space import StateSpace, rotation, scalar
from nhpocp.systems.solids import body_axes, facet, joint_solids, rod
from nhpocp.systems.system import System


class VeselovaJoint(System):
    r"""The base joint of [Paper] section 2 alone, on SO(3); constraint of [Veselova]:

        Ṙ = [ω] R,   ω = (u1, u2, 0)

    R: ball to socket, ω in socket coordinates. The joint cannot turn about r = ẑ, fixed in the socket.
    Least effort from 1 to Rz(φ), 0 < φ ≤ π, is φ (4π - φ); there are dearer local minima.
    """

    model: ClassVar[str] = "veselova_joint"
    example: ClassVar[Mapping[str, Any]] = {  # about the direction about which it cannot turn
        "start": {"orientation": {"rpy": [0, 0, 0]}},
        "goal": {"orientation": {"rpy": [0, 0, "90 deg"]}},
        "control": {"initial": [[0, 0, 4, 0, 0], [0, 4, 0, 0, 0]]},
    }
    state_space = StateSpace([rotation("orientation")])
    input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle")])

    def vector_fields(self, state: Array) -> Array:
        return namespace(state).matrix([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """ω about r."""
        return velocity[2:3]

    def drawing(self, state: Array) -> dict[str, Any]:
        """The ball's axes, the third being the leg that it may carry, and r."""
        xp, turned = namespace(state), self.state_space.unpack(state)["orientation"]
        origin = xp.array([0.0, 0.0, 0.0])
        lines = {"ball": facet(origin, turned, 1.0), **body_axes(origin, turned, 1.0)}
        lines["r"] = xp.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.0]])
        r = xp.array([0.0, 0.0, 1.0])
        solids = joint_solids(turned, r, towards=xp.array([1.0, -1.0, 0.0]))
        solids["r"] = rod(-0.9 * r, origin, 0.03)
        tip = turned[:, 2]
        return {"lines": lines, "points": {"tip": xp.rows([tip])}, "trace": tip, "solids": solids}
