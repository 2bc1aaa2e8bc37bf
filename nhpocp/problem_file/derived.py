"""Blocks of the problem file derived from dataclasses with `declared` fields."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, StrictBool

from nhpocp.declared import Declared, declarations
from nhpocp.problem_file.numbers import AutoOrCount, Choice, Positive, checked_whole


def block_fields(cls: type[Any]) -> dict[str, Any]:
    """Fields for `pydantic.create_model`, one for each declared field of a dataclass."""
    return {
        name: (_annotation(line), Field(default=line.default, description=line.meaning))
        for name, line in declarations(cls).items()
    }


def _annotation(line: Declared) -> Any:
    if line.kind == "whole":
        return Annotated[int, checked_whole(line.least, line.most)]
    if line.kind == "choice":
        return Annotated[str, Choice(*line.choices)]
    return {"auto or whole": AutoOrCount, "positive": Positive, "truth": StrictBool}[line.kind]
