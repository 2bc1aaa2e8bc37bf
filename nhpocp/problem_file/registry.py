"""The registry of systems and the `system` block: the one place where a model's name meets its class.

Classes are imported when they are asked for, and import neither CasADi nor NumPy themselves.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, cast

from pydantic import Field, StrictBool, ValidationError, create_model

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import plugins
from nhpocp.problem_file.issues import Issue, Refusal, suggestion
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.numbers import Checked, Number, Positive, Whole, describe, parse_number
from nhpocp.problem_file.states import Strict, Vector3
from nhpocp.state_space import Block
from nhpocp.systems.system import Parameter, System

SYSTEMS: dict[str, str] = {
    "three_upu": "nhpocp.systems.three_upu:ThreeUPU",
    "parallel_robot": "nhpocp.systems.parallel_robot:ParallelRobot",
    "orienting_platform": "nhpocp.systems.orienting_platform:OrientingPlatform",
    "heisenberg": "nhpocp.systems.heisenberg:Heisenberg",
    "free_nilpotent_36": "nhpocp.systems.free_nilpotent_36:FreeNilpotent36",
    "unicycle": "nhpocp.systems.unicycle:Unicycle",
    "veselova_joint": "nhpocp.systems.veselova_joint:VeselovaJoint",
    "suslov_joint": "nhpocp.systems.suslov_joint:SuslovJoint",
    "rolling_sphere": "nhpocp.systems.rolling_sphere:RollingSphere",
}


class LegData(Strict):
    """One leg of the 3-ŬPU robot as built."""

    base: Vector3 = Field(description="centre of the sphere, base coordinates")
    platform: Vector3 = Field(description="centre of the universal joint, platform coordinates")
    r: Vector3 = Field(description="roller normal, base coordinates (suslov: along g, w3, g×w3)")
    w4: Vector3 = Field(description="axis of the universal joint fixed in the platform")
    joint: Literal["veselova", "suslov"] = Field(
        default="veselova", description="r fixed in the base or in the leg"
    )


def _length(value: Any) -> float | str:
    if isinstance(value, str) and not any(c.isdigit() for c in value) and value != "fixed":
        raise ValueError(f"expected fixed or a length >= 0, got {describe(value)}")
    if value == "fixed":
        return "fixed"
    number = parse_number(value)
    if number < 0:
        raise ValueError(f"{number:g} is negative; expected fixed or a length >= 0")
    return number


Length = Annotated[
    float | str, Checked(_length, {"anyOf": [{"const": "fixed"}, {"type": "number", "minimum": 0}]})
]


class JointedLegData(Strict):
    """One leg of a parallel robot as built: its joints, and what is between them."""

    base: Vector3 = Field(description="centre of the base joint, base coordinates")
    platform: Vector3 = Field(description="centre of the platform joint, platform coordinates")
    base_joint: Literal["veselova", "suslov", "universal", "spherical"] = Field(
        default="veselova", description="about which directions the leg can turn in the base"
    )
    r: Vector3 | None = Field(
        default=None,
        description="about which it cannot: base coordinates (veselova), or along g, w3, g×w3 (suslov)",
    )
    w1: Vector3 | None = Field(
        default=None, description="axis of a universal base joint fixed in the base, base coordinates"
    )
    w2: Vector3 | None = Field(
        default=None, description="its axis fixed in the leg, along g, w3, g×w3; default w3"
    )
    w4: Vector3 | None = Field(
        default=None,
        description="axis of the universal joint fixed in the platform; without it that joint is spherical",
    )
    length: Length | None = Field(
        default=None,
        description="fixed (as at the start) or a length, of a bar; 0: the base joint holds the platform itself; "
        "absent: a prismatic joint",
    )
    actuated: StrictBool | None = Field(
        default=None, description="whether a motor drives the length; default: if it is prismatic"
    )


def system_class(model: str) -> type[System]:
    """The class of a model: the registry's, else a plugin's.

    Errors: `InvalidProblemError` at system.model for an unknown one, or a plugin that is broken.
    """
    if model in SYSTEMS:
        module, _, name = SYSTEMS[model].partition(":")
        return cast("type[System]", getattr(importlib.import_module(module), name))
    found = plugins.installed()
    if model not in found:
        near = suggestion(model, [*SYSTEMS, *found])
        own = f"a system of your own is found by an entry point of the group {plugins.GROUP}"
        hint = near if near.startswith("did you mean") else f"{near}; {own}"
        raise InvalidProblemError(f"unknown model {model!r}; {hint}", path="system.model")
    return plugins.load(found[model])


def every_class() -> tuple[dict[str, type[System]], list[str]]:
    """The class of every model that works, the registry's first, and what is wrong with the plugins that do not."""
    classes, broken = {model: system_class(model) for model in SYSTEMS}, []
    for model, points in plugins.installed().items():
        if model in SYSTEMS:
            broken.append(f"{plugins.origin(points[0])} is never used: {model} is a model of nhpocp itself")
            continue
        try:
            cls = plugins.load(points)
            plugins.made(cls, plugins.origin(points[0]))
            classes[model] = cls
        except InvalidProblemError as error:
            broken.append(error.message)
    return classes, broken


def _field(parameter: Parameter) -> Any:
    kinds: dict[str, Any] = {
        "number": Number,
        "positive": Positive,
        "integer": Whole,
        "numbers": list[Number],
        "legs": list[LegData],
        "jointed legs": list[JointedLegData],
        "choice": Literal[parameter.choices or ("",)],
    }
    return kinds[parameter.kind]


def system_model(model: str) -> type[Strict]:
    """The pydantic model of the `system` block, built from what the class declares."""
    declared, presets = system_class(model).declared, system_class(model).presets
    fields: dict[str, Any] = {
        "model": (Literal[(model,)], Field(description="name of the system; see `nhpocp systems`"))
    }
    if presets:
        fields["preset"] = (
            Literal[tuple(presets)],
            Field(default=None, description="named set of parameters; parameters beside it override it"),
        )
    for name, parameter in declared.items():
        shown = "" if parameter.default is None else f"; default {_plain(parameter.default)}"
        fields[name] = (_field(parameter), Field(default=None, description=parameter.described + shown))
    return create_model(f"System_{model}", __base__=Strict, __doc__=f"The system {model}.", **fields)


def _plain(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def read_system(data: Any) -> tuple[System, dict[str, Any]]:
    """The system that a `system` block describes, and the block with its numbers read.

    Errors: `Refusal`, paths relative to the block.
    """
    if not isinstance(data, dict):
        raise Refusal([Issue((), f"expected a mapping such as {{model: three_upu}}, got {describe(data)}")])
    model = data.get("model")
    if model is None:
        raise Refusal([Issue(("model",), f"required key is missing; available: {', '.join(SYSTEMS)}")])
    if not isinstance(model, str):
        raise Refusal([Issue(("model",), f"expected a name, got {describe(model)}")])
    try:
        block_model = system_model(model)
    except InvalidProblemError as error:
        raise Refusal([Issue(("model",), error.message)]) from None
    try:
        block = block_model.model_validate(data).model_dump(exclude_unset=True)
    except ValidationError as error:
        raise Refusal(translate(error, block_model)) from None
    return _build(model, block), block


def _build(model: str, block: Mapping[str, Any]) -> System:
    cls = system_class(model)
    given = {name: value for name, value in block.items() if name not in ("model", "preset")}
    parameters = {**cls.presets.get(block.get("preset", ""), {}), **given}
    for name in given:
        replaced = cls.declared[name].replaces
        if beside := [other for other in given if other in replaced]:
            words = f"stands beside {name}, which replace it; remove one of the two"
            raise Refusal([Issue((beside[0],), words, at_key=True)])
        parameters = {other: value for other, value in parameters.items() if other not in replaced}
    try:
        if model not in SYSTEMS:
            return plugins.made(cls, f"the plugin {cls.__module__}:{cls.__qualname__}", **parameters)
        return cls(**parameters)
    except InvalidProblemError as error:
        path = (error.path or "").removeprefix("system").removeprefix(".")
        place = path if path else "legs" if "legs" in given else ""
        raise Refusal([Issue((place,) if place else (), error.message)]) from None


def describe_space(blocks: Sequence[Block]) -> list[dict[str, Any]]:
    """Blocks as plain data."""
    return [
        {"name": block.name, "kind": block.kind, "shape": list(block.shape), "unit": block.unit}
        for block in blocks
    ]


def systems() -> dict[str, dict[str, Any]]:
    """Every model: parameters with defaults and meanings, presets, names of states and inputs. Plain JSON data.

    Plugins that are broken are left out; `every_class` says what is wrong with them.
    """
    found = {}
    for model, cls in every_class()[0].items():
        instance = cls()
        found[model] = {
            "parameters": {
                name: {
                    "kind": parameter.kind,
                    **({"choices": list(parameter.choices)} if parameter.choices else {}),
                }
                for name, parameter in cls.declared.items()
            },
            "defaults": {name: parameter.default for name, parameter in cls.declared.items()},
            "meanings": {name: parameter.described for name, parameter in cls.declared.items()},
            "presets": {name: dict(values) for name, values in cls.presets.items()},
            "states": describe_space(instance.state_space.blocks),
            "inputs": describe_space(instance.input_space.blocks),
            "pose_outputs": describe_space(instance.pose_outputs),
        }
    return found
