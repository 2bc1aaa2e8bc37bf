"""The compiled intervals of an NLP, as CasADi functions that IPOPT can be given."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.flow.compiled.kernel_cache import agree, nudged
from nhpocp.flow.compiled.library import Library
from nhpocp.flow.shot import Shot, Shots

ASIDE = 0.01  # of the variables, or of one: how far from the guess a kernel is tried
_ORDER = ("w", "p", "sigma", "multipliers", "cost", "outputs", "gradient", "jacobian", "hessian")
_FUNCTIONS = {
    "cost": ("w p", "cost"),
    "value": ("w p", "outputs"),
    "gradient": ("w p", "cost gradient"),
    "jacobian": ("w p", "outputs jacobian"),
    "hessian": ("w p sigma multipliers", "hessian"),
}


class ShotKernel:
    """The C text of `shot_source`, loaded."""

    def __init__(self, path: Path) -> None:
        self._library = Library(path, "nhpocp_shots", "iii" + 11 * "p")
        self._wanted = self._library.file.nhpocp_shots_work
        self._wanted.argtypes, self._wanted.restype = [ctypes.c_longlong], ctypes.c_longlong

    def run(self, places: Array, size: int, intervals: int, addresses: Mapping[str, int | None]) -> None:
        """Fills what is wanted of `_ORDER`; ``size``: outputs; ``places`` as in `Shot`, of 64 bits."""
        steps, given = len(places) - 1, [addresses.get(name) for name in _ORDER]
        _work, work_at = self._library.room(self._wanted(steps))
        self._library.call(intervals, steps, size, places.ctypes.data, *given, work_at)


class KernelShots(Shots):
    """By a kernel."""

    def __init__(self, kernel: ShotKernel, shot: Shot, intervals: int) -> None:
        self._kernel, self._shot, self._intervals = kernel, shot, intervals
        self._places = np.ascontiguousarray(shot.places, dtype=np.int64)

    def _function(self, name: str) -> ca.Function:
        shot, N, (given, wanted) = self._shot, self._intervals, _FUNCTIONS[name]
        rows = {"w": shot.variables, "p": shot.parameters, "multipliers": shot.outputs}
        rows |= {"outputs": shot.outputs, "gradient": shot.variables}
        rows |= {"jacobian": shot.outputs, "hessian": shot.variables}
        shapes = {
            key: (rows.get(key, 1), N * shot.variables if key in ("jacobian", "hessian") else N)
            for key in _ORDER
        }

        def run(addresses: dict[str, int | None]) -> None:
            self._kernel.run(self._places, shot.outputs, N, addresses)

        return _Called(
            name,
            {key: shapes[key] for key in given.split()},
            {key: shapes[key] for key in wanted.split()},
            run,
        )

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


def tried(kernel: ShotKernel, shot: Shot, w: Array, p: Array) -> bool | None:
    """Whether a kernel says what CasADi says; None where that cannot be told.

    It is asked near some intervals (k, ·), in all of them along one random direction.

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
