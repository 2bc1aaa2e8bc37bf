"""The problem file as a JSON schema, for editors."""

from __future__ import annotations

from typing import Any

from nhpocp.problem_file.registry import every_class, system_model
from nhpocp.problem_file.schema import ProblemData

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of the problem file, with descriptions and defaults."""
    schema = ProblemData.model_json_schema(ref_template="#/$defs/{model}")
    definitions = schema.setdefault("$defs", {})
    choices = []
    for model in every_class()[0]:
        block = system_model(model).model_json_schema(ref_template="#/$defs/{model}")
        definitions.update(block.pop("$defs", {}))
        definitions[f"system_{model}"] = block
        choices.append({"$ref": f"#/$defs/system_{model}"})
    schema["properties"]["system"] = {
        "description": "the model and its parameters",
        **({"anyOf": choices} if len(choices) > 1 else choices[0]),
    }
    for name, part in schema["properties"].items():
        if name in ("control", "constraints", "solvers", "output", "reference", "via"):
            _allow_nothing(part)
    for name in ("jacobian", "nlp"):
        _allow_nothing(definitions["Solvers"]["properties"][name])
    _drop_null_defaults(schema)
    return {"$schema": DIALECT, "$id": "nhpocp.schema.json", **schema, "title": "nhpocp problem file"}


def _allow_nothing(part: dict[str, Any]) -> None:
    """A block whose lines are all commented out counts as left out."""
    kept = {name: part.pop(name) for name in list(part) if name not in ("description", "default", "title")}
    part["anyOf"] = [kept, {"type": "null"}]


def _drop_null_defaults(node: Any) -> None:
    """`default: null` says no more than that the key may be absent."""
    if isinstance(node, dict):
        if (node.get("default", "") is None and "anyOf" in node) or (
            node.get("default", "") is None and ("type" in node or "enum" in node or "$ref" in node)
        ):
            del node["default"]
        for part in node.values():
            _drop_null_defaults(part)
    elif isinstance(node, list):
        for part in node:
            _drop_null_defaults(part)
