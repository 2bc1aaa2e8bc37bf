"""B-splines of any degree on equal intervals, clamped at both ends. [de Boor, A Practical Guide to Splines]"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp import declared
from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.table import Gram, Table
from nhpocp.errors import InvalidProblemError


@dataclass(frozen=True)
class BSpline(ControlBasis):
    """The degree + intervals B-splines over equal intervals of [0, T]; they are ≥ 0 and add up to 1.

    The pieces are polynomials of the degree, joined with degree - 1 continuous derivatives; the ends' functions are 1
    there. Degree 0 is `PiecewiseConstant`, and is written so.
    """

    degree: int = declared.degree(3, "of the polynomial pieces")
    intervals: int = declared.count(8, "degree + intervals functions per input")
    kind: ClassVar[str] = "bspline"
    meaning: ClassVar[str] = "B-splines on equal intervals"

    @property
    def size(self) -> int:
        return self.degree + self.intervals

    @property
    def labels(self) -> list[str]:
        return [f"B{k}" for k in range(self.size)]

    @property
    def _steps(self) -> PiecewiseConstant:
        return PiecewiseConstant(self.intervals)

    def knots(self, horizon: float) -> Array:
        """Ends of the intervals, the first and the last degree + 1 times."""
        inner = np.arange(1, self.intervals) / self.intervals
        return horizon * np.concatenate([np.zeros(self.degree + 1), inner, np.ones(self.degree + 1)])

    def _functions(self, times: Array, steps: Sequence[Array]) -> list[Array]:
        """From those of degree 0, by the recurrence of Cox and de Boor, at times of a horizon of 1."""
        knots = self.knots(1.0)
        functions: list[Array] = [0.0] * self.degree + list(steps) + [0.0] * self.degree
        for degree in range(1, self.degree + 1):
            widths = knots[degree:] - knots[:-degree]
            rising = [(times - knot) / w if w > 0 else 0.0 for knot, w in zip(knots, widths, strict=False)]
            falling = [
                (knot - times) / w if w > 0 else 0.0 for knot, w in zip(knots[degree:], widths, strict=True)
            ]
            functions = [
                rising[i] * functions[i] + falling[i + 1] * functions[i + 1]
                for i in range(len(functions) - 1)
            ]
        return functions

    def values(self, time: Array, horizon: float) -> Array:
        steps = self._steps.values(time, horizon)
        return namespace(time).vector(
            self._functions(time / horizon, [steps[k] for k in range(self.intervals)])
        )

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return self.local_table(times, horizon, side).dense()

    def local_table(self, times: Array, horizon: float, side: Side = "right") -> Table:
        # the degree + 1 functions that are not 0 on an interval begin with the one of its number
        place = np.asarray(self._steps.local_table(times, horizon, side).first)
        return Table(self._local(np.asarray(times, dtype=float) / horizon, place), self.size, place)

    def _local(self, times: Array, place: Array) -> Array:
        """Those that are not 0 on the intervals ``place`` (k,), at times of a horizon of 1, (k, degree + 1)."""
        knots, functions = self.knots(1.0), np.ones((len(times), 1))
        for degree in range(1, self.degree + 1):  # the recurrence of Cox and de Boor, on one interval
            ends = place[:, None] + self.degree + np.arange(1, degree + 1)
            low, high = knots[ends - degree], knots[ends]
            part = functions / (high - low)
            functions = np.zeros((len(times), degree + 1))
            functions[:, :-1] += (high - times[:, None]) * part
            functions[:, 1:] += (times[:, None] - low) * part
        return functions

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        if self.degree == 0:
            return self._steps.derivative_table(times, horizon, side)
        knots = self.knots(horizon)[1:-1]
        slopes = self.degree / (knots[self.degree :] - knots[: -self.degree])
        parts = np.diff(np.vstack([np.zeros(self.size), np.eye(self.size)]), axis=0)  # B' of the differences
        lower = BSpline(self.degree - 1, self.intervals).table(times, horizon, side)
        return (lower * slopes) @ parts[1:]

    def gram(self, horizon: float) -> Gram:
        nodes, weights = np.polynomial.legendre.leggauss(self.degree + 1)  # exact for products
        starts, width = np.arange(self.intervals)[:, None], self.degree + 1
        values = self.local_table(((starts + 0.5 * (nodes + 1.0)) / self.intervals).ravel(), 1.0).values
        values = values.reshape(self.intervals, len(nodes), width)
        products = np.einsum("inf,n,ing->ifg", values, 0.5 * horizon / self.intervals * weights, values)
        bands = np.zeros((width, self.size))
        for f in range(width):
            for d in range(width - f):
                bands[d, f : f + self.intervals] += products[:, f, f + d]
        return Gram(bands)

    def breakpoints(self, horizon: float) -> Array:
        return self._steps.breakpoints(horizon)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        coefficients = np.asarray(data["coefficients"], dtype=float)
        knots, degree = np.asarray(data["knots"], dtype=float), int(data["degree"])
        if not len(coefficients):  # no inputs
            coefficients = coefficients.reshape(0, len(knots) - degree - 1)
        basis = cls(degree, coefficients.shape[1] - degree)
        expected = basis.knots(data["horizon"])
        if knots.shape != expected.shape or np.abs(knots - expected).max() > 1e-9 * data["horizon"]:
            raise InvalidProblemError(
                "knots that are not uniform and clamped; only equal intervals are supported",
                path="control.knots",
            )
        return basis, coefficients

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        if self.degree == 0:
            return self._steps.to_json(coefficients, horizon)
        return {
            "basis": self.kind,
            "horizon": horizon,
            "degree": self.degree,
            "knots": self.knots(horizon).tolist(),
            "coefficients": np.asarray(coefficients).tolist(),
        }
