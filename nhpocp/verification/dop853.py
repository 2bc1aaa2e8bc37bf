"""DOP853, every step of which is one call of CasADi. [Hairer, Nørsett, Wanner I, sections II.4 to II.6]

SciPy's DOP853 asks for one rate after another, 12 to 15 a step, and takes more than twice as long. Its coefficients are
used here, its estimate of the error, its lengths of steps and its polynomials between; a test holds every step of a
unicycle and of the paper's robot against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.integrate import DOP853

from nhpocp.arrays import Array
from nhpocp.calls import call
from nhpocp.verification.pieces import AT_ONCE, Pieces

NODES = np.array([*DOP853.C, 1.0, *DOP853.C_EXTRA])  # of a step, where its rates are taken
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0  # the next step: of what its error allows, and times the last one
ORDER = 8  # the error of a step falls as this power of its length


@dataclass(frozen=True)
class Steps:
    """Steps of DOP853 one after another, with its polynomials of degree 7 between their ends."""

    begins: Array  # (k,)
    widths: Array  # (k,)
    states: Array  # where they begin, (k, n)
    powers: Array  # SciPy's F, (k, 7, n)

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

    def __call__(self, times: Array) -> Array:
        """States (…, n) at times (…); a step's end belongs to it."""
        place = np.maximum(np.searchsorted(self.begins, times, side="left") - 1, 0)
        fraction = (times - self.begins[place]) / self.widths[place]
        orders = np.arange(self.powers.shape[1] + 1)
        return np.asarray((fraction[..., None, None] ** orders @ self._monomials[place])[..., 0, :])


class Dop853:
    """Single steps of ẋ = rate(x, …), what follows x being given at the step's `NODES`.

    rate: function of a state and of inputs, each of any shape. rtol, atol: allowed error, the latter a number or one
    for each of the state's.
    """

    def __init__(self, rate: ca.Function, rtol: float, atol: Array | float) -> None:
        self._rate, shapes = rate, [rate.size_in(i) for i in range(rate.n_in())]
        counts = [rows * columns for rows, columns in shapes]
        x, h = ca.MX.sym("x", counts[0]), ca.MX.sym("h")
        inputs = ca.MX.sym("inputs", sum(counts[1:]), len(NODES))
        last = DOP853.n_stages
        weights = np.zeros((len(NODES), len(NODES)))
        weights[:last, :last], weights[last, :last] = DOP853.A, DOP853.B
        weights[last + 1 :, : DOP853.A_EXTRA.shape[1]] = DOP853.A_EXTRA

        def rate_at(state: ca.MX, node: int) -> ca.MX:
            parts = ca.vertsplit(inputs[:, node], np.cumsum([0, *counts[1:]]).tolist())
            pairs = zip([state, *parts], shapes, strict=True)
            return ca.vec(ca.densify(rate(*(ca.reshape(part, *shape) for part, shape in pairs))))

        rates: list[ca.MX] = []
        for node, row in enumerate(weights):
            rates.append(rate_at(x + h * _sum(rates, row) if node else x, node))
        change = h * _sum(rates, DOP853.B)
        size = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(x + change))
        fifth, third = (ca.sumsqr(_sum(rates, error) / size) for error in (DOP853.E5, DOP853.E3))
        error = h * fifth / ca.sqrt((fifth + 0.01 * third) * counts[0] + np.finfo(float).tiny)
        powers = [change, h * rates[0] - change, 2 * change - h * (rates[0] + rates[last])]
        powers += [h * _sum(rates, row) for row in DOP853.D]
        self._step = ca.Function("step", [x, h, inputs], [x + change, error, ca.horzcat(*powers)])

    def __call__(self, state: Array, width: float, inputs: Array) -> tuple[Array, float, Array]:
        """Where a step ends (n,), its error in units of what is allowed, and the powers (7, n) of `Steps`."""
        end, error, powers = call(self._step, state, np.array(width), inputs)
        return end[0], float(error[0, 0]), powers

    def finite(self, state: Array, inputs: Array) -> bool:
        """Whether the rate is, under inputs (k, ·) of which the first count."""
        _, _, powers = self(state, 0.0, inputs)
        return bool(np.isfinite(powers).all())

    @property
    def quick(self) -> bool:
        """Whether many steps can be taken in one call: of one system, not of several in company."""
        return bool(self._rate.is_a("SXFunction"))

    @cached_property
    def _strides(self) -> ca.Function:
        """`AT_ONCE` steps one after another, of one value of the inputs each."""
        x, h = ca.MX.sym("x", self._rate.numel_in(0)), ca.MX.sym("h")
        inputs = ca.MX.sym("inputs", self._step.size1_in(2))
        step = self._step(x, h, ca.repmat(inputs, 1, len(NODES)))
        return ca.Function("stride", [x, h, inputs], list(step)).expand().mapaccum(AT_ONCE)

    def along(self, state: Array, pieces: Pieces, longest: float) -> tuple[Steps, Array]:
        """One step for each of the first pieces, as long as they are accurate enough, and the states where they end."""
        widths = np.diff(pieces.ends)
        count, unused = len(widths), AT_ONCE - len(widths)
        controls = np.pad(pieces.controls[:, 0], ((0, unused), (0, 0)))
        ends, errors, powers = call(self._strides, state, np.pad(widths, (0, unused)), controls)
        good = pieces.constant & (widths <= longest) & (errors.ravel()[:count] < 1)
        good &= np.isfinite(powers.reshape(AT_ONCE, -1)[:count]).all(axis=1)
        accepted = int(np.argmin(np.append(good, False)))
        states = np.vstack([state, ends])
        steps = Steps(
            pieces.ends[:-1], widths, states[:count], powers.reshape(AT_ONCE, -1, len(state))[:count]
        )
        return steps[:accepted], states[1 : accepted + 1]


def longer(width: float, error: float, rejected: bool) -> float:
    """The width of the next step, or of the same one again where the error is not below 1.

    rejected: whether this one has been tried before, with a greater width.
    """
    power = MOST if error == 0 else SAFETY * error ** (-1 / ORDER)
    if error < 1:
        return width * min(power, 1.0 if rejected else MOST)
    return width * max(LEAST, power)  # which is LEAST for an error that is no number


def _sum(rates: Sequence[ca.MX], weights: Array) -> ca.MX:
    """Of rates by their weights, most of which are 0."""
    counted = [k for k in range(min(len(rates), len(weights))) if weights[k]]
    return ca.horzcat(*(rates[k] for k in counted)) @ weights[counted]
