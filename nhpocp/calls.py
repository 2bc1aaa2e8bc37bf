"""CasADi functions called with NumPy arrays, nothing copied entry by entry in between."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """All outputs of a function with dense arguments and results.

    CasADi stores matrices by columns: an n × k argument is passed, and an n × k result handed back, as a (k, n) array,
    so that samples come first. A scalar or a vector may be passed as it is. Errors: `ValueError` for a wrong size.
    """
    buffer: Any
    buffer, evaluate = function.buffer()
    kept = []
    for place, argument in enumerate(arguments):
        array = np.ascontiguousarray(argument, dtype=float)
        if array.size != function.nnz_in(place):
            raise ValueError(
                f"{array.size} numbers for {function.name_in(place)}, {function.nnz_in(place)} expected"
            )
        kept.append(array)
        buffer.set_arg(place, array.data)
    results = []
    for place in range(function.n_out()):
        shape = function.size2_out(place), function.size1_out(place)
        if function.nnz_out(place) != shape[0] * shape[1]:
            raise ValueError(f"{function.name_out(place)} of {function.name()} is sparse")
        results.append(np.empty(shape))
        buffer.set_res(place, results[-1].data)
    evaluate()
    return tuple(results)


@lru_cache(maxsize=128)  # making a map costs more than calling it
def mapped(function: ca.Function, samples: int) -> ca.Function:
    """The function on many samples at once."""
    return function.map(samples)


@lru_cache(maxsize=128)
def accumulated(function: ca.Function, steps: int) -> ca.Function:
    """The function applied over and over, its first argument fed back; every state is handed out."""
    return function.mapaccum(steps)
