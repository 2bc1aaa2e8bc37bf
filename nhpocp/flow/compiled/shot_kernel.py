"""The compiled intervals of an NLP, as CasADi functions that IPOPT can be given."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.flow.compiled import shot_source, sweep_source
from nhpocp.flow.compiled.kernel_cache import address, agree, identified, nudged
from nhpocp.flow.shot import Shot

ASIDE = 0.01  # of the variables, or of one: how far from the guess a kernel is tried
_ORDER = ("w", "p", "sigma", "multipliers", "cost", "outputs", "gradient", "jacobian", "hessian")


def identity(shot: Shot) -> str:
    """All that the C text depends on."""
    return identified(shot.parts, (shot_source, sweep_source))


class ShotKernel:
    """A loaded kernel. Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, path: Path) -> None:
        library = ctypes.PyDLL(str(path))
        self._run, self._wanted = library.nhpocp_shots, library.nhpocp_shots_work
        self._run.restype, self._wanted.restype = None, ctypes.c_longlong
        self._run.argtypes = [ctypes.c_longlong] * 3 + [ctypes.c_void_p] * 11
        self._wanted.argtypes = [ctypes.c_longlong]
        self._work = np.zeros(0)

    def run(self, places: Array, size: int, intervals: int, addresses: Mapping[str, int | None]) -> None:
        """Fills what is wanted of `_ORDER`; ``size``: outputs; ``places`` as in `Shot`, of 64 bits."""
        steps = len(places) - 1
        if self._work.size < (wanted := self._wanted(steps)):
            self._work = np.zeros(wanted)
        given = [addresses.get(name) for name in _ORDER]
        self._run(intervals, steps, size, places.ctypes.data, *given, address(self._work))


class KernelShots:
    """`Shots` by a kernel."""

    def __init__(self, kernel: ShotKernel, shot: Shot, intervals: int) -> None:
        self._kernel, self._shot, self._intervals = kernel, shot, intervals
        self._places = np.ascontiguousarray(shot.places, dtype=np.int64)

    def _function(self, name: str, given: Sequence[str], wanted: Sequence[str]) -> ca.Function:
        shot, N = self._shot, self._intervals
        rows = {"w": shot.variables, "p": shot.parameters, "multipliers": shot.outputs}
        rows |= {"outputs": shot.outputs, "gradient": shot.variables}
        rows |= {"jacobian": shot.outputs, "hessian": shot.variables}
        shapes = {
            key: (rows.get(key, 1), N * shot.variables if key in ("jacobian", "hessian") else N)
            for key in _ORDER
        }

        def run(addresses: dict[str, int | None]) -> None:
            self._kernel.run(self._places, shot.outputs, N, addresses)

        return _Called(name, {k: shapes[k] for k in given}, {k: shapes[k] for k in wanted}, run)

    @cached_property
    def cost(self) -> ca.Function:
        return self._function("cost", ["w", "p"], ["cost"])

    @cached_property
    def value(self) -> ca.Function:
        return self._function("value", ["w", "p"], ["outputs"])

    @cached_property
    def gradient(self) -> ca.Function:
        return self._function("gradient", ["w", "p"], ["cost", "gradient"])

    @cached_property
    def jacobian(self) -> ca.Function:
        return self._function("jacobian", ["w", "p"], ["outputs", "jacobian"])

    @cached_property
    def hessian(self) -> ca.Function:
        return self._function("hessian", ["w", "p", "sigma", "multipliers"], ["hessian"])

    def note(self, seconds: float) -> None:
        """It is as fast as it gets."""


class _Called(ca.Callback):
    """A CasADi function that hands the addresses of its dense arguments and results on."""

    def __init__(
        self,
        name: str,
        given: dict[str, tuple[int, int]],
        wanted: dict[str, tuple[int, int]],
        run: Callable[[dict[str, int | None]], None],
    ) -> None:
        ca.Callback.__init__(self)
        self._given, self._wanted, self._run = list(given.items()), list(wanted.items()), run
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._given)

    def get_n_out(self) -> int:
        return len(self._wanted)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._given[i][1])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._wanted[i][1])

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Sequence[Any], results: Sequence[Any]) -> int:
        addresses = {}
        for (name, _), memory in zip([*self._given, *self._wanted], [*arguments, *results], strict=True):
            addresses[name] = np.frombuffer(memory).ctypes.data if memory is not None else None
        self._run(addresses)
        return 0


def tried(kernel: ShotKernel, shot: Shot, w: Array, p: Array) -> bool:
    """Whether a kernel says what CasADi says near some intervals (k, ·), in all of them along one random direction.

    An error in one entry of a matrix shows in the product with a vector that no symmetry has chosen, and one that a
    control of zero would hide shows beside it.
    """
    chance, k = np.random.default_rng(0), len(w)
    w = w + ASIDE * (1.0 + np.abs(w)) * chance.normal(size=w.shape)
    sigma, multipliers = chance.normal(size=k), chance.normal(size=(k, shot.outputs))
    direction = np.tile(chance.normal(size=shot.variables), (k, 1))
    weights = sigma, multipliers, direction
    expected = call(mapped(shot.directional, k), w, p, *weights)
    nearby = call(mapped(shot.directional, k), nudged(w), nudged(p), *weights)
    shots = KernelShots(kernel, shot, k)
    cost, gradient = call(shots.gradient, w, p)
    outputs, jacobian = call(shots.jacobian, w, p)
    (hessian,) = call(shots.hessian, w, p, sigma, multipliers)
    along = [
        np.einsum("kji,kj->ki", matrix.reshape(k, shot.variables, -1), direction)
        for matrix in (jacobian, hessian)
    ]
    return agree([cost, outputs, gradient, *along], expected, nearby)
