"""The contract of a control basis: u(t) = Λ φ(t), Λ one row of coefficients per input."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Protocol, Self

from nhpocp.arrays import Array
from nhpocp.controls.table import Gram, Table

Side = Literal["right", "left"]


class ControlBasis(Protocol):
    r"""Functions φ_1…φ_size on [0, T] that span the control of each input.

    With λ the rows of Λ one after another, u(t) = P(t) λ and P(t) = I ⊗ φ(t)ᵀ, [Paper] section 4.
    """

    kind: ClassVar[str]

    def __hash__(self) -> int:
        return id(self)  # what is made for one is kept beside it; frozen dataclasses do better

    @property
    def size(self) -> int:
        """Functions per input."""
        ...

    @property
    def labels(self) -> list[str]:
        """A name per function."""
        ...

    def values(self, time: Array, horizon: float) -> Array:
        """φ(t) (size,) for a number or a CasADi symbol t [time]; continuous bases only need this."""
        ...

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        """φ at many times (NumPy, (k,) → (k, size)); at a breakpoint the limit from the given side."""
        ...

    def local_table(self, times: Array, horizon: float, side: Side = "right") -> Table:
        """The same, but for the zeros; override it where few of many functions are not zero at one time."""
        return Table(self.table(times, horizon, side), self.size)

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        """dφ/dt at many times, (k, size), exactly; at a breakpoint the limit from the given side."""
        ...

    def integral_table(self, times: Array, horizon: float) -> Array:
        """∫₀ᵗ φ dt at many times, (k, size), exactly."""
        ...

    def gram(self, horizon: float) -> Gram | Array:
        """∫₀ᵀ φ φᵀ dt, size × size."""
        ...

    def breakpoints(self, horizon: float) -> Array:
        """Times inside (0, T) where φ is not smooth."""
        ...

    @property
    def oscillations(self) -> float:
        """Periods of the fastest function over the horizon, 0 where breakpoints tell all; 0 unless overridden."""
        return 0.0

    def parameters(self) -> dict[str, Any]:
        """Plain data from which ``type(self)(**parameters)`` builds the same basis."""
        ...

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        """The basis and the coefficients that `to_json` wrote."""
        ...

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        """What a solution file says of a control over this basis."""
        ...
