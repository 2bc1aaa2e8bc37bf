"""The 3-ŬPU parallel robot: three prismatic legs, each held to the base by a non-holonomic joint. [Paper] section 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import cos, hypot, pi, sin
from typing import Any, ClassVar

from nhpocp.arrays import Array, dot, namespace, solve_3x3, symbolic
from nhpocp.bodies.hull import TINY
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, matrix, vector
from nhpocp.systems.joints import Vector3
from nhpocp.systems.legs import Leg, several
from nhpocp.systems.parallel_robot import SIZES, ParallelRobot, leg_data
from nhpocp.systems.system import Parameter

CONES = "joint_cones"  # among the quantities that count from the pose at rest
LEG = {  # of a file, the fields of `Leg` that these legs may have
    "base": Parameter("vector", ..., "centre of the sphere, base coordinates"),
    "platform": Parameter("vector", ..., "centre of the universal joint, platform coordinates"),
    "r": Parameter("vector", ..., "roller normal, base coordinates (suslov: along g, w3, g×w3)"),
    "w4": Parameter("vector", ..., "axis of the universal joint fixed in the platform"),
    "joint": Parameter("choice", "veselova", "r fixed in the base or in the leg", ("veselova", "suslov")),
}


class ThreeUPU(ParallelRobot):
    r"""The 3-ŬPU robot as a driftless control system on R³ × SO(3).

    Feedback-transformed, control v (the platform's angular velocity reversed), [Paper] eq. (7):
        ṗ = S⁻¹ J v,   Ṙ = -[v] R
    Original, control u (the leg speeds), [Paper] eqs. (3)-(4):
        (ṗ, ω) = [G K; S J]⁻¹ (u, 0),   Ṙ = [ω] R
    p: platform centre in base coordinates [length], R: platform to base, b = p + R b̂.

    Geometry: legs at azimuth 0°, 120°, 240°, base radius A, platform radius B. Veselova:
    r = cos β ẑ + sin β t̂ with t̂ tangential; Suslov: r = (cos β, sin β, 0) along g, w3, g × w3. Or three explicit legs.
    """

    model: ClassVar[str] = "three_upu"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "base_radius": Parameter(
            "positive", 30.0, "A, distance of the spheres from the base's axis", unit="length"
        ),
        "platform_radius": Parameter(
            "positive", 15.0, "B, distance of the universal joints from the platform's axis", unit="length"
        ),
        "roller_tilt": Parameter(
            "number", 75 * pi / 180, "β, angle of r from the vertical towards the tangent", unit="angle"
        ),
        "platform_axis": Parameter(
            "choice", "radial", "direction of w4 in the platform", ("radial", "tangential", "normal")
        ),
        "joint": Parameter(
            "choice",
            "veselova",
            "r fixed in the base (veselova) or in the leg (suslov)",
            ("veselova", "suslov"),
        ),
        "legs": Parameter(
            "legs",
            None,
            "three explicit legs {base, platform, r, w4, joint} instead of all of the above",
            replaces=("base_radius", "platform_radius", "roller_tilt", "platform_axis", "joint"),
            keys=LEG,
        ),
        "form": Parameter(
            "choice",
            "feedback",
            "feedback: eq. (7), control v; original: eq. (3), control u",
            ("feedback", "original"),
        ),
        **SIZES,
    }
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {},
        "normal75": {"platform_radius": 10.0, "platform_axis": "normal"},
        "paper_conjecture": {
            "base_radius": 15.0,
            "platform_radius": 5.0,
            "roller_tilt": pi / 2,
            "platform_axis": "normal",
        },
        "vertical_equal": {"base_radius": 10.0, "platform_radius": 10.0, "roller_tilt": pi / 2},
    }

    example: ClassVar[Mapping[str, Any]] = {  # the paper's
        "start": {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, "-pi/6"]}},
        "goal": {"position": [-0.4, -0.2, 35], "orientation": {"rpy": [0, 0, "-90 deg"]}},
        "control": {"initial": [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]]},
    }

    def __init__(
        self,
        base_radius: float = 30.0,
        platform_radius: float = 15.0,
        roller_tilt: float = 75 * pi / 180,
        platform_axis: str = "radial",
        joint: str = "veselova",
        legs: Sequence[Leg | Mapping[str, Any]] | None = None,
        form: str = "feedback",
        leg_radius: float | None = None,
        thickness: float | None = None,
    ) -> None:
        self._set_sizes(leg_radius, thickness)
        shape = {
            "base_radius": base_radius,
            "platform_radius": platform_radius,
            "roller_tilt": roller_tilt,
            "platform_axis": platform_axis,
            "joint": joint,
        }
        self._shape: dict[str, Any] = {
            name: self.declared[name].checked(name, value) for name, value in shape.items()
        }
        self.form: str = self.declared["form"].checked("form", form)
        self._explicit = legs is not None
        built = [_leg(leg) for leg in several(legs)] if legs is not None else _symmetric_legs(**self._shape)
        if len(built) != 3:
            raise InvalidProblemError(f"{len(built)} legs; the 3-ŬPU robot has 3", path="system.legs")
        self._set_legs(built)
        v = vector("v", 3, "angle", words="angular velocity", rate=True)
        u = vector("u", 3, "length", words="leg speed", rate=True)
        control, other = (v, u) if form == "feedback" else (u, v)
        self.input_space = StateSpace([control])
        lengths, normal = self.output_blocks
        angles = matrix("joint_angles", 3, 4, "angle", symbol=r"\theta", words="joint angle", wraps=True)
        self.output_blocks = (other, lengths, angles, normal)
        self.rest_blocks = (vector(CONES, 3, "angle", symbol="c", words="cone angle"),)

    def parameters(self) -> dict[str, Any]:
        if self._explicit:
            return {"legs": [leg_data(leg, LEG) for leg in self.legs], "form": self.form, **self._sizes()}
        return {**self._shape, "form": self.form, **self._sizes()}

    @property
    def shape(self) -> tuple[str, ...]:
        return () if self._explicit else ("base_radius", "platform_radius", "roller_tilt")

    def shaped(self, number: int, values: Mapping[str, Array]) -> dict[str, tuple[Array, Array, Array]]:
        every, xp = {**self._shape, **values}, namespace(*values.values())
        tilt = (xp.cos(every["roller_tilt"]), xp.sin(every["roller_tilt"]))
        radii = every["base_radius"], every["platform_radius"]
        azimuth = 2 * pi * number / 3
        vectors = _around(azimuth, *radii, tilt, every["platform_axis"], every["joint"])
        return {name: vector for name, vector in vectors.items() if name != "w4"}

    def actuated(self) -> tuple[ThreeUPU, Callable[[Array, Array], Array]] | None:
        return (self.with_(form="original"), self.feedback) if self.form == "feedback" else None

    def translation(self, state: Array, v: Array) -> Array:
        """ṗ = S⁻¹ J v, [Paper] eq. (7), which does not mind the scale of a row."""
        rows = self.rows(state)[1]
        right = namespace(state, v).vector([dot(row.of_omega, v) for row in rows])
        return solve_3x3([row.of_p for row in rows], right)

    def velocity(self, state: Array, control: Array) -> Array:
        if self.form == "original":
            return super().velocity(state, control)
        xp = namespace(state, control)  # [Paper] eq. (7)
        return xp.concatenate([self.translation(state, control), -control])

    def vector_fields(self, state: Array) -> Array:
        if self.form == "original":
            return super().vector_fields(state)
        xp, rows = namespace(state), self.rows(state)[1]
        j = xp.rows([row.of_omega for row in rows])
        return xp.block([[solve_3x3([row.of_p for row in rows], j)], [-xp.eye(3)]])

    def linearised(self, state: Array, control: Array) -> Array:
        if self.form == "original":
            return super().linearised(state, control)
        # S ṗ = J v differentiated with ṗ held: d(S⁻¹ J v) = S⁻¹ d(J v - S ṗ), a third of the operations
        xp = symbolic()
        held = xp.symbol(3)
        rows = self.rows(state)[1]
        s, j = [row.of_p for row in rows], xp.rows([row.of_omega for row in rows])
        residual = j @ control - xp.vector([dot(row, held) for row in s])
        change = xp.substitute(xp.jacobian(residual, state), held, solve_3x3(s, j @ control))
        inverse = solve_3x3(s, xp.eye(3))
        # ω = -v whatever the pose
        return xp.block([[inverse @ change, inverse @ j], [0.0 * change, -xp.eye(3)]])

    def feedback(self, state: Array, v: Array) -> Array:
        """Leg speeds u = (G S⁻¹ J - K) v, which equals [Paper] eq. (6)."""
        blocks = self.kinematics(state)
        return blocks.G @ self.translation(state, v) - blocks.K @ v

    def inverse_feedback(self, state: Array, u: Array) -> Array:
        """v = -ω of the motion under leg speeds u; needs det W ≠ 0 only."""
        xp = namespace(state, u)
        return -xp.solve(self.kinematics(state).W, xp.concatenate([u, 0.0 * u]))[3:6]

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        return {block.name: self.output(block.name, state, control) for block in self.output_blocks}

    def output(self, name: str, state: Array, control: Array) -> Array:
        if name == "u" and self.form == "feedback":
            return self.feedback(state, control)
        if name == "v" and self.form == "original":
            return self.inverse_feedback(state, control)
        if name == "joint_angles":
            xp, orientation = namespace(state), self.pose(state)[1]
            references = [orientation @ xp.array(_reference(leg.w4)) for leg in self.legs if leg.w4]
            poses = self.leg_poses(state)
            return xp.rows([pose.joint_angles(r) for pose, r in zip(poses, references, strict=True)])
        return super().output(name, state, control)

    def from_rest(self, state: Array, rest: Array) -> dict[str, Array]:
        """The angle of each leg from its direction at rest, by the half-angle formula [rad]."""
        xp, angles = namespace(state), []
        for now, then in zip(self.leg_poses(state), self.leg_poses(rest), strict=True):
            g = xp.array(then.g)
            apart, sum_of_both = now.g - g, now.g + g
            sine, cosine = (xp.sqrt(xp.maximum(dot(v, v), TINY)) for v in (apart, sum_of_both))
            angles.append(2.0 * xp.atan2(sine, cosine))
        return {CONES: xp.vector(angles)}

    def regularity(self, state: Array) -> dict[str, Array]:
        blocks = self.kinematics(state)
        return {"s": blocks.S, "w": blocks.W}

    def column_scales(self, name: str, length_scale: float) -> list[float]:
        return {"s": [1.0] * 3, "w": [1.0] * 3 + [length_scale] * 3}[name]

    def breaking(self) -> tuple[str, ...]:
        return ("s",) if self.form == "feedback" else ("w",)

    def separating(self) -> tuple[str, ...]:
        # (7) crosses det W = 0 without noticing; the actuators do not
        return ("s", "w") if self.form == "feedback" else ("w",)

    def input_label(self) -> str:
        return self.input_space.names[0]


def _leg(leg: Leg | Mapping[str, Any]) -> Leg:
    built = Leg.of(leg, LEG)
    if built.joint not in ("veselova", "suslov"):
        raise InvalidProblemError(
            f"joint {built.joint!r} is none of veselova, suslov; parallel_robot takes the others",
            path="system.legs",
        )
    if not built.actuated or built.w4 is None:
        raise InvalidProblemError(
            f"a leg that is {built.describe()}; the 3-ŬPU robot's are prismatic, with a motor",
            path="system.legs",
        )
    return built


def _reference(w4: Vector3) -> Vector3:
    """A unit vector ⟂ w4 in the platform: from the platform's normal, or its x axis where w4 is the normal."""
    axis: Vector3 = (0.0, 0.0, 1.0) if abs(w4[2]) < 0.9 else (1.0, 0.0, 0.0)
    along = sum(p * q for p, q in zip(axis, w4, strict=True))
    part = [p - along * q for p, q in zip(axis, w4, strict=True)]
    length = hypot(*part)
    return (part[0] / length, part[1] / length, part[2] / length)


def _symmetric_legs(
    base_radius: float, platform_radius: float, roller_tilt: float, platform_axis: str, joint: str
) -> tuple[Leg, ...]:
    for name, value in (("base_radius", base_radius), ("platform_radius", platform_radius)):
        if not value > 0:
            raise InvalidProblemError(
                f"{value:g} is not positive; a radius is a length > 0", path=f"system.{name}"
            )
    tilt = (cos(roller_tilt), sin(roller_tilt))
    around = (base_radius, platform_radius, tilt, platform_axis, joint)
    legs = [_around(2 * pi * k / 3, *around) for k in range(3)]
    return tuple(Leg(leg["base"], leg["platform"], leg["r"], leg["w4"], joint) for leg in legs)


def _around(
    azimuth: float,
    base_radius: Any,
    platform_radius: Any,
    tilt: tuple[Any, Any],
    platform_axis: str,
    joint: str,
) -> dict[str, tuple[Any, Any, Any]]:
    """A leg's vectors, numbers or symbols; ``tilt``: (cos β, sin β)."""
    c, s = cos(azimuth), sin(azimuth)
    radial, tangential, normal = (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)
    in_base = (tilt[1] * tangential[0], tilt[1] * tangential[1], tilt[0])
    return {
        "base": (base_radius * c, base_radius * s, 0.0),
        "platform": (platform_radius * c, platform_radius * s, 0.0),
        "r": in_base if joint == "veselova" else (tilt[0], tilt[1], 0.0),
        "w4": {"radial": radial, "tangential": tangential, "normal": normal}[platform_axis],
    }
