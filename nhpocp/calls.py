"""CasADi functions called with NumPy arrays, nothing copied entry by entry in between."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from threading import get_ident
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """All outputs of a function with dense arguments and results.

    CasADi stores matrices by columns: an n × k argument is passed, and an n × k result handed back, as a (k, n) array,
    so that samples come first. A scalar or a vector may be passed as it is. Errors: `ValueError` for a wrong size.
    """
    return _caller(function, get_ident())(arguments)


@lru_cache(maxsize=512)  # asking CasADi for a buffer and for sizes costs more than a small function does
def _caller(function: ca.Function, thread: int) -> _Caller:
    return _Caller(function)


class _Caller:
    """One thread's buffer of a function, and the sizes of what goes in and out."""

    def __init__(self, function: ca.Function) -> None:
        buffer: Any
        buffer, self._evaluate = function.buffer()
        self._buffer, self._function = buffer, function
        self._sizes = [function.nnz_in(place) for place in range(function.n_in())]
        self._shapes = [
            (function.size2_out(place), function.size1_out(place)) for place in range(function.n_out())
        ]
        for place, (columns, rows) in enumerate(self._shapes):
            if function.nnz_out(place) != columns * rows:
                raise ValueError(f"{function.name_out(place)} of {function.name()} is sparse")

    def __call__(self, arguments: Sequence[Array]) -> tuple[Array, ...]:
        kept = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        for place, (array, size) in enumerate(zip(kept, self._sizes, strict=True)):
            if array.size != size:
                name = self._function.name_in(place)
                raise ValueError(f"{array.size} numbers for {name}, {size} expected")
            self._buffer.set_arg(place, array.data)
        results = tuple([np.empty(shape) for shape in self._shapes])
        for place, result in enumerate(results):
            self._buffer.set_res(place, result.data)
        self._evaluate()
        return results


@lru_cache(maxsize=128)  # making a map costs more than calling it
def mapped(function: ca.Function, samples: int) -> ca.Function:
    """The function on many samples at once."""
    return function.map(samples)


@lru_cache(maxsize=128)
def accumulated(function: ca.Function, steps: int) -> ca.Function:
    """The function applied over and over, its first argument fed back; every state is handed out."""
    return function.mapaccum(steps)
