"""The free nilpotent system with growth vector (3, 6), the 3-ŬPU robot's first approximation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from nhpocp import so3
from nhpocp.arrays import Array, cross, namespace
from nhpocp.state_space import StateSpace, vector
from nhpocp.systems.system import System


class FreeNilpotent36(System):
    r"""Three inputs whose three brackets are all that there is, on R³ × R³, [Myasnichenko]:

        ẋ = u,   ż = ½ x × u

    z is the vector of the area that x sweeps, so that a loop of x in any plane moves z along its normal: least effort
    from 0 to (0, z) is one circle, 4π |z|. Every system with growth vector (3, 6) looks so from near by.
    """

    model: ClassVar[str] = "free_nilpotent_36"
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"x": [0, 0, 0], "z": [0, 0, 0]},
        "goal": {"x": [0, 0, 0], "z": [0, 0, 1]},
        "control": {"harmonics": 1, "initial": [[0, 0, 2], [0, 2, 0], [0, 0.5, 0.5]]},
    }
    state_space = StateSpace([vector("x", 3), vector("z", 3)])
    input_space = StateSpace([vector("u", 3)])

    def vector_fields(self, state: Array) -> Array:
        xp = namespace(state)
        return xp.block([[xp.eye(3)], [0.5 * so3.hat(state[:3])]])

    def constraints(self, state: Array, velocity: Array) -> Array:
        return velocity[3:] - 0.5 * cross(state[:3], velocity[:3])

    def drawing(self, state: Array) -> dict[str, Any]:
        """x, and the area that it has swept as an arrow."""
        xp, x, z = namespace(state), state[:3], state[3:]
        return {
            "lines": {"area z": xp.rows([0.0 * z, z])},
            "points": {"x": xp.rows([x]), "z": xp.rows([z])},
            "trace": x,
        }
