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


@lru_cache(maxsize=64)  # asking CasADi for a buffer and for sizes costs more than a small function does
def _caller(function: ca.Function, thread: int) -> _Caller:
    return _Caller(function)


class _Caller:
    """One thread's buffer of a function, and the arrays that it reads and writes."""

    def __init__(self, function: ca.Function) -> None:
        buffer: Any
        buffer, self._evaluate = function.buffer()
        self._buffer, self._function = buffer, function
        self._arguments: list[Array] = [np.zeros(function.nnz_in(place)) for place in range(function.n_in())]
        self._results: list[Array] = [
            np.zeros((function.size2_out(place), function.size1_out(place)))
            for place in range(function.n_out())
        ]
        for place, array in enumerate(self._arguments):
            buffer.set_arg(place, array.data)
        for place, array in enumerate(self._results):
            if function.nnz_out(place) != array.size:
                raise ValueError(f"{function.name_out(place)} of {function.name()} is sparse")
            buffer.set_res(place, array.data)

    def __call__(self, arguments: Sequence[Array]) -> tuple[Array, ...]:
        for place, (given, array) in enumerate(zip(arguments, self._arguments, strict=True)):
            numbers = np.asarray(given)
            if numbers.size != array.size:
                name = self._function.name_in(place)
                raise ValueError(f"{numbers.size} numbers for {name}, {array.size} expected")
            array.reshape(numbers.shape)[...] = numbers
        self._evaluate()
        return tuple([result.copy() for result in self._results])


@lru_cache(maxsize=128)  # making a map costs more than calling it
def mapped(function: ca.Function, samples: int) -> ca.Function:
    """The function on many samples at once."""
    return function.map(samples)


@lru_cache(maxsize=128)
def accumulated(function: ca.Function, steps: int) -> ca.Function:
    """The function applied over and over, its first argument fed back; every state is handed out."""
    return function.mapaccum(steps)
