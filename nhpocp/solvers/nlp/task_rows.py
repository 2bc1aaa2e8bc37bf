"""Rows of an NLP that a task adds to one stage: a via pose at its own time, an output at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis


@dataclass(frozen=True)
class TaskRows:
    """Equations 0 = rows(w; p) of one stage's variables w, with parameters p."""

    stage: int  # k, or the number of intervals for the last node
    time: float  # fraction of the horizon
    names: list[str]
    w: ca.SX
    p: ca.SX
    rows: ca.SX
    parameters: Array

    @property
    def size(self) -> int:
        return len(self.names)

    @cached_property
    def value(self) -> ca.Function:
        """(w, p) ↦ the rows."""
        return ca.Function("meeting", [self.w, self.p], [ca.densify(self.rows)])

    @cached_property
    def jacobian(self) -> ca.Function:
        """(w, p) ↦ their Jacobian, dense."""
        return ca.Function("meeting_jac", [self.w, self.p], [ca.densify(ca.jacobian(self.rows, self.w))])

    @cached_property
    def hessian(self) -> ca.Function:
        """(w, p, multipliers) ↦ the Hessian of multipliers · rows, dense."""
        multipliers = ca.SX.sym("lam", self.size)
        hessian = ca.hessian(ca.dot(multipliers, self.rows), self.w)[0]
        return ca.Function("meeting_hess", [self.w, self.p, multipliers], [ca.densify(hessian)])


def place(fraction: float, intervals: int) -> tuple[int, float]:
    """The interval in which a fraction of T lies, and where in it, in [0, 1); a node up to rounding is one."""
    position = fraction * intervals
    if abs(position - round(position)) < 1e-9 * intervals:
        return round(position), 0.0
    return int(position), position - int(position)


def stage_knots(offset: float, steps: int) -> Array:
    """Ends of the steps that lead to ``offset`` in an interval of ``steps``, the last cut short; from 0, fractions."""
    knots = np.arange(int(offset * steps + 1e-9) + 1) / steps
    return np.append(knots, offset) if offset - knots[-1] > 1e-9 else knots


def basis_table(basis: ControlBasis, times: Sequence[float] | Array, slopes: bool = False) -> Array:
    """φ at fractions of the horizon, the last seen from the left: what the steps of one interval need.

    slopes: beside it the derivative by the fraction.
    """
    times, parts = np.asarray(times), [basis.table, *[basis.derivative_table] * slopes]
    table = np.hstack([part(times, 1.0) for part in parts])
    if len(times) > 1:
        table[-1] = np.hstack([part(times[-1:], 1.0, "left") for part in parts])[0]
    return table
