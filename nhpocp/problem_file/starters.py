"""A commented problem file to begin with, for `nhpocp init`: every key, with what it means and its default.

Keys, meanings and defaults come from the models that read the file, and parameters from the system's class, so none of
it can go stale. The task comes from the class too, `System.example`: `problems/` is no part of the installed package,
and a system from elsewhere has no file there, but brings its class.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

from pydantic import TypeAdapter
from pydantic.fields import FieldInfo

from nhpocp.bodies.obstacles import KINDS as KINDS_OF_OBSTACLES
from nhpocp.constraints.registry import KINDS
from nhpocp.problem_file.control import BLOCKS
from nhpocp.problem_file.numbers import Choice
from nhpocp.problem_file.registry import system_class
from nhpocp.problem_file.schema import Output, ProblemData
from nhpocp.problem_file.settings import BLOCKS as BLOCKS_OF_SOLVERS
from nhpocp.problem_file.settings import Solvers
from nhpocp.problem_file.states import State, Strict, plain_state
from nhpocp.state_space import UNIT_WORDS, Block, StateSpace
from nhpocp.systems.system import Parameter, System

COLUMN, WIDTH = 38, 118  # where the comments begin, and where they end
EXAMPLES = {"name": "my_problem", "length_scale": 15}  # of keys whose default is no value
HEAD = """\
# yaml-language-server: $schema={schema}
# By the line above editors complete and check this file (in VS Code: the extension YAML). It names a file beside this
# one; write it again after an update, or for a new system:  nhpocp schema -o {schema}
#
# Lines such as `# steps: 100` are keys at their defaults (name, via, constraints: examples); remove the # to set one.
# Numbers may be written 0.5, 1e-3, -pi/6, 2*pi/3 or 75 deg; plain numbers for angles are radians."""


def starter(model: str = "three_upu", schema: str = "nhpocp.schema.json") -> str:
    """A problem file for ``model``; ``schema``: where editors find the JSON schema, from the file's folder.

    Errors: `InvalidProblemError` for an unknown model or a broken plugin.
    """
    cls = system_class(model)
    system = cls()
    task = example_task(system)
    lines = [
        *HEAD.format(schema=schema).splitlines(),
        line("nhpocp: 1", "version of this format"),
        *options(ProblemData, ["name"]),
        *_system(cls, model),
        _option("units", {"length": "m", "time": "s"}, ProblemData.model_fields["units"].description or ""),
        *_ends(cls, system, task),
        line(
            f"horizon: {task.get('horizon', 1)}",
            "the duration T, or {min: 0.5, max: 3, initial: 1} where the NLP may choose",
        ),
        *_control(system, task.get("control", {})),
        *options(ProblemData, ["objective", "error_length", "length_scale"]),
        *_obstacles(system),
        *_constraints(system, task["start"]),
        "solvers:",
        *_solvers(),
        "output:",
        *options(Output, list(Output.model_fields), "  "),
    ]
    return "\n".join(lines) + "\n"


def example_task(system: System) -> dict[str, Any]:
    """The task that `nhpocp init` shows for a system, as a problem file's data."""
    return {**_made_up(system.state_space), **system.example}


def example_start(system: System) -> dict[str, Any]:
    """The start of the task that `nhpocp init` shows for a system, as numbers."""
    written = system.example.get("start") or _made_up(system.state_space)["start"]
    return plain_state(TypeAdapter(State).validate_python(written))


def _made_up(space: StateSpace) -> dict[str, Any]:
    """A task for a system that brings none: from zero to one."""
    start, goal = ({block.name: _value(block, at) for block in space.blocks} for at in (0, 1))
    return {"start": start, "goal": goal}


def _value(block: Block, at: int) -> Any:
    if block.kind == "rotation":
        return {"rpy": [0, 0, "60 deg" if at else 0]}
    return at if block.kind == "scalar" else [at] * block.components


def line(text: str, meaning: str = "") -> str:
    """A line and its comment, beside it or, where that would be too wide, above it."""
    beside = f"{text:<{COLUMN}} # {meaning}" if meaning else text
    if len(beside) <= WIDTH:
        return beside
    indent = text[: len(text) - len(text.lstrip())]
    name = text.lstrip("# ").partition(":")[0]
    return f"{indent}# ({name}) {meaning}:\n{text}"


def _option(name: str, value: Any, meaning: str, indent: str = "") -> str:
    """A key at its default, commented out."""
    return line(f"{indent}# {name}: {flow(value)}", meaning)


def flow(value: Any) -> str:
    """Plain data in YAML's flow style."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name}: {flow(part)}" for name, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(flow(part) for part in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.12g}".replace("e-0", "e-") if isinstance(value, float) else str(value)


def options(model: type[Strict], names: Sequence[str], indent: str = "") -> Iterator[str]:
    """The keys of a block, commented out."""
    for name in names:
        field = model.model_fields[name]
        default = field.get_default(call_default_factory=True)
        meaning = f"{field.description}{_choices(field)}"
        yield _option(name, EXAMPLES[name] if default is None else default, meaning, indent)


def _choices(field: FieldInfo) -> str:
    """The names that a field may have."""
    names = [name for part in field.metadata if isinstance(part, Choice) for name in part.names]
    return _other_names(names, field.description or "")


def _other_names(names: Sequence[str], meaning: str) -> str:
    """The names that a value may have, if those are all, and not all in its meaning already."""
    return "" if all(name in meaning for name in names) else f" ({' | '.join(names)})"


def _system(cls: type[System], model: str) -> Iterator[str]:
    yield line("system:", (cls.__doc__ or "").strip().partition("\n")[0].rstrip(".:"))
    yield f"  model: {model}"
    if cls.presets:
        names = " | ".join(cls.presets)
        yield line(f"  preset: {next(iter(cls.presets))}", f"{names}; parameters beside it override it")
    for name, parameter in cls.declared.items():
        meaning = f"{parameter.described}{_other_names(parameter.choices, parameter.meaning)}"
        yield _option(name, _default(parameter), meaning, "  ")


def _default(parameter: Parameter) -> Any:
    """A default as a user would write it: angles in degrees."""
    value = parameter.default
    if isinstance(value, float) and parameter.unit == "angle":
        return f"{degrees(value):.12g} deg"
    if value is None:
        return 1 if parameter.kind == "positive" else "[…]"
    return value


def _ends(cls: type[System], system: System, task: Mapping[str, Any]) -> Iterator[str]:
    if "goal" not in cls.example:
        yield f"# This start and goal are made up, for {cls.model} brings no example: put yours in their place."
    yield line(f"start: {flow(task['start'])}", _units(system.state_space.blocks))
    outputs = [block.name for block in system.pose_outputs]
    more = f"; {' and '.join(outputs)} may be given instead" if outputs else ""
    yield line(f"goal: {flow(task['goal'])}", f"what is left out is free{more}")
    name = system.state_space.blocks[0].name
    yield _option("via", [{"at": 0.5, name: task["start"][name]}], "poses to pass; at: share of the horizon")


def _units(blocks: Sequence[Block]) -> str:
    words = []
    for block in blocks:
        if block.kind == "rotation":
            words.append(f"{block.name}: rpy [roll, pitch, yaw] [rad], quaternion, rotvec or matrix")
        elif block.unit:
            words.append(f"{block.name} {UNIT_WORDS[block.unit]}")
    return ", ".join(words)


def _control(system: System, given: Mapping[str, Any]) -> Iterator[str]:
    harmonics = given.get("harmonics", BLOCKS["fourier"].model_fields["harmonics"].default)
    yield "control:"
    yield line("  basis: fourier", "columns of `initial`: const, sin1, cos1, sin2, cos2, …")
    yield f"  harmonics: {harmonics}"
    for basis, model in list(BLOCKS.items())[1:]:
        names = [name for name in model.model_fields if name not in ("basis", "initial")]
        own = ", ".join(f"{name}: {model.model_fields[name].default}" for name in names)
        yield f"  # or basis {basis} with {own}"
    inputs = ", ".join(system.input_space.labels)
    meaning = f"the control to begin with: one row per input ({inputs}), or auto, a seeded one"
    rows = given.get("initial")
    yield line("  initial:" if rows else "  initial: auto", meaning)
    for row in rows or ():
        yield f"    - {flow(row)}"


OBSTACLES = {  # out of the way
    2: {"disc": {"centre": [50, 50], "radius": 1}},
    3: {"sphere": {"centre": [50, 50, 50], "radius": 1}},
}


def _obstacles(system: System) -> Iterator[str]:
    if system.has_bodies:
        numbers = system.dimension_of_bodies
        names = ", ".join(name for name, kind in KINDS_OF_OBSTACLES.items() if kind.dimension == numbers)
        yield _option("obstacles", [OBSTACLES[numbers]], f"{names}; with constraints: {{distance: 0.1}}")


def _constraints(system: System, start: Mapping[str, Any]) -> Iterator[str]:
    words = (
        "what the whole path must respect, within 1e-3 of each limit; {max: 3} or [null, 3] bounds one side"
    )
    yield line("constraints:", words)
    for key, kind in KINDS.items():
        if (value := kind.shown(system, start)) is not None:
            yield _option(key, value, kind.meaning, "  ")


def _solvers() -> Iterator[str]:
    for i, (name, block) in enumerate(BLOCKS_OF_SOLVERS.items()):
        yield line(f"  {name}:", f"nhpocp solve --solver {name}" if i else "nhpocp solve")
        yield from options(block, list(block.model_fields), "    ")
    yield from options(Solvers, ["compile"], "  ")
