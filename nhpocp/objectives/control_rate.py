"""The rate of the control."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

from nhpocp.arrays import Array
from nhpocp.objectives.objective import ControlObjective
from nhpocp.scales import Scales

if TYPE_CHECKING:
    from nhpocp.controls.basis import ControlBasis
    from nhpocp.controls.control import Control
    from nhpocp.controls.table import Gram

POINTS = 16  # Gauss-Legendre nodes a piece
PIECES = 2  # for each period of the fastest function: so many nodes integrate its square to rounding
# functions, beyond which the matrix takes longer than a solve, and only who asks for it has it made
MOST = 400


class ControlRate(ControlObjective):
    """∫ |u̇|² dt, of controls that do not jump."""

    name = "control_rate"
    symbol = "∫|d{control}/dt|² dt"
    formula = "∫|u̇|²"
    meaning = "∫|d control/dt|² dt"
    pace = -3

    def scale(self, scales: Scales) -> float:
        largest = float(max(scales.inputs, default=0.0))
        return largest * largest / float(scales.time) or 1.0

    def lacking_control(self, basis: ControlBasis) -> str:
        from nhpocp.controls.jumps import may_jump

        return f"{self.name} asks for a derivative, and {basis.kind} controls jump" if may_jump(basis) else ""

    def of_control(self, control: Control) -> float | None:
        return None if control.basis.size > MOST else super().of_control(control)

    def gram(self, basis: ControlBasis, horizon: float) -> Gram:
        import numpy as np

        from nhpocp.controls.table import Gram

        pieces = max(1, ceil(PIECES * basis.oscillations))
        knots = np.unique(np.concatenate([np.linspace(0, 1, pieces + 1), basis.breakpoints(1.0)])) * horizon
        nodes, weights = np.polynomial.legendre.leggauss(POINTS)
        middles, halves = 0.5 * (knots[1:] + knots[:-1])[:, None], 0.5 * np.diff(knots)[:, None]
        slopes = basis.derivative_table((middles + halves * nodes).ravel(), horizon)
        return Gram.of(slopes.T @ ((halves * weights).ravel()[:, None] * slopes))

    def density(self, control: Control, times: Array) -> Array:
        return (control.derivative(times) ** 2).sum(axis=1)
