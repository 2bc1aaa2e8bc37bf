"""How a leg is held to the base, as bodies: one class a kind of joint, announced once in `BASE_JOINTS`.

Each hangs a leg's first body into the base at the joint's centre. A roller is pressed against a ball and touches it in
one point: there the ball may spin about the line of contact and roll over the roller, which turns on its axle, and the
friction keeps it from slipping along the axle. That is the joint of [Paper] Fig. 1, and nothing else here makes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.machine.simulation.mjcf import Element, add, axes
from nhpocp.systems.legs import Leg

BALL, ROLLER = 0.2, 0.12  # radii, as shares of the mechanism's own length
BALL_MASS, ROLLER_MASS, FORK_MASS = 0.2, 0.02, 0.05  # kg
GUIDE_DAMPING = 20.0  # N s/m of the slide that presses a roller against its ball


@dataclass(frozen=True)
class Seat:
    """Where and how a leg is put: everything of one leg that a base joint needs, in metres and base coordinates."""

    number: int
    leg: Leg
    centre: Array  # of the joint
    frame: Array  # columns g, w3, g × w3 of the leg
    size: float  # the mechanism's own length
    press: float  # N
    friction: float

    @property
    def name(self) -> str:
        """Of the leg's first body."""
        return f"leg {self.number}"


@dataclass(frozen=True)
class Document:
    """The parts of an MJCF document that joints add to."""

    world: Element
    contact: Element
    actuator: Element


@dataclass(frozen=True)
class Roller:
    """A roller of the machine: the names of the two bodies that touch, and where.

    The point of contact is fixed in the body ``carrier``, at ``point`` beyond its origin; ``axle`` and ``normal``, the
    latter from the ball to the roller, are fixed there too. axle: (3,), or (2, 3) where no direction of the contact may
    slip.
    """

    leg: int
    ball: str
    roller: str
    carrier: str  # "" for the base
    point: Array
    normal: Array
    axle: Array


class BuiltJoint(Protocol):
    """One kind of base joint as bodies."""

    def build(self, seat: Seat, document: Document) -> tuple[Element, Roller | None]:
        """The leg's first body, whose frame is the leg's, hung into the base; and the roller, if there is one."""
        ...


class BallJoint(BuiltJoint):
    """A ball joint: an ordinary spherical one."""

    def build(self, seat: Seat, document: Document) -> tuple[Element, Roller | None]:
        body = _first_body(seat, document)
        add(body, "joint", name=f"ball {seat.number}", type_="ball", armature=1e-5)
        return body, None


class HookeJoint(BuiltJoint):
    """A universal joint: w1 in the base, w2 in the leg."""

    def build(self, seat: Seat, document: Document) -> tuple[Element, Roller | None]:
        leg = seat.leg
        if (
            leg.w1 is None or leg.w2 is None
        ):  # with a spherical joint at the platform the leg spins as it likes
            return BallJoint().build(seat, document)
        body = _first_body(seat, document)
        for name, axis in (("w1", seat.frame.T @ np.asarray(leg.w1)), ("w2", np.asarray(leg.w2))):
            add(body, "joint", name=f"{name} {seat.number}", type_="hinge", axis=axis, armature=1e-5)
        return body, None


class RollerInBase(BuiltJoint):
    """Veselova's joint: the leg's ball turns in the base, and a roller whose axle the base holds touches it."""

    def build(self, seat: Seat, document: Document) -> tuple[Element, Roller | None]:
        body, _ = BallJoint().build(seat, document)
        name = f"sphere {seat.number}"
        add(body, "geom", name=name, type_="sphere", size=BALL * seat.size, mass=BALL_MASS)
        r = np.asarray(seat.leg.r)
        outwards = np.array([seat.centre[0], seat.centre[1], 0.0])
        axle, normal = _across(r, outwards)
        point = BALL * seat.size * normal
        _mount(document.world, seat.centre + point, axle, normal, seat, document)
        return body, Roller(
            seat.number, seat.name, f"roller {seat.number}", "", seat.centre + point, normal, axle
        )


class RollerInLeg(BuiltJoint):
    """Suslov's joint: the base's ball stands still, and a roller whose axle the leg carries runs on it."""

    def build(self, seat: Seat, document: Document) -> tuple[Element, Roller | None]:
        body, _ = BallJoint().build(seat, document)
        add(body, "geom", type_="sphere", size=0.5 * BALL * seat.size, mass=BALL_MASS)
        ball = add(document.world, "body", name=f"ball {seat.number}", pos=seat.centre)
        add(ball, "geom", name=f"sphere {seat.number}", type_="sphere", size=BALL * seat.size)
        axle, normal = _across(np.asarray(seat.leg.r), np.array([-1.0, 0.0, 0.0]))  # away from the platform
        point = BALL * seat.size * normal
        _mount(body, point, axle, normal, seat, document)
        return body, Roller(
            seat.number, f"ball {seat.number}", f"roller {seat.number}", seat.name, point, normal, axle
        )


BASE_JOINTS: dict[str, BuiltJoint] = {
    "veselova": RollerInBase(),
    "suslov": RollerInLeg(),
    "universal": HookeJoint(),
    "spherical": BallJoint(),
}


def _first_body(seat: Seat, document: Document) -> Element:
    return add(document.world, "body", name=seat.name, pos=seat.centre, xyaxes=axes(seat.frame))


def _across(r: Array, side: Array) -> tuple[Array, Array]:
    """(axle, normal): where a roller sits that keeps a ball from turning about r, on that side as far as r allows.

    The axle is perpendicular to r and to the normal: the friction along it is what resists turning about r.
    """
    normal = side - (side @ r) * r
    if np.linalg.norm(normal) < 1e-3 * (np.linalg.norm(side) or 1.0):  # r itself points there
        normal = np.cross(r, [0.0, 0.0, 1.0] if abs(r[2]) < 0.9 else [1.0, 0.0, 0.0])
    normal = normal / np.linalg.norm(normal)
    return np.cross(r, normal), normal


def _mount(parent: Element, point: Array, axle: Array, normal: Array, seat: Seat, document: Document) -> None:
    """A roller on its axle, on a fork that slides along the normal and is pressed against the ball at the point."""
    number, radius = seat.number, ROLLER * seat.size
    fork = add(parent, "body", name=f"fork {number}", pos=point + radius * normal)
    add(fork, "inertial", pos=np.zeros(3), mass=FORK_MASS, diaginertia=np.full(3, 1e-5))
    slide, hinge = f"press {number}", f"axle {number}"
    add(fork, "joint", name=slide, type_="slide", axis=normal, damping=GUIDE_DAMPING)
    roller = add(fork, "body", name=f"roller {number}")
    add(roller, "joint", name=hinge, type_="hinge", axis=axle, armature=1e-6)
    add(roller, "geom", name=f"rim {number}", type_="sphere", size=radius, mass=ROLLER_MASS)
    # a force that needs no command
    add(
        document.actuator,
        "general",
        name=slide,
        joint=slide,
        gainprm=0,
        biastype="affine",
        biasprm=[-seat.press, 0, 0],
    )
    add(
        document.contact,
        "pair",
        name=f"contact {number}",
        geom1=f"sphere {number}",
        geom2=f"rim {number}",
        condim=3,
        friction=[seat.friction] * 2 + [0.0] * 3,
        solref=(0.002, 1),
        solimp=(0.99, 0.9999, 1e-4),
    )
