"""Basis functions at fixed times, in memory or, where they are too many for it, slice by slice."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.table import Table

KEPT = 3 * 2**24  # numbers of a table that is made once, 400 MB; larger ones are made again, slice by slice
SLICE = 2**22  # numbers of a slice, 32 MB


class Samples:
    """φ at fixed times, those of ``from_left`` with the limit from the left; kept as a `Table` where that is small."""

    def __init__(
        self, basis: ControlBasis, horizon: float, times: Array, from_left: Array | bool = False
    ) -> None:
        self._basis, self._horizon = basis, horizon
        self._times = np.asarray(times, dtype=float)
        self._left = np.broadcast_to(np.asarray(from_left, dtype=bool), self._times.shape)

    def __len__(self) -> int:
        return len(self._times)

    def _table(self, part: slice) -> Table:
        basis, times, left = self._basis, self._times[part], self._left[part]
        right = basis.local_table(times, self._horizon, "right")
        if not left.any():
            return right
        other = basis.local_table(times[left], self._horizon, "left")
        values, first = right.values.copy(), None
        values[left] = other.values
        if right.first is not None and other.first is not None:
            first = right.first.copy()
            first[left] = other.first
        return Table(values, right.size, first)

    @cached_property
    def _rows(self) -> int:
        """Times in a slice; all of them where the whole table is kept."""
        if not len(self):
            return 1
        width = self._basis.local_table(self._times[:1], self._horizon).values.shape[1]
        return len(self) if len(self) * width <= KEPT else max(1, SLICE // width)

    @cached_property
    def whole(self) -> Table:
        """All of them, however large."""
        return self._table(slice(None))

    def _slices(self) -> Iterator[tuple[slice, Table]]:
        if self._rows >= len(self):
            yield slice(0, len(self)), self.whole
            return
        for first in range(0, len(self), self._rows):
            part = slice(first, min(first + self._rows, len(self)))
            yield part, self._table(part)

    def controls(self, coefficients: Array) -> Array:
        """Λ φ at the times: (rows, size) ↦ (k, rows)."""
        if self._rows >= len(self):
            return self.whole @ coefficients.T
        controls = np.empty((len(self), len(coefficients)))
        for part, table in self._slices():
            controls[part] = table @ coefficients.T
        return controls

    def transposed(self, rows: Array) -> Array:
        """Sums over the times: (k, r) ↦ (size, r)."""
        if self._rows >= len(self):
            return self.whole.transposed(rows)
        return np.asarray(sum(table.transposed(rows[part]) for part, table in self._slices()))

    def dense(self) -> Array:
        """All functions at all times, (k, size): for few of either."""
        return np.vstack([table.dense() for _, table in self._slices()])
