"""The `constraints` block: what the plan must respect along the whole path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, create_model

from nhpocp.constraints.kind import ConstraintKind
from nhpocp.constraints.registry import KINDS
from nhpocp.constraints.written import PAIR
from nhpocp.errors import describe
from nhpocp.problem_file.numbers import NUMBER_SCHEMA, Checked, NotNegative
from nhpocp.problem_file.states import Strict
from nhpocp.written_numbers import parse_number

INFINITE = ("inf", "-inf", "+inf", ".inf", "-.inf", "infinity", "-infinity")  # as people write an open side


def _side(value: Any) -> float | None:
    if value in (float("inf"), -float("inf")) or str(value).lower() in INFINITE:
        raise ValueError("infinity; for a side that is open write null, or {max: …} or {min: …} alone")
    return None if value is None else parse_number(value)


Side = Annotated[float | None, Checked(_side, {**NUMBER_SCHEMA, "type": ["number", "string", "null"]})]


def _by_kind(value: Any) -> str:
    if isinstance(value, dict | Strict):
        return "<sides>"
    if not isinstance(value, list):
        return "<number>"
    return "<lists>" if any(isinstance(x, list) for x in value) else "<pair>"


def _pair(value: Any) -> Any:
    if not isinstance(value, list | dict | Strict):
        raise ValueError(f"expected {PAIR}, got {describe(value)}")
    if isinstance(value, dict) and not value:
        raise ValueError(f"expected {PAIR}, got an empty mapping")
    return value


class Sides(Strict):
    """One side or both."""

    min: Side = Field(default=None, description="the least")
    max: Side = Field(default=None, description="the greatest")


_Entries = Annotated[
    Annotated[Side, Tag("<number>")] | Annotated[list[Side], Tag("<pair>")], Discriminator(_by_kind)
]


class SidesOfLists(Strict):
    """One side or both, each a number or a list of one for each component."""

    min: _Entries = Field(default=None, description="the least")
    max: _Entries = Field(default=None, description="the greatest")


class Most(Strict):
    """The greatest size."""

    max: NotNegative = Field(description="the greatest")


class Least(Strict):
    """The least size."""

    min: NotNegative = Field(description="the least")


_Limits = Annotated[list[Side], Field(min_length=2, max_length=2)]
Pair = Annotated[
    Annotated[_Limits, Tag("<pair>")] | Annotated[Sides, Tag("<sides>")],
    Discriminator(lambda value: "<pair>" if isinstance(value, list) else "<sides>"),
    BeforeValidator(_pair),
]
ControlBound = Annotated[
    Annotated[NotNegative, Tag("<number>")]
    | Annotated[Most, Tag("<sides>")]
    | Annotated[list[Pair], Tag("<pairs>")],
    Discriminator(lambda value: "<pairs>" if isinstance(value, list) else _by_kind(value)),
]
StateBound = Annotated[
    Annotated[_Limits, Tag("<pair>")]
    | Annotated[list[list[Side]], Field(min_length=2, max_length=2), Tag("<lists>")]
    | Annotated[SidesOfLists, Tag("<sides>")],
    Discriminator(_by_kind),
    BeforeValidator(_pair),
]
_SIZES = {
    side: Annotated[
        Annotated[NotNegative, Tag("<number>")] | Annotated[block, Tag("<sides>")],
        Discriminator(lambda value: "<sides>" if isinstance(value, dict | Strict) else "<number>"),
    ]
    for side, block in (("max", Most), ("min", Least))
}


def _annotation(kind: ConstraintKind) -> Any:
    if kind.shape == "number":
        return _SIZES[kind.side]
    if kind.shape == "pairs by name":

        def named(value: Any) -> Any:
            kind.refuse_unknown(value)
            return value

        return Annotated[dict[str, StateBound], BeforeValidator(named)]
    return {"pair": Pair, "number or pairs": ControlBound}[kind.shape]


def _plain(value: Any) -> Any:
    if isinstance(value, Strict):
        return {name: _plain(getattr(value, name)) for name in value.model_fields_set}
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


class Constraints(Strict):
    """Bounds along the path: numbers, [lo, hi] with null for an open side, or {min: …, max: …} with one or both."""

    def given(self) -> dict[str, Any]:
        """What is bounded, by the keys of the block, as plain data."""
        return {key: _plain(value) for key in KINDS if (value := getattr(self, key)) is not None}


_FIELDS: dict[str, Any] = {
    key: (_annotation(kind) | None, Field(default=None, description=kind.meaning))
    for key, kind in KINDS.items()
}
if not TYPE_CHECKING:
    Constraints = create_model("Constraints", __base__=Constraints, __doc__=Constraints.__doc__, **_FIELDS)
