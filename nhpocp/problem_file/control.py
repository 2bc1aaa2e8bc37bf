"""The `control` block: the basis of the control and the control to begin with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Discriminator, Field, Tag, create_model

from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.registry import BASES
from nhpocp.errors import InvalidProblemError, describe, suggestion
from nhpocp.problem_file.derived import block_fields
from nhpocp.problem_file.numbers import Number
from nhpocp.problem_file.settings import absent
from nhpocp.problem_file.states import Strict

DEFAULT = "fourier"


def _check_initial(value: Any) -> Any:
    if isinstance(value, list) or value == "auto":
        return value
    raise ValueError(f"expected auto or one row of numbers per input, got {describe(value)}")


def _initial_kind(value: Any) -> str:
    return "<rows>" if isinstance(value, list) else "<auto>"


Initial = Annotated[
    Annotated[Literal["auto"], Tag("<auto>")] | Annotated[list[list[Number]], Tag("<rows>")],
    Discriminator(_initial_kind),
    BeforeValidator(_check_initial),
]


class ControlBlock(Strict):
    """What every basis has in common."""

    basis: str
    initial: Initial = Field(
        default="auto", description="one row of coefficients per input; auto: a seeded control of full rank"
    )

    def made(self) -> ControlBasis:
        """The basis of this block."""
        return BASES[self.basis](**self.model_dump(exclude={"basis", "initial"}))


def _block(kind: str, basis: type[ControlBasis]) -> type[ControlBlock]:
    """The block of one basis."""
    default: dict[str, Any] = {"default": kind} if kind == DEFAULT else {}
    named: dict[str, Any] = {"basis": (Literal[kind], Field(description=basis.meaning, **default))}
    doc = f"{basis.meaning[:1].upper()}{basis.meaning[1:]}."
    fields = named | block_fields(basis)
    return create_model(f"{basis.__name__}Control", __base__=ControlBlock, __doc__=doc, **fields)


BLOCKS = {kind: _block(kind, basis) for kind, basis in BASES.items()}


def _check_basis(value: Any) -> Any:
    value = absent(value)
    if isinstance(value, dict) and value.get("basis", DEFAULT) not in list(BLOCKS):
        basis = value["basis"]
        what = f"unknown basis {basis!r}; " if isinstance(basis, str) else f"got {describe(basis)}; "
        hint = suggestion(basis, BLOCKS) if isinstance(basis, str) else f"expected one of {', '.join(BLOCKS)}"
        raise InvalidProblemError(what + hint, path="basis")
    return value


def _basis_kind(value: Any) -> str:
    basis = value.get("basis", DEFAULT) if isinstance(value, dict) else getattr(value, "basis", DEFAULT)
    return f"<{basis}>"


if TYPE_CHECKING:
    ControlData = ControlBlock
else:
    ControlData = Annotated[
        Union[tuple(Annotated[block, Tag(f"<{kind}>")] for kind, block in BLOCKS.items())],  # noqa: UP007
        Discriminator(_basis_kind),
        BeforeValidator(_check_basis),
    ]
