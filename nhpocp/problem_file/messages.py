"""pydantic's errors in our words: what came, what was expected, what to write instead."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from nhpocp.problem_file.issues import Issue, Path, Refusal, suggestion, unknown_key
from nhpocp.problem_file.numbers import describe
from nhpocp.problem_file.states import Rotation

_TAG = re.compile(r"<[a-z_]+>")  # our names for members of unions, which pydantic puts into paths


def translate(error: ValidationError, model: type[BaseModel]) -> list[Issue]:
    """Every error of a validation against ``model``."""
    issues: list[Issue] = []
    details = error.errors(include_url=False)
    guessed = {guess for detail in details for guess in _guessed(detail, model)}
    for detail in details:
        if detail["type"] == "missing" and detail["loc"] in guessed:
            continue  # its misspelt key is reported instead
        issues += _issues(detail, model)
    return issues


def _guessed(detail: Any, model: type[BaseModel]) -> Iterator[Path]:
    """The key that an unknown key was probably meant to be."""
    if detail["type"] == "extra_forbidden":
        name, known = str(detail["loc"][-1]), list(_keys(model, detail["loc"][:-1]))
        for near in difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.6):
            yield (*detail["loc"][:-1], near)


def _issues(detail: Any, model: type[BaseModel]) -> list[Issue]:
    kind, raw, value = detail["type"], detail["loc"], detail.get("input")
    context = detail.get("ctx") or {}
    path: Path = tuple(part for part in raw if not (isinstance(part, str) and _TAG.fullmatch(part)))
    if kind == "value_error":
        cause = context["error"]
        if isinstance(cause, Refusal):
            return [issue.under(path) for issue in cause.issues]
        return [Issue(path, str(cause))]
    if kind == "extra_forbidden":
        return [Issue(path, unknown_key(str(path[-1]), _keys(model, raw[:-1])), at_key=True)]
    if kind == "missing" and path == ("nhpocp",):
        return [Issue(path, "required key is missing; begin the file with `nhpocp: 1`")]
    return [Issue(path, _words(kind, value, context))]


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


def _keys(model: type[BaseModel], raw: tuple[str | int, ...]) -> list[str]:
    """The keys that the mapping at a raw pydantic path may have."""
    here: Any = model
    for part in raw:
        if isinstance(part, int):
            continue
        if part == "<rotation>":
            here = Rotation
        elif _TAG.fullmatch(part):
            here = _member(here, part)
        elif (found := _model_in(here)) is not None and part in found.model_fields:
            field = found.model_fields[part]
            here = (field.annotation, *field.metadata)
    found = _model_in(here)
    return list(found.model_fields) if found else []


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
