"""What a machine is built as: a text for the engine, and where in it the motors and contacts are."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

from nhpocp.arrays import Array
from nhpocp.machine.simulation.base_joints import Document, Roller
from nhpocp.machine.simulation.mjcf import Element, add
from nhpocp.machine.simulation.settings import MachineSettings

STEP = 5e-4  # s


@dataclass(frozen=True)
class Built:
    """A machine as text.

    text: MJCF. metres: to a unit of length. body: whose pose is measured. motors: names of the driven joints, which are
    those of their actuators; lengths: what they measure in the pose that it is built in [length]. rollers: where it
    rolls.
    """

    text: str
    metres: float
    body: str
    motors: tuple[str, ...]
    lengths: Array
    rollers: tuple[Roller, ...]


@dataclass(frozen=True)
class Drive:
    """What the motors of a machine follow: columns of an array of the plan's trajectory.

    name: what it is called where it was measured. labels: of the motors, in words.
    """

    name: str
    source: str
    columns: tuple[int, ...]
    labels: tuple[str, ...]


def head(settings: MachineSettings) -> tuple[Element, Document]:
    """A document with its options, and the parts that bodies are put into."""
    root = ElementTree.Element("mujoco", model="nhpocp")
    add(root, "compiler", angle="radian", autolimits=True)
    option = add(
        root,
        "option",
        timestep=STEP,
        gravity=(0, 0, -settings.gravity),
        integrator="implicitfast",
        solver="Newton",
        iterations=200,
        tolerance=1e-12,
        cone="elliptic",
        impratio=100,
        noslip_iterations=20,
    )
    add(option, "flag", autoreset="disable")
    # contacts are stated pair by pair: nothing else touches
    add(add(root, "default"), "geom", contype=0, conaffinity=0)
    return root, Document(add(root, "worldbody"), add(root, "contact"), add(root, "actuator"))
