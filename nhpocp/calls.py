"""CasADi functions called with NumPy arrays, nothing copied entry by entry in between."""

from __future__ import annotations

from collections.abc import Sequence
from threading import get_ident
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.kept import kept

AT_ONCE = 64  # samples, in one call of `of_many`
PAID = 6000  # samples: one by one they take as long as making a function that does them side by side


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """All outputs of a function with dense arguments and results.

    CasADi stores matrices by columns: an n × k argument is passed, and an n × k result handed back, as a (k, n) array,
    so that samples come first. A scalar or a vector may be passed as it is. Errors: `ValueError` for a wrong size.
    """
    return tuple([result.copy() for result in lent(function, *arguments)])


def lent(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """What `call` gives, not copied: this thread's next call of the function writes over it."""
    return _caller(function, get_ident())(arguments)


@kept(most=128)  # asking CasADi for a buffer and for sizes costs more than a small function does
def _caller(function: ca.Function, thread: int) -> _Caller:
    return _Caller(function)


class _Caller:
    """One thread's buffer of a function, and the arrays that it reads and writes."""

    def __init__(self, function: ca.Function) -> None:
        # holds no function: it lies with it
        buffer: Any
        buffer, self._evaluate = function.buffer()
        self._buffer, self._names = buffer, function.name_in()
        self._arguments: list[Array] = [np.zeros(function.nnz_in(place)) for place in range(function.n_in())]
        self._results: tuple[Array, ...] = tuple(
            np.zeros((function.size2_out(place), function.size1_out(place)))
            for place in range(function.n_out())
        )
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
                raise ValueError(f"{numbers.size} numbers for {self._names[place]}, {array.size} expected")
            array.reshape(numbers.shape)[...] = numbers
        self._evaluate()
        return self._results


def of_many(function: ca.Function, *arguments: Array) -> Array:
    """The first result (k, …) of samples (k, …), for however many: few sizes of maps are made."""
    results = []
    for first in range(0, len(arguments[0]), AT_ONCE):
        parts = [rows[first : first + AT_ONCE] for rows in arguments]
        size = len(parts[0])
        lanes = np.arange(1 << (size - 1).bit_length())
        padded = (rows.take(lanes, axis=0, mode="clip") for rows in parts)
        results.append(call(side_by_side(function, len(lanes)), *padded)[0][:size])
    return np.concatenate(results)


@kept(most=128)  # making a map costs more than calling it
def mapped(function: ca.Function, samples: int) -> ca.Function:
    """The function on many samples at once."""
    return function.map(samples)


def side_by_side(function: ca.Function, samples: int) -> ca.Function:
    """What `mapped` gives, for a function of SX symbols, but with each of its operations done for all samples at once.

    Looking up what to do takes CasADi longer than doing it, and is so done once: four to six times as fast for 400
    samples. As making such a function is dear, `mapped` is handed out until that has cost as much.
    """
    use = _use(function, samples)
    paid = use.samples >= PAID
    use.samples += samples
    return _side_by_side(function, samples) if paid else mapped(function, samples)


class _Use:
    """What a function has been asked for on so many samples at once."""

    samples = 0


@kept(most=128)
def _use(function: ca.Function, samples: int) -> _Use:
    return _Use()


@kept(most=64)
def _side_by_side(function: ca.Function, samples: int) -> ca.Function:
    arguments = [
        ca.MX.sym(name, function.size1_in(place), function.size2_in(place) * samples)
        for place, name in enumerate(function.name_in())
    ]
    numbers = [ca.horzsplit(ca.reshape(argument, -1, samples).T) for argument in arguments]
    work: dict[int, ca.MX] = {}
    results: list[list[Any]] = [[None] * function.nnz_out(place) for place in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, reads = function.instruction_id(k), function.instruction_input(k)
        writes = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[writes[0]] = numbers[reads[0]][reads[1]]
        elif operation == ca.OP_CONST:
            work[writes[0]] = ca.MX(function.instruction_constant(k))
        elif operation == ca.OP_OUTPUT:
            value = work[reads[0]]
            results[writes[0]][writes[1]] = ca.repmat(value, samples, 1) if value.is_scalar() else value
        elif len(reads) == 1:
            work[writes[0]] = ca.MX.unary(operation, work[reads[0]])
        else:
            work[writes[0]] = ca.MX.binary(operation, work[reads[0]], work[reads[1]])
    outputs = [
        ca.reshape(
            ca.horzcat(ca.MX(samples, 0), *columns).T,
            function.size1_out(place),
            function.size2_out(place) * samples,
        )
        for place, columns in enumerate(results)
    ]
    return ca.Function(f"{function.name()}_side_by_side", arguments, outputs)


@kept(most=128)
def accumulated(function: ca.Function, steps: int) -> ca.Function:
    """The function applied over and over, its first argument fed back; every state is handed out."""
    return function.mapaccum(steps)
