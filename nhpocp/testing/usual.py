"""Systems and tasks of nhpocp's own that laws are tried on where nobody names others."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Protocol

from nhpocp.controls.fourier import Fourier
from nhpocp.problem import PlanningProblem
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.systems.unicycle import Unicycle
from nhpocp.systems.veselova_joint import VeselovaJoint


class Choosy(Protocol):
    """What some systems lack."""

    def lacking(self, system: System) -> str: ...


@cache
def systems() -> tuple[System, ...]:
    """In the plane, on SO(3), without units, and a robot with legs."""
    return Unicycle(), VeselovaJoint(), Heisenberg(), ThreeUPU()


def that_have_it(member: Choosy) -> Iterator[System]:
    """Those of the systems that do not lack what a member of a family needs."""
    return (system for system in systems() if not member.lacking(system))


def one_that_has_it(member: Choosy) -> System:
    """The first of them. Errors: `AssertionError` where there is none."""
    for system in that_have_it(member):
        return system
    words = "; ".join(member.lacking(system) for system in systems())
    raise AssertionError(f"no system of nhpocp's own has it ({words}); name one that does")


@cache
def straight() -> PlanningProblem:
    """The Heisenberg system in x and y, by constants: the end point is linear in them, so one full step ends there."""
    start = {"x": 0, "y": 0, "z": 0}
    return PlanningProblem(
        system=Heisenberg(), start=start, goal={"x": 1, "y": 0.5}, basis=Fourier(0), name="straight"
    )


@cache
def loop() -> PlanningProblem:
    """The Heisenberg system up z, which takes a loop: the least effort is that of a circle, 2π."""
    initial = [[0, 1.0, 0.2], [0, 0.1, -1.0]]
    start, goal = {"x": 0, "y": 0, "z": 0}, {"x": 0, "y": 0, "z": 1}
    return PlanningProblem(
        system=Heisenberg(), start=start, goal=goal, basis=Fourier(1), initial=initial, name="loop"
    )
