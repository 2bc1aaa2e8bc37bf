"""Replays of many controls at once: one system of equations, so that each step is paid for once.

The steps are those of the whole, short enough for each: the norm of the error is a mean over all numbers, and with 1/√k
of the tolerance none of k paths may be wrong by more than alone. A path that ends early ends them all; then halves are
tried, down to the path alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isqrt

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import side_by_side
from nhpocp.controls.control import Control
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.verification.dop853 import Steps
from nhpocp.verification.fast_function import FastFunction
from nhpocp.verification.replay import Driver, Path, integrate, replay

MOST = 64  # paths at once

Whole = Callable[[list[int]], Path]
Alone = Callable[[int], Path]


def replays(
    numeric: NumericSystem, controls: Sequence[Control], starts: Sequence[Array], scales: Array
) -> list[Path]:
    """`replay` of each of the controls, which are over one basis and one horizon, from its start."""

    def whole(members: list[int]) -> Path:
        rate = side_by_side(numeric.rate_function, len(members))
        start = np.concatenate([starts[i] for i in members])
        watch = Watches(numeric.system, start, len(members), vanishing=1e-7)
        return _integrated(rate, [controls[i] for i in members], start, watch, scales)

    return _in_company(whole, lambda i: replay(numeric, controls[i], starts[i], scales), len(controls))


def originals(
    system: System,
    function: ca.Function,
    drivers: Sequence[Path],
    controls: Sequence[Control],
    starts: Sequence[Array],
    scales: Array,
    alone: Alone,
) -> list[Path]:
    """Paths of ẋ = function(x, y(t), u), y being the drivers', all of which reach the end. alone: one of them."""

    def whole(members: list[int]) -> Path:
        rate, driver = side_by_side(function, len(members)), beside([drivers[i] for i in members])
        start = np.concatenate([starts[i] for i in members])
        watch = Watches(system, start, len(members), vanishing=1e-5)
        chosen = [controls[i] for i in members]
        return _integrated(rate, chosen, start, watch, scales, driver)

    return _in_company(whole, alone, len(controls))


def beside(paths: Sequence[Path]) -> Driver:
    """t (k,) ↦ the states of all paths, one after another."""
    return Path.beside(paths) or (lambda times: np.hstack([path(times) for path in paths]))


def _integrated(
    rate: ca.Function,
    controls: list[Control],
    start: Array,
    watch: Watches,
    scales: Array,
    driver: Driver | None = None,
) -> Path:
    """Many paths as one."""
    basis, horizon = controls[0].basis, controls[0].horizon
    together = Control(basis, np.vstack([control.coefficients for control in controls]), horizon)
    many = len(controls)
    return integrate(rate, together, start, watch, np.tile(scales, many), driver, 1 / np.sqrt(many))


def _in_company(whole: Whole, alone: Alone, count: int) -> list[Path]:
    paths: dict[int, Path] = {}
    waiting = [list(range(first, min(first + MOST, count))) for first in range(0, count, MOST)]
    while waiting:
        members = waiting.pop()
        if len(members) == 1:
            paths[members[0]] = alone(members[0])
            continue
        path = whole(members)
        if path.stopped is None:
            paths |= zip(members, path.parts(len(members)), strict=True)
        else:
            middle = len(members) // 2
            waiting += [members[:middle], members[middle:]]
    return [paths[i] for i in range(count)]


class Watches:
    """A `Watch` for each of many paths, whose states stand one after another; what one meets stops all."""

    def __init__(self, system: System, start: Array, many: int, vanishing: float) -> None:
        self._vanishing = vanishing
        x = ca.SX.sym("x", system.state_space.size)
        matrices = [ca.densify(system.regularity(x)[name]) for name in system.breaking()]
        functions = [ca.Function("matrix", [x], [ca.vec(matrix)]) for matrix in matrices]
        self._matrices = [FastFunction(side_by_side(function, many)) for function in functions]
        self._many, self._largest = many, np.zeros(many)
        self._signs = np.sign(self.values(start))

    @property
    def looks(self) -> bool:
        """Whether there is anything to see."""
        return bool(self._matrices)

    def values(self, states: Array) -> Array:
        """Of each path the product of the determinants."""
        products = np.ones(self._many)
        for matrix in self._matrices:
            entries = matrix(states).reshape(self._many, -1)
            side = isqrt(entries.shape[1])
            products *= np.linalg.det(entries.reshape(-1, side, side))
        return products

    def look(self, step: Steps, low: float, high: float, end: Array) -> tuple[float, str | None]:
        """As `Watch.look`, but not where: that is found for the path alone."""
        values = self.values(end)
        self._largest = np.maximum(self._largest, np.abs(values))
        met = (np.sign(values) != self._signs) | (np.abs(values) < self._vanishing * self._largest)
        return high, "one of them meets a singularity" if met.any() else None
