"""Basis functions at many times, and their Gram matrix, at a cost that is linear in the number of functions.

Of the functions of a fine grid few are not zero at one time, and few overlap: neither is stored as a full matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nhpocp.arrays import Array


@dataclass(frozen=True, eq=False)
class Table:
    """Row i holds φ_first[i], φ_first[i]+1, … at time i; the other functions, of ``size``, are zero there."""

    values: Array  # (k, width)
    size: int
    first: Array | None = None  # (k,); None: 0 throughout, and width = size

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def _sparse(self) -> Any:
        from scipy.sparse import csr_array

        k, width = self.values.shape
        columns = np.asarray(self.first)[:, None] + np.arange(width)
        ends = width * np.arange(k + 1)
        return csr_array((self.values.ravel(), columns.ravel(), ends), shape=(k, self.size))

    def __matmul__(self, columns: Array) -> Array:
        """Sums over the functions: (size, r) ↦ (k, r)."""
        if self.first is None:
            return np.asarray(self.values @ columns)
        if len(self) == 1:  # an integrator asks for one time after another
            first = int(self.first[0])
            return np.asarray(self.values @ columns[first : first + self.values.shape[1]])
        return np.asarray(self._sparse @ columns)

    def transposed(self, rows: Array) -> Array:
        """Sums over the times: (k, r) ↦ (size, r)."""
        if self.first is None:
            return np.asarray(self.values.T @ rows)
        return np.asarray(self._sparse.T @ rows)

    def dense(self) -> Array:
        """The whole matrix, (k, size)."""
        if self.first is None:
            return self.values
        return np.asarray(self._sparse.toarray())


@dataclass(frozen=True, eq=False)
class Gram:
    """∫ φ φᵀ dt as its bands: row d of ``bands``, (1 + overlaps, size), has ∫ φ_i φ_i+d at i.

    NumPy takes it for the full matrix where that is wanted.
    """

    bands: Array

    @classmethod
    def of(cls, matrix: Any) -> Gram:
        """Of a full matrix, or of what is a `Gram` already."""
        if isinstance(matrix, Gram):
            return matrix
        matrix = np.asarray(matrix, dtype=float)
        bands = np.zeros_like(matrix)
        for d in range(len(matrix)):
            bands[d, : len(matrix) - d] = np.diagonal(matrix, -d)
        return cls(bands)

    @property
    def size(self) -> int:
        return self.bands.shape[1]

    def __matmul__(self, columns: Array) -> Array:
        """(size, r) ↦ (size, r)."""
        columns = np.asarray(columns)
        product = self.bands[0][:, None] * columns
        for d, band in enumerate(self.bands[1:], 1):
            product[d:] += band[:-d, None] * columns[:-d]
            product[:-d] += band[:-d, None] * columns[d:]
        return product

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        size = self.size
        full = np.diag(self.bands[0])
        for d, band in enumerate(self.bands[1:size], 1):
            places = np.arange(size - d)
            full[places + d, places] = full[places, places + d] = band[: size - d]
        return full if dtype is None else full.astype(dtype)

    @cached_property
    def root(self) -> Array:
        """The bands of L, lower triangular, with L Lᵀ = this."""
        if len(self.bands) == 1:
            return np.sqrt(self.bands)
        from scipy.linalg import cholesky_banded

        return np.asarray(cholesky_banded(self.bands, lower=True))

    def solve_root(self, columns: Array) -> Array:
        """X (size, r) with L X = columns."""
        if len(self.bands) == 1:
            return np.asarray(columns / self.root[0][:, None])
        from scipy.linalg import solve_banded

        return np.asarray(solve_banded((len(self.bands) - 1, 0), self.root, columns))

    def solve_root_transposed(self, columns: Array) -> Array:
        """X (size, r) with Lᵀ X = columns."""
        if len(self.bands) == 1:
            return np.asarray(columns / self.root[0][:, None])
        from scipy.linalg import solve_banded

        over = len(self.bands) - 1
        upper = np.array([np.roll(band, d) for d, band in enumerate(self.root)])[::-1]
        return np.asarray(solve_banded((0, over), upper, columns))

    def root_transposed(self, columns: Array) -> Array:
        """Lᵀ times columns (size, r)."""
        product = self.root[0][:, None] * columns
        for d, band in enumerate(self.root[1:], 1):
            product[:-d] += band[:-d, None] * columns[d:]
        return np.asarray(product)

    def solve(self, columns: Array) -> Array:
        """X (size, r) with this times X = columns."""
        if len(self.bands) == 1:
            return np.asarray(columns / self.bands[0][:, None])
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.root, True), columns))
