"""A commented problem file to begin with, for `nhpocp init`."""

from __future__ import annotations

from math import degrees

from nhpocp.problem_file.registry import system_class
from nhpocp.state_space import Block, StateSpace
from nhpocp.systems.system import Parameter, System

# start, goal and rows of control.initial that are known to work; other systems begin at zero
_TASKS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "three_upu": (
        "{position: [0, 0, 25], orientation: {rpy: [0, 0, -30 deg]}}",
        "{position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}",
        ("[0, 0.5, 0, 0, 0]", "[0, 0.5, 0, 0, 0]", "[1, 0, 0.5, 0, 0]"),
    ),
    "parallel_robot": (
        "{position: [0, 0, 25], orientation: {rpy: [0, 0, -30 deg]}}",
        "{position: [-0.4, -0.2, 30], orientation: {rpy: [0, 0, -60 deg]}}",
        (),
    ),
    "orienting_platform": (
        "{orientation: {rpy: [0, 0, 0]}}",
        "{orientation: {rpy: [0, 0, 45 deg]}}",
        ("[0, 0, -28, 0, 0]", "[0, 28, 0, 0, 0]"),
    ),
}


def starter(model: str = "three_upu") -> str:
    """A problem file for ``model`` with every common key, commented.

    Errors: `InvalidProblemError` for an unknown model or a broken plugin.
    """
    cls = system_class(model)
    system = cls()
    space = system.state_space
    start, goal, rows = _TASKS.get(model, (_state(space, 0), _state(space, 1), ()))
    constraints = _CONSTRAINTS if "leg_lengths" in (cls.known_outputs() or ()) else _CONSTRAINTS[:2]
    return "\n".join([*_head(cls, model), *_task(start, goal, system, rows), *constraints, *_SOLVERS, ""])


def _head(cls: type[System], model: str) -> list[str]:
    lines = [
        "# yaml-language-server: $schema=nhpocp.schema.json",
        "# (write that file with: nhpocp schema > nhpocp.schema.json)",
        "# Numbers may be written 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg; plain numbers for angles are radians.",
        "nhpocp: 1                # version of this format",
        "system:",
        f"  model: {model}",
    ]
    if cls.presets:
        lines.append(f"  preset: {next(iter(cls.presets))}        # one of {', '.join(cls.presets)}")
    for name, parameter in cls.declared.items():
        choices = f" ({' | '.join(parameter.choices)})" if parameter.choices else ""
        lines.append(f"  # {f'{name}: {_value(parameter)}':<22} # {parameter.meaning}{choices}")
    return lines


def _value(parameter: Parameter) -> str:
    """A default as a user would write it: angles in degrees."""
    value = parameter.default
    if isinstance(value, float):
        return f"{degrees(value):.12g} deg" if parameter.meaning.endswith("[rad]") else f"{value:.12g}"
    return "[…]" if value is None else str(value)


def _task(start: str, goal: str, system: System, rows: tuple[str, ...]) -> list[str]:
    initial = [f"    - {row}" for row in rows]
    inputs = ", ".join(system.input_space.labels)
    return [
        f"start: {start}",
        f"goal: {goal}    # a block left out is free",
        "horizon: 1               # the duration T, or {min: 0.5, max: 3, initial: 1} to let the NLP choose",
        "control:",
        "  basis: fourier         # columns: const, sin1, cos1, sin2, cos2, …",
        "  harmonics: 2",
        f"  # one row per input ({inputs}), or auto",
        *(["  initial:", *initial] if rows else ["  initial: auto"]),
    ]


def _state(space: StateSpace, coordinate: float) -> str:
    return "{" + ", ".join(f"{block.name}: {_block(block, coordinate)}" for block in space.blocks) + "}"


def _block(block: Block, coordinate: float) -> str:
    if block.kind == "scalar":
        return f"{coordinate:g}"
    if block.kind == "rotation":
        return f"{{rpy: [0, 0, {coordinate:g}]}}"
    return f"[{', '.join([f'{coordinate:g}'] * block.components)}]"


_CONSTRAINTS = [
    "# constraints:           # what the whole path must respect",
    "#   control: 10          # greatest |control|, or one [lo, hi] per input",
    "#   leg_length: [20, 60] # shortest and longest leg",
    "#   leg_speed: 200       # greatest |u_i|",
    "#   clearance: 0.05      # least singular value of S and W: the distance from singularities",
    "#   state: {position: [[-10, -10, 15], [10, 10, 45]]}    # [lowest, highest] of a part of the state",
]
_SOLVERS = [
    "objective: effort        # what the NLP minimises: effort | leg_effort | path_length | time",
    "solvers:",
    "  jacobian:",
    "    step_rule: euler     # euler: the paper's | adaptive | ode | auto: adaptive, then whatever else may help",
    "    gamma: 0.1           # share of the error that each step of euler removes",
    "    tolerance: 1e-3",
    "    steps: 100           # integration steps over the horizon",
    "  nlp:",
    "    intervals: 50        # shooting intervals",
    "output: {samples: 201, pictures: true}",
]
