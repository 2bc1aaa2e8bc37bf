"""The `control` block: the basis of the control and the control to begin with."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from nhpocp.problem_file.issues import Issue, Refusal, suggestion
from nhpocp.problem_file.numbers import Count, Degree, Number, describe
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

    @property
    @abstractmethod
    def columns(self) -> list[str]:
        """A name per basis function, as many as a row of `initial` has numbers."""

    def parameters(self) -> dict[str, Any]:
        """The basis's own settings."""
        return self.model_dump(exclude={"basis", "initial"})

    @field_validator("initial")
    @classmethod
    def _one_row_per_input(cls, value: Any, info: ValidationInfo) -> Any:
        inputs = info.context.input_space.labels if info.context else None
        if value != "auto" and inputs is not None and len(value) != len(inputs):
            names = ", ".join(inputs[:6])
            raise ValueError(f"{len(value)} rows; expected {len(inputs)}, one per input ({names})")
        return value

    @model_validator(mode="after")
    def _one_column_per_function(self) -> ControlBlock:
        rows = self.initial if isinstance(self.initial, list) else []
        names = self.columns if rows else []
        shown = ", ".join(names[:5]) + (", …" if len(names) > 5 else "")
        issues = [
            Issue(("initial", i), f"{len(row)} numbers; expected {len(names)} ({shown})")
            for i, row in enumerate(rows)
            if len(row) != len(names)
        ]
        if issues:
            raise Refusal(issues)
        return self


class FourierControl(ControlBlock):
    """Truncated Fourier series, [Paper] eq. (15)."""

    basis: Literal["fourier"] = Field(default="fourier", description="truncated Fourier series")
    harmonics: Degree = Field(default=2, description="2·harmonics + 1 functions per input")

    @property
    def columns(self) -> list[str]:
        waves = [f"{wave}{k}" for k in range(1, self.harmonics + 1) for wave in ("sin", "cos")]
        return ["const", *waves]


class LegendreControl(ControlBlock):
    """Legendre polynomials on the horizon."""

    basis: Literal["legendre"] = Field(description="Legendre polynomials")
    degree: Degree = Field(default=4, description="degree + 1 functions per input")

    @property
    def columns(self) -> list[str]:
        return [f"P{k}" for k in range(self.degree + 1)]


class BsplineControl(ControlBlock):
    """B-splines on equal intervals, clamped at both ends."""

    basis: Literal["bspline"] = Field(description="B-splines on equal intervals")
    degree: Degree = Field(default=3, description="of the polynomial pieces")
    intervals: Count = Field(default=8, description="degree + intervals functions per input")

    @property
    def columns(self) -> list[str]:
        return [f"B{k}" for k in range(self.degree + self.intervals)]


class PiecewiseControl(ControlBlock):
    """One value per interval."""

    basis: Literal["piecewise_constant"] = Field(description="one value per interval")
    intervals: Count = Field(default=50, description="equal intervals of the horizon")

    @property
    def columns(self) -> list[str]:
        return [f"interval {k}" for k in range(self.intervals)]


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
        raise Refusal([Issue(("basis",), what + hint)])
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
