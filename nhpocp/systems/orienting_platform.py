"""The non-holonomic orienting platform (nS)-2SPU: a wrist of three freedoms in the large that two motors drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, pi, sin
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace, solve_3x3, unit
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems.legs import Leg
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.solids import rod
from nhpocp.systems.system import Parameter


class OrientingPlatform(ParallelRobot):
    r"""The platform that [Di Gregorio] hangs on one non-holonomic ball joint and two legs with motors, on SO(3):

        [-(R b̂_i × a_i)ᵀ/l_i, i = 1, 2; rᵀ] ω = (l̇1, l̇2, 0),   Ṙ = [ω] R

    R: platform to base, both with their origin in the ball joint, which cannot turn about r: fixed in the base
    (veselova) or in the platform (suslov). Leg i runs between spherical joints at a_i (base) and R b̂_i. a_i at radius
    A, the height H below the ball joint, b̂_i at radius B in the platform's plane, at azimuth 0 and at `azimuth`.
    """

    model: ClassVar[str] = "orienting_platform"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "base_radius": Parameter("positive", 10.0, "A, of the legs' feet", unit="length"),
        "platform_radius": Parameter("positive", 10.0, "B, of the legs' heads", unit="length"),
        "height": Parameter("positive", 20.0, "H of the ball joint above the feet", unit="length"),
        "azimuth": Parameter("number", pi / 2, "angle between the two legs, seen from above", unit="angle"),
        "r": Parameter("numbers", [0.0, 0.0, 1.0], "direction about which the ball joint cannot turn"),
        "joint": Parameter(
            "choice",
            "veselova",
            "r fixed in the base (veselova) or in the platform (suslov)",
            ("veselova", "suslov"),
        ),
    }
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    example: ClassVar[Mapping[str, Any]] = {
        "start": {"orientation": {"rpy": [0, 0, 0]}},
        "goal": {"orientation": {"rpy": [0, 0, "45 deg"]}},
        "control": {"initial": [[0, 0, -28, 0, 0], [0, 28, 0, 0, 0]]},
    }
    state_space = StateSpace([rotation("orientation")])
    base_radius: float
    platform_radius: float
    height: float
    azimuth: float
    r: tuple[float, ...]
    joint: str

    def __init__(
        self,
        base_radius: float = 10.0,
        platform_radius: float = 10.0,
        height: float = 20.0,
        azimuth: float = pi / 2,
        r: Sequence[float] = (0.0, 0.0, 1.0),
        joint: str = "veselova",
    ) -> None:
        own = {"base_radius": base_radius, "platform_radius": platform_radius, "height": height}
        self._declare({**own, "azimuth": azimuth, "r": r, "joint": joint})
        self.input_space = StateSpace([scalar("l1_dot", "length"), scalar("l2_dot", "length")])
        try:
            ball = Leg((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), r=self.r, joint=self.joint, length=0.0)  # type: ignore[arg-type]
        except InvalidProblemError as error:
            raise InvalidProblemError(error.message, path="system.r") from None
        self._set_legs([self._leg(0.0), self._leg(self.azimuth), ball])
        self.output_blocks = (vector("u", 2, "length", words="leg speed", rate=True), *self.output_blocks)

    def _leg(self, azimuth: float) -> Leg:
        c, s = cos(azimuth), sin(azimuth)
        foot = (self.base_radius * c, self.base_radius * s, -self.height)
        return Leg(foot, (self.platform_radius * c, self.platform_radius * s, 0.0), joint="spherical")

    def parameters(self) -> dict[str, Any]:
        return super(ParallelRobot, self).parameters()

    def pose(self, state: Array) -> tuple[Array, Array]:
        return namespace(state).array([0.0, 0.0, 0.0]), self.state_space.unpack(state)["orientation"]

    def matrix(self, state: Array) -> Array:
        """The display equation's, the row of r times `default_length_scale`: W with ṗ = 0 solved."""
        blocks = self.kinematics(state)
        return namespace(state).block([[blocks.K], [blocks.J[3:4, :]]])

    def velocity(self, state: Array, control: Array) -> Array:
        motors, constraints = self.rows(state)
        right = namespace(state, control).vector([control[0], control[1], 0.0])
        return solve_3x3([row.of_omega for row in (*motors, constraints[-1])], right)

    def invariants(self, state: Array) -> dict[str, tuple[Array, float | None]]:
        return {}  # the ball joint's are kept by the choice of the state

    def constraints(self, state: Array, velocity: Array) -> Array:
        """ω about r."""
        xp, r = namespace(state, velocity), unit(namespace().array(self.r))
        return xp.vector([dot(self.pose(state)[1] @ r if self.joint == "suslov" else r, velocity)])

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        return {"u": self.output("u", state, control), **super().outputs(state, control)}

    def output(self, name: str, state: Array, control: Array) -> Array:
        return control if name == "u" else super().output(name, state, control)

    def column_scales(self, name: str, length_scale: float) -> list[float]:
        return [length_scale] * 3

    def drawing(self, state: Array) -> dict[str, Any]:
        """The robot's, and the platform's normal, whose tip is followed."""
        xp, normal, drawn = namespace(state), self.pose(state)[1][:, 2], super().drawing(state)
        tip = self.platform_radius * normal
        drawn["lines"]["normal"] = xp.rows([0.0 * tip, tip])
        drawn["solids"]["normal"] = rod(0.0 * tip, tip, 0.04 * self.platform_radius)
        return {**drawn, "trace": tip}
