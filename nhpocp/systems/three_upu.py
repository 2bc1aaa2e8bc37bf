"""The 3-ŬPU parallel robot: three prismatic legs, each held to the base by a non-holonomic joint. [Paper] section 2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, isfinite, pi, sin
from typing import Any, ClassVar, Literal

from nhpocp.arrays import Array, cross, dot, namespace, norm, solve_3x3, symbolic, unit
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import Block, StateSpace, direction, rotation, vector
from nhpocp.systems.system import Parameter, System

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Leg:
    """One leg as built: joint centres a (base) and b̂ (platform coordinates), roller normal r, platform axis w4.

    ``r`` is the direction about which the base joint cannot turn: fixed in the base for the Veselova joint (base
    coordinates), fixed in the leg for the Suslov joint (coordinates along g, w3, g × w3). r and w4 become unit vectors.
    """

    base: Vector3
    platform: Vector3
    r: Vector3
    w4: Vector3
    joint: Literal["veselova", "suslov"] = "veselova"

    def __post_init__(self) -> None:
        for name in ("base", "platform", "r", "w4"):
            values = tuple(float(value) for value in getattr(self, name))
            if len(values) != 3:
                raise InvalidProblemError(
                    f"{name} of a leg has {len(values)} numbers; expected 3", path="system.legs"
                )
            if not all(isfinite(value) for value in values):
                raise InvalidProblemError(
                    f"{name} of a leg is {values}; expected finite numbers", path="system.legs"
                )
            if name in ("r", "w4"):
                length = hypot(*values)
                if length < 1e-9:
                    raise InvalidProblemError(
                        f"{name} of a leg is the zero vector; expected a direction", path="system.legs"
                    )
                if abs(length - 1) > 1e-15:  # else as it came: parameters() must round-trip exactly
                    values = tuple(value / length for value in values)
            object.__setattr__(self, name, values)
        if self.joint not in ("veselova", "suslov"):
            raise InvalidProblemError(f"joint {self.joint!r} is none of veselova, suslov", path="system.legs")


@dataclass(frozen=True)
class LegPose:
    """The vectors of one leg at one pose, in base coordinates, by the paper's letters: [Paper] section 2, Fig. 1."""

    a: Array  # centre of the sphere
    b: Array  # centre of the universal joint
    span: Array  # b - a
    length: Array  # l = |b - a|
    g: Array  # (b - a)/l
    r: Array  # roller normal; the base joint cannot turn about it
    w3: Array  # first axis of the universal joint, carried by the leg: g × w4 / |g × w4|
    w4: Array  # second axis, fixed in the platform
    h: Array  # w3 × w4

    def base_axes(self) -> tuple[Array, Array]:
        """(w1, w2): the right-handed frame {w1, w2, r} with w1 along the part of a perpendicular to r."""
        xp = namespace(self.a, self.r)
        towards = self.a - dot(self.a, self.r) * self.r
        squared = dot(towards, towards)
        # a parallel to r leaves w1 free: any perpendicular serves, e.g. the one nearest the x axis, else the y axis
        spare = xp.where(
            self.r[0] * self.r[0] < 0.9,
            xp.array([1.0, 0.0, 0.0]) - self.r[0] * self.r,
            xp.array([0.0, 1.0, 0.0]) - self.r[1] * self.r,
        )
        w1 = unit(xp.where(squared > 1e-12 * (1 + dot(self.a, self.a)), towards, spare))
        return w1, cross(self.r, w1)

    def joint_angles(self, reference: Array) -> Array:
        """(θ1, θ2, θ3, θ4) [rad]; ``reference`` is a platform-fixed unit vector ⟂ w4, from which θ4 counts.

        θ1 about w1 and then θ2 about w2 turn r into g: the angles that an ordinary universal joint would show. The
        non-holonomic joint's own rates ω_leg·w1, ω_leg·w2 are no time derivatives of them (nor of any function of the
        pose: that is what makes the joint non-holonomic). θ3 is the angle about w3 from g to w4, θ4 about w4 from the
        reference to w3.
        """
        xp = namespace(self.g, reference)
        w1, w2 = self.base_axes()
        along, across = dot(self.g, self.r), dot(self.g, w2)
        return xp.vector(
            [
                xp.atan2(-across, along),
                xp.atan2(dot(self.g, w1), xp.sqrt(across * across + along * along)),
                xp.atan2(norm(cross(self.g, self.w4)), dot(self.g, self.w4)),
                xp.atan2(dot(self.w4, cross(reference, self.w3)), dot(reference, self.w3)),
            ]
        )


@dataclass(frozen=True)
class Kinematics:
    """The blocks of [Paper] eq. (1), each 3×3: u = G ṗ + K ω and 0 = S ṗ + J ω. Row i belongs to leg i."""

    G: Array
    K: Array
    S: Array
    J: Array

    @property
    def W(self) -> Array:
        """[G K; S J], 6×6: singular where the actuators lose the platform."""
        return namespace(self.G).block([[self.G, self.K], [self.S, self.J]])


class ThreeUPU(System):
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
            "positive", 30.0, "A, distance of the spheres from the base's axis [length]"
        ),
        "platform_radius": Parameter(
            "positive", 15.0, "B, distance of the universal joints from the platform's axis [length]"
        ),
        "roller_tilt": Parameter(
            "number", 75 * pi / 180, "β, angle of r from the vertical towards the tangent [rad]"
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
            "legs", None, "three explicit legs {base, platform, r, w4, joint} instead of all of the above"
        ),
        "form": Parameter(
            "choice",
            "feedback",
            "feedback: eq. (7), control v; original: eq. (3), control u",
            ("feedback", "original"),
        ),
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

    state_space = StateSpace([vector("position", 3, "length"), rotation("orientation")])
    output_names: ClassVar[tuple[str, ...]] = ("u", "v", "leg_lengths", "joint_angles", "platform_normal")
    # platform_normal: the direction of the platform's z axis, base coordinates
    pose_outputs: ClassVar[tuple[Block, ...]] = (
        vector("leg_lengths", 3, "length"),
        direction("platform_normal"),
    )

    def __init__(
        self,
        base_radius: float = 30.0,
        platform_radius: float = 15.0,
        roller_tilt: float = 75 * pi / 180,
        platform_axis: str = "radial",
        joint: str = "veselova",
        legs: Sequence[Leg | Mapping[str, Any]] | None = None,
        form: str = "feedback",
    ) -> None:
        for name, value in (("platform_axis", platform_axis), ("joint", joint), ("form", form)):
            if value not in self.declared[name].choices:
                raise InvalidProblemError(
                    f"{value!r} is none of {', '.join(self.declared[name].choices)}", path=f"system.{name}"
                )
        self._shape: dict[str, Any] = {
            "base_radius": float(base_radius),
            "platform_radius": float(platform_radius),
            "roller_tilt": float(roller_tilt),
            "platform_axis": platform_axis,
            "joint": joint,
        }
        for name, value in self._shape.items():
            if isinstance(value, float) and not isfinite(value):
                raise InvalidProblemError(f"{value:g}; expected a finite number", path=f"system.{name}")
        self.form = form
        self._explicit = legs is not None
        self.legs = tuple(_leg(leg) for leg in legs) if legs is not None else _symmetric_legs(**self._shape)
        if len(self.legs) != 3:
            raise InvalidProblemError(f"{len(self.legs)} legs; the 3-ŬPU robot has 3", path="system.legs")
        speeds = vector("v", 3, "angle") if form == "feedback" else vector("u", 3, "length")
        self.input_space = StateSpace([speeds])

    def parameters(self) -> dict[str, Any]:
        if self._explicit:
            legs = [
                {**vars(leg), **{k: list(v) for k, v in vars(leg).items() if k != "joint"}}
                for leg in self.legs
            ]
            return {"legs": legs, "form": self.form}
        return {**self._shape, "form": self.form}

    def with_form(self, form: str) -> ThreeUPU:
        """The same robot in the other form of its equations."""
        return type(self)(**{**self.parameters(), "form": form})

    def leg_poses(self, state: Array) -> list[LegPose]:
        """Geometry of the three legs at a packed pose."""
        xp, pose = namespace(state), self.state_space.unpack(state)
        position, rotation_platform_to_base = pose["position"], pose["orientation"]
        poses = []
        for leg in self.legs:
            a = xp.array(leg.base)
            b = position + rotation_platform_to_base @ xp.array(leg.platform)
            w4 = rotation_platform_to_base @ xp.array(leg.w4)
            length = norm(b - a)
            g = (b - a) / length
            w3 = unit(cross(g, w4))
            r = xp.array(leg.r)
            if leg.joint == "suslov":
                r = r[0] * g + r[1] * w3 + r[2] * cross(g, w3)
            poses.append(LegPose(a, b, b - a, length, g, r, w3, w4, cross(w3, w4)))
        return poses

    def actuator_row(self, leg: LegPose, arm: Array) -> tuple[Array, Array]:
        """Row of G and of K, [Paper] eq. (2); ``arm`` = b - p."""
        return leg.g, cross(arm, leg.g)

    def constraint_row(self, leg: LegPose, arm: Array) -> tuple[Array, Array]:
        """Row of S and of J, [Paper] eq. (2), times `constraint_scale`: the leg does not turn about r.

        With w3 and g left unnormalised the rows are polynomials in the pose (Veselova); (7), blind to the scale of
        a row, evaluates and differentiates faster than the square roots.
        """
        h = cross(cross(leg.span, leg.w4), leg.w4)
        moment, squared = cross(h, leg.r), dot(leg.span, leg.span)
        s = squared * moment - dot(leg.span, moment) * leg.span
        return s, cross(arm, s) - squared * dot(leg.r, leg.span) * h

    def constraint_scale(self, leg: LegPose) -> Array:
        """l² |(b - a) × w4|, by which `constraint_row` exceeds the rows of eq. (2)."""
        return leg.length * leg.length * norm(cross(leg.span, leg.w4))

    def kinematics(self, state: Array) -> Kinematics:
        """G, K, S, J of [Paper] eq. (1) at a packed pose."""
        xp = namespace(state)
        position = state[self.state_space.point_slice("position")]
        legs = self.leg_poses(state)
        actuators = [self.actuator_row(leg, leg.b - position) for leg in legs]
        constraints = [self.constraint_row(leg, leg.b - position) for leg in legs]
        scales = [self.constraint_scale(leg) for leg in legs]
        return Kinematics(
            G=xp.rows([g for g, _ in actuators]),
            K=xp.rows([k for _, k in actuators]),
            S=xp.rows([s / scale for (s, _), scale in zip(constraints, scales, strict=True)]),
            J=xp.rows([j / scale for (_, j), scale in zip(constraints, scales, strict=True)]),
        )

    def translation(self, state: Array, v: Array) -> Array:
        """ṗ = S⁻¹ J v, [Paper] eq. (7)."""
        position = state[self.state_space.point_slice("position")]
        rows = [self.constraint_row(leg, leg.b - position) for leg in self.leg_poses(state)]
        right = namespace(state, v).vector([dot(j, v) for _, j in rows])
        return solve_3x3([s for s, _ in rows], right)

    def velocity(self, state: Array, control: Array) -> Array:
        xp = namespace(state, control)
        if self.form == "feedback":  # [Paper] eq. (7)
            return xp.concatenate([self.translation(state, control), -control])
        # [Paper] eqs. (3)-(4); det G and det S may vanish here, det W may not
        return xp.solve(self.kinematics(state).W, xp.concatenate([control, 0.0 * control]))

    def linearised(self, state: Array, control: Array) -> tuple[Array, Array]:
        if self.form != "feedback":
            return self._linearised_original(state, control)
        # S ṗ = J v differentiated with ṗ held: d(S⁻¹ J v) = S⁻¹ d(J v - S ṗ), a third of the operations
        xp = symbolic()
        held = xp.symbol(3)
        position = state[self.state_space.point_slice("position")]
        rows = [self.constraint_row(leg, leg.b - position) for leg in self.leg_poses(state)]
        s, j = [row for row, _ in rows], xp.rows([row for _, row in rows])
        residual = j @ control - xp.vector([dot(row, held) for row in s])
        change = xp.substitute(xp.jacobian(residual, state), held, solve_3x3(s, j @ control))
        inverse = solve_3x3(s, xp.eye(3))
        of_the_turn = 0.0 * change, -xp.eye(3)  # ω = -v whatever the pose
        return (
            xp.block([[inverse @ change], [of_the_turn[0]]]),
            xp.block([[inverse @ j], [of_the_turn[1]]]),
        )

    def _linearised_original(self, state: Array, u: Array) -> tuple[Array, Array]:
        """W (ṗ, ω) = (u, 0) differentiated with (ṗ, ω) held, as above."""
        xp = symbolic()
        held, W = xp.symbol(6), self.kinematics(state).W
        change = xp.substitute(xp.jacobian(W @ held, state), held, self.velocity(state, u))
        solved = xp.solve(W, xp.block([[-change, xp.eye(6)[:, :3]]]))
        size = self.state_space.size
        return solved[:, :size], solved[:, size:]

    def vector_fields(self, state: Array) -> Array:
        xp = namespace(state)
        columns = [self.velocity(state, xp.array(axis)) for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1])]
        return xp.rows(columns).T

    def feedback(self, state: Array, v: Array) -> Array:
        """Leg speeds u = (G S⁻¹ J - K) v, which equals [Paper] eq. (6)."""
        blocks = self.kinematics(state)
        return blocks.G @ self.translation(state, v) - blocks.K @ v

    def inverse_feedback(self, state: Array, u: Array) -> Array:
        """v = -ω of the motion under leg speeds u; needs det W ≠ 0 only."""
        xp = namespace(state, u)
        return -xp.solve(self.kinematics(state).W, xp.concatenate([u, 0.0 * u]))[3:6]

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        xp, legs = namespace(state, control), self.leg_poses(state)
        orientation = self.state_space.unpack(state)["orientation"]
        other = "u" if self.form == "feedback" else "v"
        angles = [
            pose.joint_angles(orientation @ xp.array(_reference(leg.w4)))
            for pose, leg in zip(legs, self.legs, strict=True)
        ]
        return {
            other: self.output(other, state, control),
            "leg_lengths": xp.vector([leg.length for leg in legs]),
            "joint_angles": xp.rows(angles),
            "platform_normal": orientation[:, 2],
        }

    def output(self, name: str, state: Array, control: Array) -> Array:
        if name == "u" and self.form == "feedback":
            return self.feedback(state, control)
        if name == "v" and self.form == "original":
            return self.inverse_feedback(state, control)
        if name == "leg_lengths":
            return namespace(state).vector([leg.length for leg in self.leg_poses(state)])
        if name == "platform_normal":
            return self.state_space.unpack(state)["orientation"][:, 2]
        return super().output(name, state, control)

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

    def default_length_scale(self) -> float:
        return sum(hypot(*leg.platform) for leg in self.legs) / 3 or 1.0

    def input_label(self) -> str:
        return self.input_space.names[0]

    def drawing(self, state: Array) -> dict[str, Any]:
        xp = namespace(state)
        legs = self.leg_poses(state)
        reach = 0.12 * max(float(leg.length) for leg in legs)
        base, platform = [leg.a for leg in legs], [leg.b for leg in legs]
        lines = {"base": xp.rows([*base, base[0]]), "platform": xp.rows([*platform, platform[0]])}
        for i, leg in enumerate(legs, 1):
            lines[f"leg {i}"] = xp.rows([leg.a, leg.b])
            lines[f"r {i}"] = xp.rows([leg.a, leg.a + reach * leg.r])
            lines[f"w3 {i}"] = xp.rows([leg.b - 0.5 * reach * leg.w3, leg.b + 0.5 * reach * leg.w3])
            lines[f"w4 {i}"] = xp.rows([leg.b - 0.5 * reach * leg.w4, leg.b + 0.5 * reach * leg.w4])
        return {"lines": lines, "points": {"spheres": xp.rows(base), "universal joints": xp.rows(platform)}}


def _leg(leg: Leg | Mapping[str, Any]) -> Leg:
    if isinstance(leg, Leg):
        return leg
    if not {"base", "platform", "r", "w4"} <= set(leg) <= {"base", "platform", "r", "w4", "joint"}:
        raise InvalidProblemError(
            f"a leg with {', '.join(leg)}; expected base, platform, r, w4, joint", path="system.legs"
        )
    return Leg(**leg)


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
    legs = []
    for k in range(3):
        c, s = cos(2 * pi * k / 3), sin(2 * pi * k / 3)
        radial, tangential, normal = (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)
        tilt = (cos(roller_tilt), sin(roller_tilt))
        r = (
            (tilt[1] * tangential[0], tilt[1] * tangential[1], tilt[0])
            if joint == "veselova"
            else (tilt[0], tilt[1], 0.0)
        )
        w4 = {"radial": radial, "tangential": tangential, "normal": normal}[platform_axis]
        base = (base_radius * c, base_radius * s, 0.0)
        legs.append(Leg(base, (platform_radius * c, platform_radius * s, 0.0), r, w4, joint))  # type: ignore[arg-type]
    return tuple(legs)
