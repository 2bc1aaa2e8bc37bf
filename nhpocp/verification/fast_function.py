"""CasADi's functions called one point at a time, as step-by-step integrators do."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array


class FastFunction:
    """A CasADi Function of vectors with one dense result, called without the wrapper's conversions."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function  # the buffer refers to it
        buffer: Any
        buffer, self._run = function.buffer()
        self._buffer = buffer  # CasADi's type stubs miss the memoryview overloads
        self._arguments = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self._result = np.zeros(function.numel_out(0))
        for i, argument in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self, *arguments: Array) -> Array:
        for slot, argument in zip(self._arguments, arguments, strict=True):
            slot[:] = argument
        self._run()
        return self._result.copy()
