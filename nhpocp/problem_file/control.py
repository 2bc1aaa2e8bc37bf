"""The `control` block: the basis of the control and the control to begin with."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from nhpocp.errors import InvalidProblemError, describe, suggestion
from nhpocp.problem_file.numbers import Count, Degree, Number
from nhpocp.problem_file.settings import absent
from nhpocp.problem_file.states import Strict


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

    def parameters(self) -> dict[str, Any]:
        """The basis's own settings."""
        return self.model_dump(exclude={"basis", "initial"})


class FourierControl(ControlBlock):
    """Truncated Fourier series, [Paper] eq. (15)."""

    basis: Literal["fourier"] = Field(default="fourier", description="truncated Fourier series")
    harmonics: Degree = Field(default=2, description="2·harmonics + 1 functions per input")


class LegendreControl(ControlBlock):
    """Legendre polynomials on the horizon."""

    basis: Literal["legendre"] = Field(description="Legendre polynomials")
    degree: Degree = Field(default=4, description="degree + 1 functions per input")


class BsplineControl(ControlBlock):
    """B-splines on equal intervals, clamped at both ends."""

    basis: Literal["bspline"] = Field(description="B-splines on equal intervals")
    degree: Degree = Field(default=3, description="of the polynomial pieces")
    intervals: Count = Field(default=8, description="degree + intervals functions per input")


class PiecewiseControl(ControlBlock):
    """One value per interval."""

    basis: Literal["piecewise_constant"] = Field(description="one value per interval")
    intervals: Count = Field(default=50, description="equal intervals of the horizon")


BASES: dict[str, type[ControlBlock]] = {
    "fourier": FourierControl,
    "legendre": LegendreControl,
    "bspline": BsplineControl,
    "piecewise_constant": PiecewiseControl,
}


def _check_basis(value: Any) -> Any:
    value = absent(value)
    if isinstance(value, dict) and value.get("basis", "fourier") not in list(BASES):
        basis = value["basis"]
        what = f"unknown basis {basis!r}; " if isinstance(basis, str) else f"got {describe(basis)}; "
        hint = suggestion(basis, BASES) if isinstance(basis, str) else f"expected one of {', '.join(BASES)}"
        raise InvalidProblemError(what + hint, path="basis")
    return value


def _basis_kind(value: Any) -> str:
    basis = value.get("basis", "fourier") if isinstance(value, dict) else getattr(value, "basis", "fourier")
    return f"<{basis}>"


ControlData = Annotated[
    Annotated[FourierControl, Tag("<fourier>")]
    | Annotated[LegendreControl, Tag("<legendre>")]
    | Annotated[BsplineControl, Tag("<bspline>")]
    | Annotated[PiecewiseControl, Tag("<piecewise_constant>")],
    Discriminator(_basis_kind),
    BeforeValidator(_check_basis),
]
