"""The `constraints` block: what the plan must respect along the whole path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, create_model

from nhpocp.constraints.kind import Shape
from nhpocp.constraints.registry import KINDS
from nhpocp.errors import describe
from nhpocp.problem_file.numbers import NUMBER_SCHEMA, Checked, NotNegative, parse_number
from nhpocp.problem_file.states import Strict


def _side(value: Any) -> float | None:
    return None if value is None else parse_number(value)


Side = Annotated[float | None, Checked(_side, {**NUMBER_SCHEMA, "type": ["number", "string", "null"]})]


def _pair(value: Any) -> Any:
    if not isinstance(value, list):
        raise ValueError(f"expected [lo, hi], got {describe(value)}")
    return value


Pair = Annotated[list[Side], Field(min_length=2, max_length=2), BeforeValidator(_pair)]


def _control_kind(value: Any) -> str:
    return "<pairs>" if isinstance(value, list) else "<number>"


ControlBound = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[list[Pair], Tag("<pairs>")],
    Discriminator(_control_kind),
]


def _state_bound(value: Any) -> Any:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"expected [lo, hi] or [[lo, …], [hi, …]], got {describe(value)}")
    return value


def _bound_kind(value: Any) -> str:
    return "<lists>" if isinstance(value, list) and any(isinstance(x, list) for x in value) else "<pair>"


StateBound = Annotated[
    Annotated[Pair, Tag("<pair>")]
    | Annotated[list[list[Side]], Field(min_length=2, max_length=2), Tag("<lists>")],
    Discriminator(_bound_kind),
    BeforeValidator(_state_bound),
]


_SHAPES: dict[Shape, Any] = {
    "number": NotNegative,
    "pair": Pair,
    "number or pairs": ControlBound,
    "pairs by name": dict[str, StateBound],
}


class Constraints(Strict):
    """Bounds along the path; null as one side of a pair leaves that side open."""

    def given(self) -> dict[str, Any]:
        """What is bounded, by the keys of the block."""
        return {key: value for key in KINDS if (value := getattr(self, key)) is not None}


_FIELDS: dict[str, Any] = {
    key: (_SHAPES[kind.shape] | None, Field(default=None, description=kind.meaning))
    for key, kind in KINDS.items()
}
if not TYPE_CHECKING:
    Constraints = create_model("Constraints", __base__=Constraints, __doc__=Constraints.__doc__, **_FIELDS)
