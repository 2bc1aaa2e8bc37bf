"""Replays of one control or many, and what they drive, as one system of equations: SciPy's steps are paid for once.

The steps are those of the whole, short enough for each: the norm of the error is a mean over all numbers, and with 1/√k
of the tolerance none of k paths may be wrong by more than alone. A path that ends early ends them all; then halves are
tried, down to the path alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import side_by_side
from nhpocp.controls.control import Control
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.verification.fast_function import FastFunction
from nhpocp.verification.replay import REPLAYED, Path, Watch, integrate, replay

MOST = 64  # controls at once
DRIVEN = 1e-5  # as `REPLAYED`, of what a replay drives


class Original(NamedTuple):
    """Equations ẏ = rate(y, x, u) that a replay x(t) drives, from the same start."""

    system: System  # by whose determinants they divide
    rate: ca.Function


class Followed(NamedTuple):
    """Where a control leads, and what that drives; None where nothing is to be driven, or no replay reaches the end."""

    replay: Path
    original: Path | None


class Company:
    """Controls over one basis and one horizon, each from its start."""

    def __init__(
        self,
        numeric: NumericSystem,
        original: Original | None,
        controls: Sequence[Control],
        starts: Sequence[Array],
        scales: Array,
    ) -> None:
        """scales: as for `integrate`."""
        self._numeric, self._original, self._scales = numeric, original, scales
        self._controls, self._starts = controls, starts
        self._systems = [(numeric.system, REPLAYED)]
        if original:
            self._systems.append((original.system, DRIVEN))

    def followed(self) -> list[Followed]:
        """Each of the controls."""
        found: dict[int, Followed] = {}
        count = len(self._controls)
        waiting = [list(range(first, min(first + MOST, count))) for first in range(0, count, MOST)]
        while waiting:
            members = waiting.pop()
            if together := self._together(members):
                found |= zip(members, together, strict=True)
            elif len(members) == 1:
                found[members[0]] = self._alone(members[0])
            else:
                middle = len(members) // 2
                waiting += [members[:middle], members[middle:]]
        return [found[i] for i in range(count)]

    def _together(self, members: list[int]) -> list[Followed] | None:
        """In one integration; None where that would spare nothing, or one of the paths meets something."""
        count, first, each = len(members), self._controls[members[0]], len(self._systems)
        paths = count * each
        if paths == 1:
            return None
        tables = np.vstack([self._controls[i].coefficients for i in members])
        start = np.concatenate([np.tile(self._starts[i], each) for i in members])
        function = self._function()
        rate = FastFunction(side_by_side(function, count))
        path = integrate(
            lambda t, x, u: rate(x, u),
            Control(first.basis, tables, first.horizon),
            start,
            Watches(self._systems, start, count),
            np.tile(self._scales, paths),
            function if count == 1 else None,
            share=1 / np.sqrt(paths),
        )
        if path.stopped is not None:
            return None
        parts = path.parts(paths)
        if each == 1:
            return [Followed(part, None) for part in parts]
        return [Followed(*pair) for pair in zip(parts[::2], parts[1::2], strict=True)]

    def _function(self) -> ca.Function:
        """(x, or x and y; u) ↦ their rates, of one control."""
        if self._original is None:
            return self._numeric.rate_function
        x, y = (ca.SX.sym(name, self._numeric.system.state_space.size) for name in "xy")
        u = ca.SX.sym("u", self._numeric.system.input_space.size)
        rates = ca.vertcat(self._numeric.rate_function(x, u), self._original.rate(y, x, u))
        return ca.Function("both", [ca.vertcat(x, y), u], [ca.densify(rates)])

    def _alone(self, i: int) -> Followed:
        """The replay by itself, then what it drives."""
        control, start = self._controls[i], self._starts[i]
        path = replay(self._numeric, control, start, self._scales)
        if self._original is None or path.stopped is not None:
            return Followed(path, None)
        rate, watch = FastFunction(self._original.rate), Watch(self._original.system, start, DRIVEN)
        driven = integrate(lambda t, y, u: rate(y, path.at(t), u), control, start, watch, self._scales)
        return Followed(path, driven)


class Watches:
    """A `Watch` for each of some systems under many controls, whose states stand one after another.

    What one meets stops all.
    """

    def __init__(self, systems: Sequence[tuple[System, float]], start: Array, many: int) -> None:
        """systems: each with how far its determinants may vanish."""
        self._many, self._watched = many, list[tuple[FastFunction, ...]]()
        self._vanishing = np.array([[vanishing] for _, vanishing in systems])
        sizes = [system.state_space.size for system, _ in systems]
        state = ca.SX.sym("x", sum(sizes))
        for (system, _), x in zip(systems, ca.vertsplit(state, [0, *np.cumsum(sizes)]), strict=True):
            matrices = [ca.densify(system.regularity(x)[name]) for name in system.breaking()]
            functions = [ca.Function("matrix", [state], [ca.vec(matrix)]) for matrix in matrices]
            self._watched.append(tuple(FastFunction(side_by_side(each, many)) for each in functions))
        self._largest = np.zeros((len(systems), many))
        self._signs = np.sign(self.values(start))

    @property
    def looks(self) -> bool:
        """Whether there is anything to see."""
        return any(self._watched)

    def values(self, states: Array) -> Array:
        """Of each system under each control the product of the determinants."""
        products = np.ones((len(self._watched), self._many))
        for product, matrices in zip(products, self._watched, strict=True):
            for matrix in matrices:
                entries = matrix(states).reshape(self._many, -1)
                side = isqrt(entries.shape[1])
                product *= np.linalg.det(entries.reshape(-1, side, side))
        return products

    def look(self, dense: Any, low: float, high: float) -> tuple[float, str | None]:
        """As `Watch.look`, but not where: that is found for the path alone."""
        values = self.values(dense(np.asarray(high)))
        self._largest = np.maximum(self._largest, np.abs(values))
        met = (np.sign(values) != self._signs) | (np.abs(values) < self._vanishing * self._largest)
        return high, "one of them meets a singularity" if met.any() else None
