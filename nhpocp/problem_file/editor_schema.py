"""The problem file as a JSON schema, for editors.

Draft 7, which every editor's YAML support knows whole (VS Code's and others' yaml-language-server knows later drafts in
part), and written for what they make of it: `if`/`then` on the model rather than a union of all systems, so that a
mistake is underlined where it stands instead of "matches none of 9 schemas".
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from nhpocp.problem_file.numbers import NUMBER_SCHEMA
from nhpocp.problem_file.registry import SYSTEMS, system_model
from nhpocp.problem_file.schema import ProblemData
from nhpocp.solvers.registry import SOLVERS
from nhpocp.state_space import UNIT_WORDS, Block, StateSpace
from nhpocp.systems.system import System

DIALECT = "http://json-schema.org/draft-07/schema#"
IDENTITY = "nhpocp.schema.json"
REFERENCE = "#/definitions/{model}"
MAY_BE_EMPTY = ("control", "constraints", "solvers", "output", "reference", "via")


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 7) of the problem file, with a description of every key, and defaults."""
    schema = ProblemData.model_json_schema(ref_template=REFERENCE)
    definitions = schema.pop("$defs", {})
    classes = dict(SYSTEMS)
    for model in classes:
        block = system_model(model).model_json_schema(ref_template=REFERENCE)
        definitions.update(block.pop("$defs", {}))
        definitions[f"system_{model}"] = block
    properties = schema["properties"]
    properties["system"] = _system(classes, properties["system"]["description"])
    for name in MAY_BE_EMPTY:
        _allow_nothing(properties[name])
    for name in SOLVERS:
        _allow_nothing(definitions["Solvers"]["properties"][name])
    definitions["Rotation"] |= {"minProperties": 1, "maxProperties": 1}
    properties["goal"]["minProperties"] = 1
    written = properties["start"].pop("additionalProperties")
    properties["goal"].pop("additionalProperties")
    _tidy([schema, definitions])
    states = [_states(model, cls, written) for model, cls in classes.items()]
    for part in [schema, properties["system"], *definitions.values()]:
        _name_keys(part)
    head = {"$schema": DIALECT, "$id": IDENTITY, "title": "nhpocp problem file"}
    return {**head, **schema, "allOf": states, "definitions": definitions}


def _system(classes: dict[str, type[System]], description: str) -> dict[str, Any]:
    """The model by name, and what else the block may hold by the model."""
    return {
        "description": description,
        "type": "object",
        "required": ["model"],
        "properties": {
            "model": {"enum": list(classes), "description": "name of the system; see `nhpocp systems`"}
        },
        "allOf": [
            {
                "if": {"properties": {"model": {"const": model}}, "required": ["model"]},
                "then": {"$ref": REFERENCE.format(model=f"system_{model}")},
            }
            for model in classes
        ],
    }


def _states(model: str, cls: type[System], written: Any) -> dict[str, Any]:
    """The names that start and goal may use with a model; ``written``: what any value of a state looks like.

    Refused is only what no parameters of the model could make right: a space that belongs to an instance, not to the
    class, may depend on them, so its names are offered and nothing is forbidden.
    """
    system = cls()
    exact = isinstance(getattr(cls, "state_space", None), StateSpace)
    others: Any = False if exact else written
    blocks, outputs = system.state_space.blocks, system.pose_outputs
    start = {block.name: _block(block, exact) for block in blocks}
    goal = start | {
        block.name: _block(block, exact and "output_blocks" not in vars(system)) for block in outputs
    }
    required = {"required": list(start)} if exact else {}
    return {
        "if": {
            "required": ["system"],
            "properties": {"system": {"required": ["model"], "properties": {"model": {"const": model}}}},
        },
        "then": {
            "properties": {
                "start": {"properties": start, "additionalProperties": others, **required},
                "goal": {"properties": goal, "additionalProperties": others},
            }
        },
    }


def _block(block: Block, exact: bool) -> dict[str, Any]:
    """What a block's value looks like; its length only where that is ``exact``."""
    unit = UNIT_WORDS[block.unit]
    if block.kind == "rotation":
        rotation = {"allOf": [{"$ref": REFERENCE.format(model="Rotation")}]}
        return {"title": block.name, "description": "one of rpy, quaternion, rotvec, matrix", **rotation}
    if block.kind == "scalar":
        return {"title": block.name, "description": f"a number {unit}".rstrip(), **NUMBER_SCHEMA}
    size = 3 if block.kind == "direction" else block.components
    what = "a direction, [x, y, z]" if block.kind == "direction" else f"{size} numbers {unit}".rstrip()
    length = {"minItems": size, "maxItems": size} if exact or block.kind == "direction" else {}
    return {"title": block.name, "description": what, "type": "array", "items": NUMBER_SCHEMA, **length}


def _allow_nothing(part: dict[str, Any]) -> None:
    """A block whose lines are all commented out counts as left out."""
    kept = {name: part.pop(name) for name in list(part) if name not in ("description", "default", "title")}
    part["anyOf"] = [kept, {"type": "null"}]


def _nodes(node: Any) -> Iterator[dict[str, Any]]:
    """Every mapping of a tree."""
    if isinstance(node, dict):
        yield node
        for part in list(node.values()):
            yield from _nodes(part)
    elif isinstance(node, list):
        for part in node:
            yield from _nodes(part)


def _tidy(tree: Any) -> None:
    """Without pydantic's titles, which are names of classes, and without `default: null`, which says nothing."""
    for node in _nodes(tree):
        if isinstance(node.get("title"), str):  # and not a key of that name
            del node["title"]
        if node.get("default", "") is None and any(
            name in node for name in ("anyOf", "type", "enum", "$ref")
        ):
            del node["default"]


def _name_keys(part: dict[str, Any]) -> None:
    """Titles, which editors show in bold: the key as it is written, with its default."""
    for name, node in part.get("properties", {}).items():
        default = node.get("default")
        shown = f" (default {_word(default)})" if isinstance(default, str | int | float) else ""
        node["title"] = f"{name}{shown}"


def _word(value: Any) -> str:
    return (
        str(value).lower()
        if isinstance(value, bool)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )
