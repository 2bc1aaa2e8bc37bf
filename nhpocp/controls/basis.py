"""The contract of a control basis: u(t) = Λ φ(t), Λ one row of coefficients per input."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.controls.table import Gram, Table
from nhpocp.declared import check, declarations
from nhpocp.errors import InvalidProblemError

Side = Literal["right", "left"]


class ControlBasis(Constructed):
    r"""Functions φ_1…φ_size on [0, T] that span the control of each input.

    With λ the rows of Λ one after another, u(t) = P(t) λ and P(t) = I ⊗ φ(t)ᵀ, [Paper] section 4. A frozen dataclass
    whose fields are `declared`: what a file may set. ``meaning``: what the functions are, for the file's schema.
    ``nested``: whether the functions of a smaller basis are the first of a larger one's.
    """

    kind: ClassVar[str]
    meaning: ClassVar[str] = ""
    nested: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check(self)

    def __hash__(self) -> int:
        return id(self)  # what is made for one is kept beside it; frozen dataclasses do better

    @property
    @abstractmethod
    def size(self) -> int:
        """Functions per input."""

    @property
    @abstractmethod
    def labels(self) -> list[str]:
        """A name per function."""

    @abstractmethod
    def values(self, time: Array, horizon: float) -> Array:
        """φ(t) (size,) for a number or a CasADi symbol t [time]; continuous bases only need this."""

    @abstractmethod
    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        """φ at many times (NumPy, (k,) → (k, size)); at a breakpoint the limit from the given side."""

    def local_table(self, times: Array, horizon: float, side: Side = "right") -> Table:
        """`table` without its zeros; override it where few of many functions are not zero at one time."""
        return Table(self.table(times, horizon, side), self.size)

    def piece(self, first: float, last: float, horizon: float) -> tuple[ControlBasis, slice, float, float]:
        """The basis that makes this one between neighbouring breakpoints, its functions' places, begin and duration."""
        return self, slice(None), 0.0, horizon

    @abstractmethod
    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        """dφ/dt at many times, (k, size), exactly; at a breakpoint the limit from the given side."""

    @abstractmethod
    def gram(self, horizon: float) -> Gram | Array:
        """∫₀ᵀ φ φᵀ dt, size × size."""

    @abstractmethod
    def breakpoints(self, horizon: float) -> Array:
        """Times inside (0, T) where φ is not smooth."""

    @property
    def oscillations(self) -> float:
        """Periods of the fastest function over the horizon, 0 where breakpoints tell all; 0 unless overridden."""
        return 0.0

    def parameters(self) -> dict[str, Any]:
        """Plain data from which ``type(self)(**parameters)`` builds the same basis."""
        return {name: getattr(self, name) for name in declarations(type(self))}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        """The basis and the coefficients that `to_json` wrote.

        Errors: `InvalidProblemError`, or what NumPy raises, for data that are none.
        """
        coefficients = np.asarray(data["coefficients"], dtype=float)
        basis = cls(**{name: data[name] for name in declarations(cls)})
        if not len(coefficients):  # no inputs: a list of no rows does not say how long they are
            coefficients = coefficients.reshape(0, basis.size)
        if coefficients.shape[1:] != (basis.size,):
            came = f"rows of {coefficients.shape[1:]} coefficients"
            raise InvalidProblemError(f"{came}; expected {basis.size}", path="control.coefficients")
        return basis, coefficients

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        """What a solution file says of a control over this basis."""
        return {
            "basis": self.kind,
            "horizon": horizon,
            **self.parameters(),
            "coefficients": np.asarray(coefficients).tolist(),
        }
