"""What a leg of a parallel robot is made of, and the equations that each part puts on the platform's velocity.

An equation is a `Row` on (ṗ, ω), the velocity of the platform's origin and its angular velocity, base coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

from nhpocp.arrays import Array, cross, dot, namespace, norm, unit

Vector3 = tuple[float, float, float]


class Row(NamedTuple):
    """``of_p · ṗ + of_omega · ω``, by ``scale`` larger than the row that the source prints."""

    of_p: Array
    of_omega: Array
    scale: Array | float = 1.0


@dataclass(frozen=True)
class LegPose:
    """The vectors of one leg at one pose, in base coordinates, by the paper's letters: [Paper] section 2, Fig. 1.

    A leg without a universal joint at the platform spins as it likes: its w3, w4, h and r are None. Of a leg of
    length zero the platform itself takes the place: g and w3 are its first two axes.
    """

    a: Array  # centre of the base joint
    b: Array  # centre of the platform joint
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
        w1 = unit(xp.where(squared > 1e-12 * dot(self.a, self.a), towards, spare))
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


# --- base joints ------------------------------------------------------------------------------------------------------


class BaseJoint(Protocol):
    """How a leg is held to the base: r, the direction about which it cannot turn, if there is one.

    ``holonomic``: whether the constraint r · ω_leg = 0 is the derivative of an equation of the pose.
    """

    name: ClassVar[str]
    holonomic: ClassVar[bool] = False

    def normal(self, g: Array, w3: Array) -> Array | None:
        """r in base coordinates from the leg's first two axes; None: the leg turns about every direction."""
        ...

    def invariant(self, g: Array, w3: Array) -> Array | None:
        """What a holonomic joint holds at zero."""
        return None


@dataclass(frozen=True)
class Veselova(BaseJoint):
    """A roller on the leg's ball, its axle fixed in the base: r is constant in the base. [Paper] section 2"""

    r: Vector3
    name: ClassVar[str] = "veselova"

    def normal(self, g: Array, w3: Array) -> Array:
        return namespace(g).vector(self.r)


@dataclass(frozen=True)
class Suslov(BaseJoint):
    """A roller whose axle the leg carries: r is constant along g, w3, g × w3. [Paper] section 2"""

    r: Vector3
    name: ClassVar[str] = "suslov"

    def normal(self, g: Array, w3: Array) -> Array:
        return _in_leg(self.r, g, w3)


@dataclass(frozen=True)
class Universal(BaseJoint):
    """The ordinary universal joint, w1 fixed in the base and w2 in the leg (along g, w3, g × w3), w1 ⟂ w2.

    d(w1·w2)/dt = w1 · (ω_leg × w2) = ω_leg · (w2 × w1): the leg does not turn about r = w1 × w2, as the paper's
    section 2 has it of any joint with two freedoms; but this r makes the equation one of the pose, w1 · w2 = 0.
    """

    w1: Vector3
    w2: Vector3
    name: ClassVar[str] = "universal"
    holonomic: ClassVar[bool] = True

    def normal(self, g: Array, w3: Array) -> Array:
        return cross(namespace(g).vector(self.w1), _in_leg(self.w2, g, w3))

    def invariant(self, g: Array, w3: Array) -> Array:
        return dot(namespace(g).vector(self.w1), _in_leg(self.w2, g, w3))


@dataclass(frozen=True)
class Spherical(BaseJoint):
    """The ordinary ball joint, which takes away no turning."""

    name: ClassVar[str] = "spherical"

    def normal(self, g: Array, w3: Array) -> None:
        return None


BASE_JOINTS: dict[str, type[BaseJoint]] = {
    joint.name: joint for joint in (Veselova, Suslov, Universal, Spherical)
}


def _in_leg(along: Vector3, g: Array, w3: Array) -> Array:
    """A vector fixed in the leg."""
    return along[0] * g + along[1] * w3 + along[2] * cross(g, w3)


def turning_row(pose: LegPose, arm: Array) -> Row:
    """r · ω_leg = 0 as a row of S and of J, [Paper] eq. (2); ``arm`` = b - p.

    With w3 and g left unnormalised the rows are polynomials in the pose (Veselova); (7), blind to the scale of a row,
    evaluates and differentiates faster than the square roots. The scale is l² |(b - a) × w4|.
    """
    h = cross(cross(pose.span, pose.w4), pose.w4)
    moment, squared = cross(h, pose.r), dot(pose.span, pose.span)
    s = squared * moment - dot(pose.span, moment) * pose.span
    j = cross(arm, s) - squared * dot(pose.r, pose.span) * h
    return Row(s, j, pose.length * pose.length * norm(cross(pose.span, pose.w4)))


# --- lengths ----------------------------------------------------------------------------------------------------------


class Extent(Protocol):
    """What there is between a leg's two joints."""

    def actuators(self, pose: LegPose, arm: Array) -> list[Row]:
        """Rows whose value is an input."""
        return []

    def constraints(self, pose: LegPose, arm: Array) -> list[Row]:
        """Rows whose value is zero, those of the base joint aside."""
        return []

    def turning(self, pose: LegPose, arm: Array) -> Row:
        """The row of r · ω_leg = 0."""
        return turning_row(pose, arm)


@dataclass(frozen=True)
class Prismatic(Extent):
    """A sliding joint, driven or not: u = l̇ = gᵀ(ṗ + ω × (b - p)), a row of G and of K, [Paper] eq. (2)."""

    actuated: bool

    def actuators(self, pose: LegPose, arm: Array) -> list[Row]:
        return [Row(pose.g, cross(arm, pose.g))] if self.actuated else []


@dataclass(frozen=True)
class Rigid(Extent):
    """A bar: l̇ = 0, the row of a prismatic leg as a constraint, holonomic. ``length`` None: as at the start."""

    length: float | None

    def constraints(self, pose: LegPose, arm: Array) -> list[Row]:
        return [Row(pose.g, cross(arm, pose.g))]


@dataclass(frozen=True)
class Pinned(Extent):
    """No bar at all, the base joint holds the platform itself: b stays at a, ṗ + ω × (b - p) = 0, holonomic."""

    def constraints(self, pose: LegPose, arm: Array) -> list[Row]:
        xp = namespace(arm)
        axes = [xp.array(axis) for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1])]
        return [Row(axis, cross(arm, axis)) for axis in axes]

    def turning(self, pose: LegPose, arm: Array) -> Row:
        """r · ω = 0 of the platform."""
        return Row(0.0 * arm, pose.r)
