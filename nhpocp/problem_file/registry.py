"""The registry of systems and the `system` block: the one place where a model's name meets its class.

Classes are imported when they are asked for, and import neither CasADi nor NumPy themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import Field, StrictBool, ValidationError, create_model

from nhpocp.errors import CallError, InvalidProblemError, describe, one_line, refuse
from nhpocp.family import Family, Group
from nhpocp.problem_file.messages import translate
from nhpocp.problem_file.numbers import Length, Number, Positive, Whole
from nhpocp.problem_file.states import Strict, Vector3
from nhpocp.state_space import Block
from nhpocp.systems.system import Parameter, System

SYSTEMS: Family[type[System]] = Family(
    {
        "three_upu": "nhpocp.systems.three_upu:ThreeUPU",
        "parallel_robot": "nhpocp.systems.parallel_robot:ParallelRobot",
        "orienting_platform": "nhpocp.systems.orienting_platform:OrientingPlatform",
        "heisenberg": "nhpocp.systems.heisenberg:Heisenberg",
        "free_nilpotent_36": "nhpocp.systems.free_nilpotent_36:FreeNilpotent36",
        "unicycle": "nhpocp.systems.unicycle:Unicycle",
        "veselova_joint": "nhpocp.systems.veselova_joint:VeselovaJoint",
        "suslov_joint": "nhpocp.systems.suslov_joint:SuslovJoint",
        "rolling_sphere": "nhpocp.systems.rolling_sphere:RollingSphere",
        "chained": "nhpocp.systems.chained:Chained",
        "engel": "nhpocp.systems.cartan:Engel",
        "cartan": "nhpocp.systems.cartan:Cartan",
        "double_integrator": "nhpocp.systems.double_integrator:DoubleIntegrator",
        "car": "nhpocp.systems.car:Car",
        "car_with_trailers": "nhpocp.systems.car_with_trailers:CarWithTrailers",
        "truck_with_trailers": "nhpocp.systems.truck_with_trailers:TruckWithTrailers",
        "sphere_on_sphere": "nhpocp.systems.sphere_on_sphere:SphereOnSphere",
        "nonholonomic_manipulator": "nhpocp.systems.nonholonomic_manipulator:NonholonomicManipulator",
        "passive_sphere": "nhpocp.systems.passive_sphere:PassiveSphere",
        "friction_drive_wrist": "nhpocp.systems.friction_drive_wrist:FrictionDriveWrist",
        "trident_snake": "nhpocp.systems.trident_snake:TridentSnake",
        "mobile_manipulator": "nhpocp.systems.mobile_manipulator:MobileManipulator",
        "rigid_body": "nhpocp.systems.rigid_body:RigidBody",
    },
    group=Group("nhpocp.systems", "nhpocp.systems.system:System", "model", "a system"),
)


def system_class(model: str) -> type[System]:
    """The class of a model: the registry's, else a plugin's.

    Errors: `InvalidProblemError` at system.model for an unknown one, or a plugin that is broken.
    """
    if model not in SYSTEMS:
        raise InvalidProblemError(f"unknown model {model!r}; {SYSTEMS.unknown(model)}", path="system.model")
    try:
        return SYSTEMS[model]
    except InvalidProblemError as error:
        raise error.under("system.model") from None


def _fields(owner: str, declared: Mapping[str, Parameter]) -> dict[str, Any]:
    """The pydantic fields of the parameters that a model declares."""
    fields: dict[str, Any] = {}
    for name, parameter in declared.items():
        known = parameter.default not in (None, ...)
        shown = (
            f"{parameter.described}; default {_plain(parameter.default)}" if known else parameter.described
        )
        default = ... if parameter.default is ... else None
        fields[name] = (_type(f"{owner}_{name}", parameter), Field(default=default, description=shown))
    return fields


def _type(name: str, parameter: Parameter) -> Any:
    if parameter.keys is not None:
        return list[create_model(name, __base__=Strict, **_fields(name, parameter.keys))]  # type: ignore[misc]
    if parameter.kind == "choice":
        return Literal[parameter.choices]
    kinds: dict[str, Any] = {
        "number": Number,
        "positive": Positive,
        "integer": Whole,
        "numbers": list[Number],
        "vector": Vector3,
        "length": Length,
        "flag": StrictBool,
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
    fields |= _fields(f"System_{model}", declared)
    return create_model(f"System_{model}", __base__=Strict, __doc__=f"The system {model}.", **fields)


def _plain(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def read_system(data: Any) -> tuple[System, dict[str, Any]]:
    """The system that a `system` block describes, and the block with its numbers read.

    Errors: `InvalidProblemError` with its path in the file.
    """
    if not isinstance(data, dict):
        words = f"expected a mapping such as {{model: three_upu}}, got {describe(data)}"
        raise InvalidProblemError(words, path="system")
    model = data.get("model")
    if model is None:
        words = f"required key is missing; available: {', '.join(SYSTEMS)}"
        raise InvalidProblemError(words, path="system.model")
    if not isinstance(model, str):
        raise InvalidProblemError(f"expected a name, got {describe(model)}", path="system.model")
    block_model = system_model(model)
    try:
        block = block_model.model_validate(data).model_dump(exclude_unset=True)
    except ValidationError as error:
        refuse([issue.under("system") for issue in translate(error, block_model)])
    return _build(model, block), block


def _build(model: str, block: Mapping[str, Any]) -> System:
    cls = system_class(model)
    given = {name: value for name, value in block.items() if name not in ("model", "preset")}
    parameters = {**cls.presets.get(block.get("preset", ""), {}), **given}
    for name in given:
        replaced = cls.declared[name].replaces
        if beside := [other for other in given if other in replaced]:
            words = f"stands beside {name}, which replace it; remove one of the two"
            raise InvalidProblemError(words, path=f"system.{beside[0]}", at_key=True)
        parameters = {other: value for other, value in parameters.items() if other not in replaced}
    try:
        return cls(**parameters)
    except CallError as error:
        raise _failing(cls, error.message) from error
    except InvalidProblemError as error:
        if error.path in (None, "system"):
            error.path = "system.legs" if "legs" in given else "system"
        raise
    except Exception as error:
        if model in SYSTEMS.lines:
            raise
        raise _failing(cls, one_line(error)) from error


def _failing(cls: type[System], reason: str) -> InvalidProblemError:
    words = f"the plugin {cls.__module__}:{cls.__qualname__} fails: {reason}"
    return InvalidProblemError(words, path="system.model")


def describe_space(blocks: Sequence[Block]) -> list[dict[str, Any]]:
    """Blocks as plain data."""
    return [
        {"name": block.name, "kind": block.kind, "shape": list(block.shape), "unit": block.unit}
        for block in blocks
    ]


def systems() -> dict[str, dict[str, Any]]:
    """Every model: parameters with defaults and meanings, presets, names of states and inputs. Plain JSON data.

    Plugins that are broken are left out; `SYSTEMS.faults()` says what is wrong with them.
    """
    described = {}
    for model, cls in SYSTEMS.items():
        instance = cls()
        described[model] = {
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
    return described
