"""A control on the smooth pieces between its breakpoints, and a path over many short ones in one call.

Both cost the same for each piece, however many there are.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import acos
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.integrate import DOP853

from nhpocp.arrays import Array
from nhpocp.calls import call
from nhpocp.controls.control import Control
from nhpocp.verification.fast_function import FastFunction

AT_ONCE = 256  # pieces

# On a smooth piece, mapped to [-1, 1]: basis functions are interpolated at Chebyshev's nodes, and compared with that at
# probes which are no multiples of a fraction that a period may have
DEGREE = 16
NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
PROBES = np.array([-0.7726, 0.0582, 0.7426])
TO_COEFFICIENTS = np.linalg.inv(chebvander(NODES, DEGREE))
INTERPOLATED = chebvander(PROBES, DEGREE) @ TO_COEFFICIENTS
ROUNDING = 1e-13  # of the largest value on the piece

Inputs = Callable[[float], Array]  # t ↦ u(t) on one piece, with the limits from inside at either end


@dataclass(frozen=True)
class Pieces:
    """Up to `AT_ONCE` smooth pieces, one after another, tabulated together.

    Where all basis functions are one and the same polynomial each on a piece, which no choice of coefficients can
    feign, so is u, and the table is enough.
    """

    control: Control
    ends: Array  # (k + 1,)
    constant: Array  # (k,) whether u is
    polynomial: Array  # (k,) whether it is one of a degree up to `DEGREE`
    controls: Array  # u at the nodes, (k, nodes, inputs)

    def __len__(self) -> int:
        return len(self.constant)

    def inputs(self, k: int) -> Inputs:
        """u on piece k."""
        first, last = self.ends[k : k + 2]
        if self.constant[k]:
            value = self.controls[k, 0]
            return lambda t: value
        if self.polynomial[k]:
            middle, half = 0.5 * (first + last), 0.5 * (last - first)
            polynomial, orders = TO_COEFFICIENTS @ self.controls[k], np.arange(DEGREE + 1)
            # T_k(x) = cos(k arccos x)
            return lambda t: np.cos(orders * acos(min(1.0, max(-1.0, (t - middle) / half)))) @ polynomial
        own, begin = self.control.between(first, last)
        if not len(own.breakpoints):
            time = ca.SX.sym("t")
            values = FastFunction(
                ca.Function("values", [time], [ca.densify(own.basis.values(time, own.horizon))])
            )
            return lambda t: own.coefficients @ values(min(t, last) - begin)
        return lambda t: own(np.array([min(t, last) - begin]), "left" if t >= last else "right")[0]


def in_pieces(control: Control) -> Iterator[Pieces]:
    """The whole control."""
    knots = np.unique([0.0, *control.breakpoints, control.horizon])
    places, nodes = np.concatenate([NODES, PROBES]), len(NODES)
    for start in range(0, len(knots) - 1, AT_ONCE):
        ends = knots[start : start + AT_ONCE + 1]
        times = 0.5 * (ends[:-1] + ends[1:])[:, None] + 0.5 * np.diff(ends)[:, None] * places
        table = control.basis.local_table(times.ravel(), control.horizon)
        values = table.values.reshape(*times.shape, -1)
        first = np.zeros(times.shape) if table.first is None else table.first.reshape(times.shape)
        same = (first == first[:, :1]).all(axis=1)
        apart = np.abs(INTERPOLATED @ values[:, :nodes] - values[:, nodes:])
        yield Pieces(
            control,
            ends,
            same & (values == values[:, :1]).all(axis=(1, 2)),
            same & (apart <= ROUNDING * np.abs(values).max(axis=(1, 2), keepdims=True)).all(axis=(1, 2)),
            (table @ control.coefficients.T).reshape(*times.shape, -1)[:, :nodes],
        )


@dataclass(frozen=True)
class Steps:
    """Steps of DOP853 one after another, with its polynomials of degree 7 between their ends."""

    begins: Array  # (k,)
    widths: Array  # (k,)
    states: Array  # where they begin, (k, n)
    powers: Array  # SciPy's F, (k, 7, n)

    @classmethod
    def of(cls, dense: Any) -> Steps:
        """One step of SciPy's."""
        return cls(np.array([dense.t_old]), np.array([dense.h]), dense.y_old[None], dense.F[None])

    @classmethod
    def joined(cls, parts: list[Steps]) -> Steps:
        names = ("begins", "widths", "states", "powers")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    @classmethod
    def beside(cls, parts: Sequence[Steps]) -> Steps:
        """The same steps of several paths as one."""
        states = np.concatenate([part.states for part in parts], axis=1)
        powers = np.concatenate([part.powers for part in parts], axis=2)
        return cls(parts[0].begins, parts[0].widths, states, powers)

    def of_columns(self, columns: slice) -> Steps:
        """The steps of a part of the state."""
        return Steps(self.begins, self.widths, self.states[:, columns], self.powers[:, :, columns])

    def __getitem__(self, part: slice) -> Steps:
        return Steps(self.begins[part], self.widths[part], self.states[part], self.powers[part])

    @cached_property
    def _monomials(self) -> Array:
        """The states' coefficients of 1, x, …, x⁷ over a step, x from 0 to 1, (k, 8, n)."""
        total = np.zeros((len(self.widths), self.powers.shape[1] + 1, self.states.shape[1]))
        for i in range(self.powers.shape[1]):
            total[:, 0] += self.powers[:, -1 - i]
            shifted = np.roll(total, 1, axis=1)  # the last one is still 0
            total = total - shifted if i % 2 else shifted
        total[:, 0] += self.states
        return total

    def at(self, time: float) -> Array:
        """The state (n,) at one time, as by a call but in less time."""
        place = max(bisect_left(self._begins, time) - 1, 0)
        fraction = (time - self._begins[place]) / self._widths[place]
        return np.asarray(fraction**self._orders @ self._monomials[place])

    @cached_property
    def _orders(self) -> Array:
        return np.arange(self.powers.shape[1] + 1)

    @cached_property
    def _begins(self) -> list[float]:
        return self.begins.tolist()

    @cached_property
    def _widths(self) -> list[float]:
        return self.widths.tolist()

    def __call__(self, times: Array) -> Array:
        """States (…, n) at times (…); a step's end belongs to it."""
        place = np.maximum(np.searchsorted(self.begins, times, side="left") - 1, 0)
        fraction = ((times - self.begins[place]) / self.widths[place])[..., None]
        state = np.zeros(self.states.shape[1])
        for i in range(self.powers.shape[1]):
            state = (state + self.powers[place, -1 - i]) * (1 - fraction if i % 2 else fraction)
        return np.asarray(state + self.states[place])


class Strides:
    """DOP853 with one step for each of many short pieces on which the input is constant, all in one call.

    The coefficients and the estimate of the error are SciPy's, which is left to follow what this does not.
    """

    def __init__(self, rate: ca.Function, rtol: float, atol: Array | float) -> None:
        """rate: (x, u) ↦ ẋ."""
        x, u = ca.SX.sym("x", rate.size1_in(0)), ca.SX.sym("u", rate.size1_in(1))
        h, last = ca.SX.sym("h"), DOP853.n_stages
        weights = np.zeros((last + 1 + len(DOP853.A_EXTRA), DOP853.A_EXTRA.shape[1]))
        weights[:last, :last], weights[last, :last], weights[last + 1 :] = DOP853.A, DOP853.B, DOP853.A_EXTRA
        rates = rate(x, u)
        for k in range(1, len(weights)):
            rates = ca.horzcat(rates, rate(x + h * rates @ weights[k, :k], u))
        change = h * rates[:, :last] @ DOP853.B
        size = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(x + change))
        fifth, third = (ca.sumsqr(rates[:, : last + 1] @ error / size) for error in (DOP853.E5, DOP853.E3))
        error = h * fifth / ca.sqrt((fifth + 0.01 * third) * x.numel() + np.finfo(float).tiny)
        ends = rates[:, 0], rates[:, last]
        powers = [change, h * ends[0] - change, 2 * change - h * (ends[0] + ends[1]), h * rates @ DOP853.D.T]
        step = ca.Function("step", [x, h, u], [x + change, error, ca.horzcat(*powers)])
        self._steps = step.mapaccum(AT_ONCE)

    def along(self, state: Array, pieces: Pieces, longest: float) -> tuple[Steps, Array]:
        """The steps over the first pieces, as far as they are accurate enough, and the states where they end."""
        widths = np.diff(pieces.ends)
        count, unused = len(widths), AT_ONCE - len(widths)
        controls = np.pad(pieces.controls[:, 0], ((0, unused), (0, 0)))
        ends, errors, powers = call(self._steps, state, np.pad(widths, (0, unused)), controls)
        good = pieces.constant & (widths <= longest) & (errors.ravel()[:count] < 1)
        good &= np.isfinite(powers.reshape(AT_ONCE, -1)[:count]).all(axis=1)
        accepted = int(np.argmin(np.append(good, False)))
        states = np.vstack([state, ends])
        steps = Steps(
            pieces.ends[:-1], widths, states[:count], powers.reshape(AT_ONCE, -1, len(state))[:count]
        )
        return steps[:accepted], states[1 : accepted + 1]
