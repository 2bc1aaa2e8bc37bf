"""Parallel robots whose legs are given one by one: the equations that their joints make, and whether they suffice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin
from typing import Any, ClassVar, Self

from nhpocp.arrays import Array, cross, namespace, norm, symbolic
from nhpocp.bodies.hull import Hull, capsule, hull_of
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import Block, StateSpace, direction, rotation, vector
from nhpocp.systems.joints import BASE_JOINTS, LegPose, Row
from nhpocp.systems.legs import FIELDS, Leg, miscounted, numbered, several
from nhpocp.systems.solids import ball, rod, roller
from nhpocp.systems.system import Parameter, System

LEG = {  # of a file, the fields of `Leg`
    "base": Parameter("vector", ..., "centre of the base joint, base coordinates"),
    "platform": Parameter("vector", ..., "centre of the platform joint, platform coordinates"),
    "base_joint": Parameter(
        "choice", "veselova", "about which directions the leg can turn in the base", tuple(BASE_JOINTS)
    ),
    "r": Parameter(
        "vector", None, "about which it cannot: base coordinates (veselova), or along g, w3, g×w3 (suslov)"
    ),
    "w1": Parameter("vector", None, "axis of a universal base joint fixed in the base, base coordinates"),
    "w2": Parameter("vector", None, "its axis fixed in the leg, along g, w3, g×w3; default w3"),
    "w4": Parameter(
        "vector",
        None,
        "axis of the universal joint fixed in the platform; without it that joint is spherical",
    ),
    "length": Parameter(
        "length",
        None,
        "fixed (as at the start) or a length, of a bar; 0: the base joint holds the platform itself; absent: a "
        "prismatic joint",
    ),
    "actuated": Parameter("flag", None, "whether a motor drives the length; default: if it is prismatic"),
}
SIZES = {  # of bodies, for pictures and for distances
    "leg_radius": Parameter(
        "positive", None, "of the legs; default: 0.07 of the platform's size", unit="length", of_motion=False
    ),
    "thickness": Parameter(
        "positive", None, "of base and platform; default: flat plates", unit="length", of_motion=False
    ),
}
JOINTS = ("spheres", "universal joints")  # the points of a drawing


@dataclass(frozen=True)
class Kinematics:
    """The blocks of [Paper] eq. (1): u = G ṗ + K ω, a row a motor, and 0 = S ṗ + J ω, a row a constraint.

    For three ŬPU legs each is 3×3 and row i belongs to leg i; in general the rows stand in the order of the legs.
    """

    G: Array
    K: Array
    S: Array
    J: Array

    @property
    def W(self) -> Array:
        """[G K; S J], 6×6: singular where the actuators lose the platform."""
        return namespace(self.G).block([[self.G, self.K], [self.S, self.J]])


def _around(azimuth: float, radius: float, **leg: Any) -> dict[str, Any]:
    """A leg of a preset: vectors along the radial, tangential and vertical directions at an azimuth."""
    c, s = cos(azimuth), sin(azimuth)

    def turned(x: float, y: float, z: float) -> list[float]:
        return [c * x - s * y, s * x + c * y, z]

    in_leg = ("r", "w2") if leg.get("base_joint") == "suslov" else ("w2",)
    vectors = {
        name: turned(*value) if name not in in_leg else list(value)
        for name, value in leg.items()
        if isinstance(value, tuple)
    }
    return {"base": turned(radius, 0, 0), "platform": turned(radius / 2, 0, 0), **leg, **vectors}


THIRD = 2 * pi / 3
TILT = (0.0, sin(75 * pi / 180), cos(75 * pi / 180))  # of the 3-ŬPU robot's default
RADIAL, TANGENTIAL = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
FIRST_TWO = [
    _around(0.0, 30.0, base_joint="veselova", r=TILT, w4=RADIAL),
    _around(THIRD, 30.0, base_joint="suslov", r=(TILT[2], TILT[1], 0.0), w4=RADIAL),
]


class ParallelRobot(System):
    r"""A platform on legs of any kind, as a driftless control system on R³ × SO(3), control u (the motors' l̇):

        [G K; S J] (ṗ, ω) = (u, 0),   Ṙ = [ω] R                                       [Paper] eqs. (1), (3)-(4)

    p: platform origin in base coordinates [length], R: platform to base, b = p + R b̂. Motors give the rows of [G K],
    joints those of [S J] (`joints`); together they have to be six. Where joints are holonomic, motions stay on a part
    of R³ × SO(3) through the start (`invariants`), and only goals on it can be reached.
    """

    model: ClassVar[str] = "parallel_robot"
    declared: ClassVar[Mapping[str, Parameter]] = {
        "legs": Parameter(
            "jointed legs",
            None,
            "the legs, {base, platform, base_joint, r, w1, w2, w4, length, actuated} each; default: preset mixed",
            keys=LEG,
        ),
        **SIZES,
    }
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "mixed": {
            "legs": [
                *FIRST_TWO,
                _around(2 * THIRD, 30.0, base_joint="veselova", r=(0.4, 0.8, 0.45), w4=RADIAL),
            ]
        },
        "braced": {  # two non-holonomic legs, a motor between ball joints, and a bar
            "legs": [
                *FIRST_TWO,
                _around(2 * THIRD, 30.0, base_joint="spherical"),
                {
                    "base": [20.0, 30.0, 0.0],
                    "platform": [-10.0, 0.0, 0.0],
                    "base_joint": "spherical",
                    "length": "fixed",
                },
            ]
        },
        "translational": {  # [Tsai]'s 3-UPU robot: ordinary universal joints, nothing non-holonomic
            "legs": [
                _around(k * THIRD, 30.0, base_joint="universal", w1=TANGENTIAL, w4=TANGENTIAL)
                for k in range(3)
            ]
        },
    }

    example: ClassVar[Mapping[str, Any]] = {
        "start": {"position": [0, 0, 25], "orientation": {"rpy": [0, 0, "-30 deg"]}},
        "goal": {"position": [-0.4, -0.2, 30], "orientation": {"rpy": [0, 0, "-60 deg"]}},
    }
    state_space = StateSpace(
        [vector("position", 3, "length", symbol="p", words="position"), rotation("orientation")]
    )
    legs: tuple[Leg, ...]
    leg_radius: float | None = None
    thickness: float | None = None

    def __init__(
        self,
        legs: Sequence[Leg | Mapping[str, Any]] | None = None,
        leg_radius: float | None = None,
        thickness: float | None = None,
    ) -> None:
        self._set_sizes(leg_radius, thickness)
        given = self.presets["mixed"]["legs"] if legs is None else legs
        self._set_legs([numbered(i, leg, LEG) for i, leg in enumerate(several(given), 1)])
        self.input_space = StateSpace([vector("u", self.motors, "length")])

    def _set_sizes(self, leg_radius: float | None, thickness: float | None) -> None:
        for name, value in (("leg_radius", leg_radius), ("thickness", thickness)):
            if value is not None:
                setattr(self, name, SIZES[name].checked(name, value))

    def _sizes(self) -> dict[str, float]:
        """The sizes of bodies that were given."""
        given = {"leg_radius": self.leg_radius, "thickness": self.thickness}
        return {name: value for name, value in given.items() if value is not None}

    def _set_legs(self, legs: Sequence[Leg]) -> None:
        """Errors: `InvalidProblemError` where motors and constraints are not six."""
        self.legs = tuple(legs)
        self._mean_arm = _mean_arm(self.legs)
        kinds = [kind for leg in self.legs for kind in leg.constraint_kinds]
        self.motors = sum(bool(leg.actuated) for leg in self.legs)
        self.holonomic, self.non_holonomic = kinds.count("holonomic"), kinds.count("non-holonomic")
        rows = self.motors + self.holonomic + self.non_holonomic
        if rows != 6 or not self.motors:
            raise InvalidProblemError(miscounted(self.legs, rows, self.motors), path="system.legs")
        free = sum(not leg.pinned for leg in self.legs)
        self.output_blocks: Sequence[Block] = (
            vector("leg_lengths", free, "length", symbol="l", words="leg length", of_pose=True),
            # the direction of the platform's z axis, base coordinates
            direction("platform_normal", of_pose=True),
        )

    def parameters(self) -> dict[str, Any]:
        return {"legs": [leg_data(leg, LEG) for leg in self.legs], **self._sizes()}

    def in_symbols(self, vectors: Sequence[Mapping[str, Sequence[Array]]]) -> Self:
        """A twin for formulas, whose legs have other vectors, of symbols; nothing is checked, and it is no problem's.

        vectors: of each leg, by the names of `Leg`, three numbers or symbols each; those that are left out stay.
        """
        twin = object.__new__(type(self))
        legs = tuple(leg.in_symbols(own) for leg, own in zip(self.legs, vectors, strict=True))
        twin.__dict__.update({**self.__dict__, "legs": legs})
        return twin

    @property
    def shape(self) -> tuple[str, ...]:
        """Parameters, numbers of all legs alike, of which `shaped` makes the legs' vectors."""
        return ()

    def shaped(self, number: int, values: Mapping[str, Array]) -> dict[str, tuple[Array, Array, Array]]:
        """The vectors of a leg (from 0), by the names of `Leg`, for values of the `shape`, which may be symbols."""
        return {}

    # --- equations ---

    def pose(self, state: Array) -> tuple[Array, Array]:
        """(p, R) of a packed state."""
        values = self.state_space.unpack(state)
        return values["position"], values["orientation"]

    def leg_poses(self, state: Array) -> list[LegPose]:
        """Geometry of the legs at a packed state."""
        position, rotation_platform_to_base = self.pose(state)
        return [leg.pose(position, rotation_platform_to_base) for leg in self.legs]

    def actuator_rows(self, leg: Leg, pose: LegPose, arm: Array) -> list[Row]:
        """A leg's rows of G and of K; ``arm`` = b - p."""
        return leg.actuators(pose, arm)

    def constraint_rows(self, leg: Leg, pose: LegPose, arm: Array) -> list[Row]:
        """A leg's rows of S and of J."""
        rows = leg.constraints(pose, arm)
        if leg.pinned and leg.holds_a_turn:  # r · ω alone is the one row that is no velocity [length/time]
            rows[-1] = rows[-1]._replace(scale=1.0 / self.default_length_scale())
        return rows

    def rows(self, state: Array) -> tuple[list[Row], list[Row]]:
        """(motors, constraints) at a packed state, in the order of the legs."""
        position, _ = self.pose(state)
        motors: list[Row] = []
        constraints: list[Row] = []
        for leg, pose in zip(self.legs, self.leg_poses(state), strict=True):
            motors += self.actuator_rows(leg, pose, pose.b - position)
            constraints += self.constraint_rows(leg, pose, pose.b - position)
        return motors, constraints

    def kinematics(self, state: Array) -> Kinematics:
        """G, K, S, J of [Paper] eq. (1) at a packed state."""
        xp, (motors, constraints) = namespace(state), self.rows(state)
        return Kinematics(
            G=xp.rows([row.of_p for row in motors]),
            K=xp.rows([row.of_omega for row in motors]),
            S=xp.rows([row.of_p / row.scale for row in constraints]),
            J=xp.rows([row.of_omega / row.scale for row in constraints]),
        )

    def matrix(self, state: Array) -> Array:
        """W of [Paper] eq. (4), which times the velocity is (u, 0)."""
        return self.kinematics(state).W

    def velocity(self, state: Array, control: Array) -> Array:
        # [Paper] eqs. (3)-(4); det G and det S may vanish here, det W may not
        xp = namespace(state, control)
        still = xp.array([0.0] * (self.state_space.dimension - self.motors))
        return xp.solve(self.matrix(state), xp.concatenate([control, still]))

    def linearised(self, state: Array, control: Array) -> Array:
        """W (ṗ, ω) = (u, 0) differentiated with (ṗ, ω) held."""
        xp, dimension = symbolic(), self.state_space.dimension
        held, matrix = xp.symbol(dimension), self.matrix(state)
        change = xp.substitute(xp.jacobian(matrix @ held, state), held, self.velocity(state, control))
        return xp.solve(matrix, xp.block([[-change, xp.eye(dimension)[:, : self.motors]]]))

    def vector_fields(self, state: Array) -> Array:
        xp, dimension = namespace(state), self.state_space.dimension
        return xp.solve(self.matrix(state), xp.eye(dimension)[:, : self.motors])

    def invariants(self, state: Array) -> dict[str, tuple[Array, float | None]]:
        held: dict[str, tuple[Array, float | None]] = {}
        for i, leg in enumerate(self.legs, 1):
            if "holonomic" in leg.constraint_kinds:
                values = leg.invariants(leg.pose(*self.pose(state)))
                held |= {f"leg {i}: {name}": value for name, value in values.items()}
        return held

    # --- what it shows ---

    def outputs(self, state: Array, control: Array) -> dict[str, Array]:
        return {name: self.output(name, state, control) for name in ("leg_lengths", "platform_normal")}

    def output(self, name: str, state: Array, control: Array) -> Array:
        if name == "leg_lengths":
            poses = zip(self.legs, self.leg_poses(state), strict=True)
            return namespace(state).vector([pose.length for leg, pose in poses if not leg.pinned])
        if name == "platform_normal":
            return self.pose(state)[1][:, 2]
        return super().output(name, state, control)

    def actuator_positions(self, state: Array) -> Array:
        """The lengths of the legs with a motor."""
        poses = zip(self.legs, self.leg_poses(state), strict=True)
        return namespace(state).vector([pose.length for leg, pose in poses if leg.actuated])

    def regularity(self, state: Array) -> dict[str, Array]:
        return {"w": self.matrix(state)}

    def column_scales(self, name: str, length_scale: float) -> list[float]:
        return [1.0] * 3 + [length_scale] * 3

    def breaking(self) -> tuple[str, ...]:
        return ("w",)

    def joint_sines(self, state: Array) -> list[Array]:
        """Between each leg and the axis w4 of its universal joint, which turns the leg about itself."""
        pairs = [(pose.g, pose.w4) for pose in self.leg_poses(state) if pose.w4 is not None]
        return [norm(cross(g, w4)) / norm(w4) for g, w4 in pairs]

    def default_length_scale(self) -> float:
        return self._mean_arm

    @property
    def _leg_radius(self) -> float:
        return self.leg_radius or 0.07 * self.default_length_scale()

    def bodies(self, state: Array) -> dict[str, Hull]:
        """Base, platform and legs; what shares a joint touches."""
        (position, turned), thickness = self.pose(state), self.thickness or 0.0
        base = hull_of([leg.base for leg in self.legs], thickness)
        platform = hull_of([leg.platform for leg in self.legs], thickness)
        platform = platform.moved(position, turned)
        pinned = ["platform" for leg in self.legs if leg.pinned]
        bodies = {"base": replace(base, fixed=True).touching(*pinned), "platform": platform}
        for i, (leg, pose) in enumerate(zip(self.legs, self.leg_poses(state), strict=True), 1):
            if not leg.pinned:
                shared = [
                    f"leg {k}"
                    for k, other in enumerate(self.legs, 1)
                    if k != i and (leg.base == other.base or leg.platform == other.platform)
                ]
                bodies[f"leg {i}"] = capsule(pose.a, pose.b, self._leg_radius).touching(
                    "base", "platform", *shared
                )
        return bodies

    def drawing(self, state: Array) -> dict[str, Any]:
        """Both bodies, the legs, and the directions of their joints, from the middle of each joint."""
        xp, poses = namespace(state), self.leg_poses(state)
        reach = 0.3 * self.default_length_scale()
        base, platform = [pose.a for pose in poses], [pose.b for pose in poses]
        lines = {"base": xp.rows([*base, base[0]]), "platform": xp.rows([*platform, platform[0]])}
        points: dict[str, list[Array]] = {kind: [] for kind in JOINTS}
        solids: dict[str, Any] = {}
        for i, (leg, pose) in enumerate(zip(self.legs, poses, strict=True), 1):
            points["universal joints" if leg.joint == "universal" else "spheres"].append(pose.a)
            if not leg.pinned:
                lines[f"leg {i}"] = xp.rows([pose.a, pose.b])
                points["spheres" if leg.w4 is None else "universal joints"].append(pose.b)
            if pose.r is not None:
                lines[f"r {i}"] = xp.rows([pose.a, pose.a + reach * pose.r])
            if pose.w4 is not None:
                for name, axis in (("w3", pose.w3), ("w4", pose.w4)):
                    lines[f"{name} {i}"] = xp.rows([pose.b - 0.5 * reach * axis, pose.b + 0.5 * reach * axis])
            solids |= self._solids(i, leg, pose, lines)
        drawn = {name: xp.rows(places) for name, places in points.items() if places}
        return {"lines": lines, "points": drawn, "solids": solids}

    def _solids(self, number: int, leg: Leg, pose: LegPose, lines: Mapping[str, Array]) -> dict[str, Any]:
        """The bodies of one leg: its tube, the balls at its ends, their rollers, the crosses of universal joints."""
        xp, size = namespace(pose.a), self.default_length_scale()
        radius = (0.11 if pose.r is None else 0.2) * size
        turned = xp.eye(3) if pose.w3 is None else xp.rows([pose.g, pose.w3, cross(pose.g, pose.w3)]).T
        solids: dict[str, Any] = {f"sphere {number}": ball(pose.a, turned, radius, *JOINTS)}
        if not leg.pinned:
            solids[f"leg {number}"] = rod(pose.a, pose.b, self._leg_radius)
            if leg.w4 is None:
                solids[f"head {number}"] = ball(pose.b, turned, 0.09 * size)
        if pose.r is not None and leg.joint != "universal":
            outwards = -pose.g if leg.joint == "suslov" else xp.array([pose.a[0], pose.a[1], 0.0])
            solids[f"roller {number}"] = roller(pose.a, pose.r, outwards, radius)
            solids[f"r {number}"] = rod(pose.a, pose.a + 1.7 * radius * pose.r, 0.03 * size)
        for name in (f"w3 {number}", f"w4 {number}"):
            if name in lines:
                solids[name] = rod(lines[name][0], lines[name][1], 0.035 * size)
        return solids


def leg_data(leg: Leg, declared: Mapping[str, Parameter]) -> dict[str, Any]:
    """A leg as plain data under its file's keys; what has no value is left out."""
    values = {key: getattr(leg, FIELDS.get(key, key)) for key in declared}
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in values.items()
        if value is not None
    }


def _mean_arm(legs: Sequence[Leg]) -> float:
    """Of the platform's joints from its origin; of the base's where all of those meet there."""
    free = [leg for leg in legs if not leg.pinned]
    for arms in ([hypot(*leg.platform) for leg in free], [hypot(*leg.base) for leg in legs]):
        if any(arms):
            return sum(arms) / len(arms)
    return 1.0
