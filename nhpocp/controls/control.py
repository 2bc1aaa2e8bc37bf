"""A control as a function of time: a basis, its coefficients and the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.samples import SLICE, Samples
from nhpocp.controls.table import Gram
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError, describe, expect
from nhpocp.frozen import ByValue


@dataclass(frozen=True, eq=False)
class Control(ByValue, Constructed):
    """u(t) = Λ φ(t) on [0, horizon], as a function: `control(times)` is (samples, inputs) for times (samples,).

    basis: the functions φ, such as `Fourier(2)`. coefficients: Λ, inputs × basis functions, each row of an input in its
    unit. horizon: the duration T [time].
    Errors: `InvalidProblemError` for coefficients of another shape, or a duration that is none.
    """

    basis: ControlBasis
    coefficients: Array
    horizon: float = 1.0

    def __post_init__(self) -> None:
        expect(self.basis, ControlBasis, "a basis such as Fourier(2)", "Control.basis")
        if real(self.horizon, "Control.horizon", "a duration > 0") <= 0:
            words = f"{self.horizon:g} is not a duration; expected a number > 0"
            raise InvalidProblemError(words, path="Control.horizon")
        try:
            coefficients = np.array(self.coefficients, dtype=float)
        except (TypeError, ValueError):
            words = f"expected one row of numbers per input, got {describe(self.coefficients)}"
            raise InvalidProblemError(words, path="Control.coefficients") from None
        if coefficients.ndim != 2 or coefficients.shape[1] != self.basis.size:
            raise InvalidProblemError(
                f"control coefficients have shape {coefficients.shape}; expected one row per input and "
                f"{self.basis.size} columns ({', '.join(self.basis.labels[:6])}{', …' if self.basis.size > 6 else ''})"
            )
        coefficients.flags.writeable = False
        object.__setattr__(self, "coefficients", coefficients)

    def __call__(self, times: Array, side: Side = "right") -> Array:
        """Values at times (k,) → (k, inputs)."""
        times = np.atleast_1d(times)
        if len(times) * self.basis.size <= SLICE:
            return self.basis.local_table(times, self.horizon, side) @ self.coefficients.T
        return Samples(self.basis, self.horizon, times, side == "left").controls(self.coefficients)

    def between(self, first: float, last: float) -> tuple[Control, float]:
        """A control that does the same between neighbouring breakpoints, and when it begins.

        Of many in sequence it is one, which is evaluated in less time.
        """
        basis, columns, begin, duration = self.basis.piece(first, last, self.horizon)
        return Control(basis, self.coefficients[:, columns], duration), begin

    def derivative(self, times: Array, side: Side = "right") -> Array:
        """du/dt at times (k,) → (k, inputs); a jump has none."""
        return self.basis.derivative_table(np.atleast_1d(times), self.horizon, side) @ self.coefficients.T

    def __repr__(self) -> str:
        inputs, functions = self.coefficients.shape
        table = f"{inputs} × {functions} coefficients"
        return f"<Control over {self.basis!r}: {table}, horizon {self.horizon:g}, effort {self.effort:.6g}>"

    @property
    def effort(self) -> float:
        """∫₀ᵀ |u|² dt, exactly, from the Gram matrix."""
        image = Gram.of(self.basis.gram(self.horizon)) @ self.coefficients.T
        return float(np.sum(self.coefficients.T * image))

    @property
    def breakpoints(self) -> Array:
        """Times inside (0, T) where the control is not smooth."""
        return self.basis.breakpoints(self.horizon)

    def to_json(self) -> dict[str, Any]:
        return self.basis.to_json(self.coefficients, self.horizon)
