"""A commented problem file to begin with, for `nhpocp init`."""

from __future__ import annotations

from typing import Any

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.issues import suggestion
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.state_space import Block, StateSpace
from nhpocp.systems.system import System

# start, goal and rows of control.initial that are known to work; other systems begin at zero
_TASKS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "three_upu": (
        "{position: [0, 0, 25], orientation: {rpy: [0, 0, -30 deg]}}",
        "{position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -90 deg]}}",
        ("[0, 0.5, 0, 0, 0]", "[0, 0.5, 0, 0, 0]", "[1, 0, 0.5, 0, 0]"),
    ),
}


def starter(model: str = "three_upu") -> str:
    """A problem file for ``model`` with every common key, commented.

    Errors: `InvalidProblemError` for an unknown model.
    """
    if model not in SYSTEMS:
        raise InvalidProblemError(
            f"unknown model {model!r}; {suggestion(model, SYSTEMS)}", path="system.model"
        )
    cls = system_class(model)
    system = cls()
    space = system.state_space
    start, goal, rows = _TASKS.get(model, (_state(space, 0), _state(space, 1), ()))
    return "\n".join([*_head(cls, model), *_task(start, goal, system, rows), *_TAIL, ""])


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
        lines.append(f"  # {name}: {_value(parameter.default)}    # {parameter.meaning}{choices}")
    return lines


def _value(value: Any) -> str:
    if value is None:
        return "[…]"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


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


_TAIL = [
    "objective: effort        # effort | leg_effort | path_length | time",
    "# constraints:           # what the whole path must respect",
    "#   control: 10          # greatest |control|, or one [lo, hi] per input",
    "solvers:",
    "  jacobian:",
    "    gamma: 0.1           # share of the error that each step removes",
    "    tolerance: 1e-3",
    "    steps: 100           # integration steps over the horizon",
    "  nlp:",
    "    intervals: 50        # shooting intervals",
    "output: {samples: 201, pictures: true}",
]
