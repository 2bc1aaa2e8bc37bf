"""pydantic's errors in our words: what came, what was expected, what to write instead."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from nhpocp.errors import InvalidProblemError, describe, nearest, suggestion
from nhpocp.problem_file.document import dotted
from nhpocp.problem_file.states import Rotation

MISSPELT = 100  # keys of one mapping: who writes more has not misspelt one
_TAG = re.compile(r"<[a-z_]+>")  # our names for members of unions, which pydantic puts into paths


def translate(error: ValidationError, model: type[BaseModel]) -> list[InvalidProblemError]:
    """Every error of a validation against ``model``, its path from there."""
    details = error.errors(include_url=False)
    guessed = _guessed(details, model)
    return [
        issue
        for detail in details
        if detail["type"] != "missing" or detail["loc"] not in guessed  # its misspelt key is reported instead
        for issue in _errors(detail, model)
    ]


def _guessed(details: Sequence[Any], model: type[BaseModel]) -> set[tuple[Any, ...]]:
    """The missing keys that an unknown key beside them was probably meant to be."""
    lacking = {detail["loc"][:-1] for detail in details if detail["type"] == "missing"}
    beside: dict[tuple[Any, ...], list[str]] = {}
    for detail in details:
        mapping, name = detail["loc"][:-1], detail["loc"][-1]
        if detail["type"] == "extra_forbidden" and mapping in lacking:
            beside.setdefault(mapping, []).append(str(name))
    return {
        (*mapping, nearest(name, _keys(model, _named(mapping))))
        for mapping, names in beside.items()
        for name in names[:MISSPELT]
    }


def _named(raw: tuple[Any, ...]) -> tuple[str, ...]:
    """A path without the places in lists, which all have the same keys."""
    return tuple(part for part in raw if isinstance(part, str))


def _errors(detail: Any, model: type[BaseModel]) -> list[InvalidProblemError]:
    kind, raw, value = detail["type"], detail["loc"], detail.get("input")
    context = detail.get("ctx") or {}
    path = dotted(part for part in raw if not (isinstance(part, str) and _TAG.fullmatch(part)))
    if kind == "value_error":
        cause = context["error"]
        if isinstance(cause, InvalidProblemError):
            return [each.under(path) for each in (cause, *cause.others)]
        return [InvalidProblemError(str(cause), path=path)]
    if kind == "extra_forbidden":
        known = _keys(model, _named(raw[:-1]))
        return [InvalidProblemError("unknown key", path=path, word=str(raw[-1]), known=known)]
    if kind == "missing" and path == "nhpocp":
        return [InvalidProblemError("required key is missing; begin the file with `nhpocp: 1`", path=path)]
    return [InvalidProblemError(_words(kind, value, context), path=path)]


def _words(kind: str, value: Any, context: dict[str, Any]) -> str:
    came = describe(value)
    if kind == "missing":
        return "required key is missing"
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", context["expected"]) or [context["expected"]]
        if isinstance(value, str):
            near = suggestion(value, choices)
            every = "" if near.startswith("expected") else f" (one of {', '.join(choices)})"
            return f"unknown value {value!r}; {near}{every}"
        return f"expected one of {', '.join(choices)}, got {came}"
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length", context.get("max_length"))
        length = len(value) if isinstance(value, list) else context.get("actual_length")
        return f"a list of {length}; expected {wanted}"
    expected = {
        "model_type": "a mapping",
        "model_attributes_type": "a mapping",
        "dict_type": "a mapping",
        "list_type": "a list",
        "string_type": "text",
        "bool_type": "true or false",
    }.get(kind)
    return f"expected {expected}, got {came}" if expected else f"cannot use {came} here"


@lru_cache(maxsize=256)
def _keys(model: type[BaseModel], raw: tuple[str, ...]) -> tuple[str, ...]:
    """The keys that the mapping at a raw pydantic path, `_named`, may have."""
    here: Any = model
    for part in raw:
        if part == "<rotation>":
            here = Rotation
        elif _TAG.fullmatch(part):
            here = _member(here, part)
        elif (owner := _model_in(here)) is not None and part in owner.model_fields:
            field = owner.model_fields[part]
            here = (field.annotation, *field.metadata)
    owner = _model_in(here)
    return tuple(owner.model_fields) if owner else ()


def _walk(annotation: Any) -> Iterator[Any]:
    """An annotation and everything inside it."""
    yield annotation
    for part in annotation if isinstance(annotation, tuple) else get_args(annotation):
        yield from _walk(part)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    return next((x for x in _walk(annotation) if isinstance(x, type) and issubclass(x, BaseModel)), None)


def _member(annotation: Any, tag: str) -> Any:
    """The member of a tagged union."""
    for part in _walk(annotation):
        if any(getattr(extra, "tag", None) == tag for extra in getattr(part, "__metadata__", ())):
            return part
    return annotation
