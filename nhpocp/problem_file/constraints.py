"""The `constraints` block: what the plan must respect along the whole path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    create_model,
)

from nhpocp.constraints.kind import Shape
from nhpocp.constraints.registry import KINDS
from nhpocp.problem_file.issues import Issue, Refusal
from nhpocp.problem_file.numbers import NUMBER_SCHEMA, Checked, NotNegative, describe, parse_number
from nhpocp.problem_file.states import Strict
from nhpocp.state_space import Block
from nhpocp.systems.system import System


def _side(value: Any) -> float | None:
    return None if value is None else parse_number(value)


Side = Annotated[
    float | None,
    Checked(_side, {**NUMBER_SCHEMA, "type": ["number", "string", "null"]}),
]


def _pair(value: Any) -> Any:
    if not isinstance(value, list):
        raise ValueError(f"expected [lo, hi], got {describe(value)}")
    return value


def _ordered(pair: list[float | None]) -> list[float | None]:
    low, high = pair
    if low is not None and high is not None and low > high:
        raise ValueError(f"lower bound {low:g} is above upper bound {high:g}")
    return pair


Pair = Annotated[
    list[Side], Field(min_length=2, max_length=2), BeforeValidator(_pair), AfterValidator(_ordered)
]


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


def _ordered_lists(bound: list[list[float | None]]) -> list[list[float | None]]:
    low, high = bound
    if len(low) != len(high):
        raise ValueError(f"{len(low)} lower but {len(high)} upper bounds; expected as many")
    for i, (lo, hi) in enumerate(zip(low, high, strict=True)):
        if lo is not None and hi is not None and lo > hi:
            raise ValueError(f"lower bound {lo:g} is above upper bound {hi:g} in component {i + 1}")
    return bound


StateBound = Annotated[
    Annotated[Pair, Tag("<pair>")]
    | Annotated[
        list[list[Side]], Field(min_length=2, max_length=2), AfterValidator(_ordered_lists), Tag("<lists>")
    ],
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


def check_constraints(value: Constraints, system: System, outputs: tuple[str, ...] | None) -> Constraints:
    """The block itself, if the system has everything that it names."""
    if issues := list(_misfits(value, system, outputs)):
        raise Refusal(issues)
    return value


def _misfits(value: Constraints, system: System, outputs: tuple[str, ...] | None) -> Iterator[Issue]:
    given = value.given()
    for key, asked in given.items():
        if words := KINDS[key].lacking(system):
            yield Issue((key,), words, at_key=True)
        elif words := KINDS[key].misfit(asked, system):
            yield Issue((key,), words)
    blocks = {block.name: block for block in system.state_space.blocks}
    known = [name for name, block in blocks.items() if block.kind != "rotation"] + list(outputs or ())
    for name, bound in given.get("state", {}).items():
        block = blocks.get(name)
        if block is None:
            if outputs is not None and name not in known:
                yield Issue(("state", name), "unknown quantity", at_key=True, known=tuple(known))
        elif block.kind == "rotation":
            yield Issue(
                ("state", name), f"a rotation cannot be bounded; bound one of {', '.join(known)}", at_key=True
            )
        elif (fault := _shape_fault(block, bound)) is not None:
            yield Issue(("state", name), fault)


def _shape_fault(block: Block, bound: list[Any]) -> str | None:
    if not isinstance(bound[0], list):
        return None  # [lo, hi] holds for every component
    if block.kind == "scalar":
        return "lists of bounds; expected [lo, hi], for this is one number"
    if len(bound[0]) != block.components:
        return f"{len(bound[0])} bounds a side; expected {block.components}"
    return None
