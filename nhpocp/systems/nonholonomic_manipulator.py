"""The non-holonomic manipulator: an arm of many joints that two motors in its base drive through rolling gears."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

from nhpocp.arrays import Array, namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, scalar, vector
from nhpocp.systems.planar import along, link
from nhpocp.systems.system import Parameter, System

if TYPE_CHECKING:
    from nhpocp.systems.chained_form import ChainedForm


class NonholonomicManipulator(System):
    r"""The planar arm of [Nakamura, Chung & Sørdalen] on R × Rⁿ, n joints and two motors:

        θ̇_1 = u1,   θ̇_i = k_i u2 sin θ_{i-1} ∏_{j ≤ i-2} cos θ_j,   φ̇ = u2 ∏_{j ≤ n-1} cos θ_j

    A shaft at speed u2 runs through the arm. At joint i - 1 it spins a ball, on which two wheels roll that are turned
    by θ_{i-1} against the wheel which drives it: one takes off the sine of the speed, for joint i by a gear k_i, the
    other passes on the cosine; φ is the angle of the last. Where cos θ_j = 0 nothing is passed on: what follows is
    locked.
    """

    model: ClassVar[str] = "nonholonomic_manipulator"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "gains": Parameter(
            "numbers", [1.0, 1.0], "k_2 … k_n of the gears, none 0; the arm has one joint more"
        )
    }
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"phi": 0, "theta": [0, 0, 0]},
        "goal": {"phi": 0, "theta": ["20 deg", "-20 deg", "20 deg"]},
        "control": {"harmonics": 3},
    }
    input_space = StateSpace([scalar("u1", "angle"), scalar("u2", "angle")])
    gains: tuple[float, ...]

    def __init__(self, gains: Sequence[float] = (1.0, 1.0)) -> None:
        super().__init__(gains=gains)
        if not self.gains or not all(self.gains):
            raise InvalidProblemError(
                "expected one number, not 0, for each gear, as in [1, 1]", path="system.gains"
            )
        joints = vector("theta", len(self.gains) + 1, "angle", symbol=r"\theta")
        self.state_space = StateSpace([scalar("phi", "angle", symbol=r"\varphi"), joints])

    def vector_fields(self, state: Array) -> Array:
        xp, theta = namespace(state), state[1:]
        passed, rows = 1.0, []
        for i, gain in enumerate(self.gains):
            rows.append([0.0, gain * passed * xp.sin(theta[i])])
            passed = passed * xp.cos(theta[i])
        return xp.matrix([[0.0, passed], [1.0, 0.0], *rows])

    def constraints(self, state: Array, velocity: Array) -> Array:
        """What rolls at each gear, brought to the last shaft: θ̇_i ∏_{i-1 ≤ j ≤ n-1} cos θ_j = k_i sin θ_{i-1} φ̇."""
        xp, theta, n = namespace(state, velocity), state[1:], len(self.gains) + 1
        rolling = []
        for i, gain in enumerate(self.gains):
            onwards: Array = 1.0
            for j in range(i, n - 1):
                onwards = onwards * xp.cos(theta[j])
            rolling.append(velocity[i + 2] * onwards - gain * xp.sin(theta[i]) * velocity[0])
        return xp.vector(rolling)

    def chained_form(self, near: Array) -> ChainedForm:
        """z_1 = φ, z_{n+1} = θ_n; θ_1 … θ_{n-1} within 90°, where every gear passes on some speed."""
        from nhpocp.systems.chained_form import ChainedForm

        def assemble(first: Array, last: Array, slopes: Sequence[Array]) -> Array:
            xp = namespace(first)
            return xp.vector([first, *(xp.arctan(slope) for slope in reversed(slopes)), last])

        return ChainedForm(self, 1, lambda x: x[0], lambda x: x[len(self.gains) + 1], assemble)

    def drawing(self, state: Array) -> dict[str, Any]:
        """The arm from above, links of one length each, its joints' angles one on top of the other."""
        xp, heading = namespace(state), 0.0 * state[0]
        places = [xp.vector([heading, heading])]
        for i in range(len(self.gains) + 1):
            heading = heading + state[1 + i]
            places.append(places[-1] + along(heading))
        lines = {f"link {i + 1}": link(*ends, 0.09) for i, ends in enumerate(pairwise(places))}
        lines["last shaft"] = xp.rows([places[-1], places[-1] + 0.3 * along(heading + state[0])])
        return {
            "lines": lines,
            "points": {"joints": xp.rows(places)},
            "trace": places[-1],
        }
