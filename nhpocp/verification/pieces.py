"""A control on the smooth pieces between its breakpoints, at a cost that does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from nhpocp.arrays import Array
from nhpocp.controls.control import Control

AT_ONCE = 256  # pieces

# On a smooth piece, mapped to [-1, 1]: basis functions are interpolated at Chebyshev's nodes, and compared with that at
# probes which are no multiples of a fraction that a period may have
DEGREE = 16
NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
PROBES = np.array([-0.7726, 0.0582, 0.7426])
TO_COEFFICIENTS = np.linalg.inv(chebvander(NODES, DEGREE))
INTERPOLATED = chebvander(PROBES, DEGREE) @ TO_COEFFICIENTS
ROUNDING = 1e-13  # of the largest value on the piece

# t (k,) ↦ u (k, inputs) on one piece, with the limits from inside at either end
Inputs = Callable[[Array], Array]


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
            return lambda times: np.broadcast_to(self.controls[k, 0], (len(times), self.controls.shape[2]))
        if self.polynomial[k]:
            middle, half = 0.5 * (first + last), 0.5 * (last - first)
            polynomial, orders = TO_COEFFICIENTS @ self.controls[k], np.arange(DEGREE + 1)
            # T_k(x) = cos(k arccos x)
            return lambda times: (
                np.cos(np.multiply.outer(np.arccos(np.clip((times - middle) / half, -1.0, 1.0)), orders))
                @ polynomial
            )
        own, begin = self.control.between(first, last)

        def values(times: Array) -> Array:
            inside = own(np.minimum(times, last) - begin)
            if times[-1] >= last:
                ended = times >= last
                inside[ended] = own(np.array([last - begin]), "left")
            return inside

        return values


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
