r"""One shooting interval as CasADi functions of its variables, with its first and second derivatives.

Variables w = (z, s): local coordinates of the first node, then whatever else the interval knows, which stays as it is
within it. Parameters p: constants c, and φ where the steps see the control. With four functions, all of the kind
(y, s, c, φ) ↦ ·,
    y_0 = open(z),   a `Tableau` of the increments h f = slope(y),   rows(y_j) after every step,   (q, F) = close(y_S),
the interval makes of them its cost q and its outputs: F, then the rows that are kept.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.tableau import CLASSICAL, Tableau


class Shots(ABC):
    """The functions of a `Shot` on as many columns as there are intervals; one column for each."""

    @abstractmethod
    def _function(self, name: str) -> ca.Function:
        """That of the `Shot` with this name, on all columns."""

    @abstractmethod
    def note(self, seconds: float) -> None:
        """Takes down what a solve with these functions has cost."""

    @cached_property
    def cost(self) -> ca.Function:
        """(w, p) ↦ q."""
        return self._function("cost")

    @cached_property
    def value(self) -> ca.Function:
        """(w, p) ↦ outputs."""
        return self._function("value")

    @cached_property
    def gradient(self) -> ca.Function:
        """(w, p) ↦ q, ∇q."""
        return self._function("gradient")

    @cached_property
    def jacobian(self) -> ca.Function:
        """(w, p) ↦ outputs, their Jacobians side by side."""
        return self._function("jacobian")

    @cached_property
    def hessian(self) -> ca.Function:
        """(w, p, σ, λ) ↦ the Hessians of σ q + λ·outputs side by side."""
        return self._function("hessian")


@dataclass(frozen=True, eq=False)
class Shot:
    """The parts of an interval and how often they are used.

    ``places``: (steps + 1, rows), for every row at the end of every step (and the start) its number among the outputs,
    or -1 where it is not kept.
    """

    opened: ca.Function
    slope: ca.Function
    rows: ca.Function
    closed: ca.Function
    places: Array
    tableau: Tableau = CLASSICAL

    @property
    def parts(self) -> tuple[ca.Function, ...]:
        return self.opened, self.slope, self.rows, self.closed

    @property
    def steps(self) -> int:
        return len(self.places) - 1

    @cached_property
    def variables(self) -> int:
        """Numbers in w."""
        return int(self.opened.numel_in(0) + self.opened.numel_in(1))

    @cached_property
    def outputs(self) -> int:
        return int(self.closed.numel_out(0)) - 1 + int((self.places >= 0).sum())

    @cached_property
    def parameters(self) -> int:
        """Numbers in p."""
        return int(self.slope.numel_in(2) + self.tableau.samples(self.steps) * self.slope.numel_in(3))

    @cached_property
    def length(self) -> int:
        """Instructions of one evaluation, roughly."""
        return int(
            self.tableau.stages * self.steps * self.slope.n_instructions() + self.rows.n_instructions()
        )

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("w", self.variables), ca.SX.sym("p", self.parameters)

    @cached_property
    def _expressions(self) -> tuple[ca.SX, ca.SX]:
        """q and the outputs, written out."""
        w, p = self._symbols
        z, s = ca.vertsplit(w, [0, self.opened.numel_in(0), self.variables])
        first, size = self.slope.numel_in(2), self.slope.numel_in(3)
        constants = p[:first]
        at = [p[first + i * size : first + (i + 1) * size] for i in range(self.tableau.samples(self.steps))]
        y = self.opened(z, s, constants, at[0])
        reached, seen = [y], self.tableau.seen - 1
        for j in range(self.steps):
            y = self.step(y, s, constants, at[seen * j : seen * (j + 1) + 1])
            reached.append(y)
        closed = self.closed(y, s, constants, at[-1])
        kept: list[ca.SX] = [ca.SX(0)] * (self.outputs - closed.numel() + 1)
        for j, (point, places) in enumerate(zip(reached, self.places, strict=True)):
            if (places >= 0).any():
                values = self.rows(point, s, constants, at[seen * j])
                for i in np.flatnonzero(places >= 0):
                    kept[places[i] - closed.numel() + 1] = values[int(i)]
        return closed[0], ca.vertcat(closed[1:], *kept)

    def step(self, y: ca.SX, s: ca.SX, constants: ca.SX, phi: Sequence[ca.SX]) -> ca.SX:
        """One step; φ where it sees the control."""
        following, _ = self.tableau.step(
            lambda point, place: self.slope(point, s, constants, phi[place]), y, 1.0
        )
        return following

    # --- by CasADi's own evaluation -----------------------------------------------------------------------------

    @cached_property
    def cost(self) -> ca.Function:
        """(w, p) ↦ q; apart, since IPOPT asks for f and for g apart."""
        return ca.Function("cost", [*self._symbols], [self._expressions[0]])

    @cached_property
    def value(self) -> ca.Function:
        """(w, p) ↦ the outputs, dense."""
        return ca.Function("value", [*self._symbols], [ca.densify(self._expressions[1])])

    @cached_property
    def gradient(self) -> ca.Function:
        """(w, p) ↦ q, its gradient."""
        (w, p), (q, _) = self._symbols, self._expressions
        return ca.Function("gradient", [w, p], [q, ca.densify(ca.gradient(q, w))])

    @cached_property
    def jacobian(self) -> ca.Function:
        """(w, p) ↦ the outputs, their Jacobian, dense."""
        (w, p), (_, outputs) = self._symbols, self._expressions
        return ca.Function("jacobian", [w, p], [ca.densify(outputs), ca.densify(ca.jacobian(outputs, w))])

    @cached_property
    def hessian(self) -> ca.Function:
        """(w, p, σ, λ) ↦ the Hessian of σ q + λ·outputs, dense."""
        (w, p), (sigma, multipliers, lagrangian) = self._symbols, self._lagrangian
        hessian = ca.densify(ca.hessian(lagrangian, w)[0])
        return ca.Function("hessian", [w, p, sigma, multipliers], [hessian])

    def interpreted(self, intervals: int, note: Callable[[float], None] | None = None) -> MappedShots:
        """On so many columns at once; ``note`` is told what that costs."""
        return MappedShots(self, intervals, note)

    @cached_property
    def directional(self) -> ca.Function:
        """(w, p, σ, λ, v) ↦ q, outputs, ∇q, (outputs' Jacobian) v, (the Hessian of σ q + λ·outputs) v.

        By other sweeps than the matrices are made with, and far cheaper than they are.
        """
        (w, p), (sigma, multipliers, lagrangian) = self._symbols, self._lagrangian
        (q, outputs), v = self._expressions, ca.SX.sym("v", self.variables)
        along = ca.jtimes(outputs, w, v), ca.jtimes(ca.gradient(lagrangian, w), w, v)
        results = [q, outputs, ca.gradient(q, w), *along]
        inputs = [w, p, sigma, multipliers, v]
        return ca.Function("directional", inputs, [ca.densify(result) for result in results])

    @cached_property
    def _lagrangian(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        q, outputs = self._expressions
        sigma, multipliers = ca.SX.sym("sigma"), ca.SX.sym("lam", self.outputs)
        return sigma, multipliers, sigma * q + ca.dot(multipliers, outputs)


def part(name: str, arguments: Sequence[ca.SX], result: Any) -> ca.Function:
    """A part of a `Shot`: (y, s, c, φ) ↦ result, dense."""
    return ca.Function(name, list(arguments), [ca.densify(ca.SX(result))])


class MappedShots(Shots):
    """By CasADi's own evaluation."""

    def __init__(self, shot: Shot, intervals: int, note: Callable[[float], None] | None) -> None:
        self._shot, self._intervals, self._note = shot, intervals, note

    def _function(self, name: str) -> ca.Function:
        return getattr(self._shot, name).map(self._intervals)

    def note(self, seconds: float) -> None:
        if self._note:
            self._note(seconds)
