"""The singular value decomposition of matrices of any size of numbers."""

from __future__ import annotations

from typing import Any

from nhpocp.arrays import Array

PLAIN = (
    1e-100,
    1e100,
)  # of the largest entry: LAPACK may search for ever above 1e150, and on what is not finite


def svd(matrices: Array, **asked: Any) -> Any:
    """`numpy.linalg.svd` of a matrix (r, n) or a stack (…, r, n), which ends whatever their entries are.

    Errors: `numpy.linalg.LinAlgError` where an entry is not finite.
    """
    import numpy as np  # declaring a system needs no numpy

    matrices = np.asarray(matrices, dtype=float)
    largest = np.abs(matrices).max(initial=0.0)
    if not np.isfinite(largest):
        raise np.linalg.LinAlgError("an entry is not finite")
    if largest == 0.0 or PLAIN[0] < largest < PLAIN[1]:
        return np.linalg.svd(matrices, **asked)
    power = int(np.frexp(largest)[1])  # of two: nothing is rounded
    decomposed = np.linalg.svd(np.ldexp(matrices, -power), **asked)
    if not asked.get("compute_uv", True):
        return np.ldexp(decomposed, power)
    left, values, right = decomposed
    return left, np.ldexp(values, power), right
