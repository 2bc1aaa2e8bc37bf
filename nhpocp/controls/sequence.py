"""Controls in sequence: one basis after another, each on its own part of the horizon."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp.arrays import Array, namespace
from nhpocp.controls.basis import ControlBasis, Side
from nhpocp.controls.control import Control
from nhpocp.controls.registry import BASES
from nhpocp.controls.table import Gram, Table
from nhpocp.errors import InvalidProblemError

ROUNDING = 1e-10  # of the horizon: what is nearer to a knot is on it; the middle of the shortest step is not


@dataclass(frozen=True)
class SequenceBasis(ControlBasis):
    """The functions of ``bases`` one after another, those of piece i being zero outside its fraction of [0, T].

    bases: one a piece. shares: of the horizon, as many, adding up to 1.
    Errors: `InvalidProblemError` where these are not as many.
    """

    bases: tuple[ControlBasis, ...]
    shares: tuple[float, ...]  # of the horizon, adding up to 1
    kind: ClassVar[str] = "sequence"

    def __post_init__(self) -> None:
        if not self.bases or len(self.bases) != len(self.shares):
            words = f"{len(self.bases)} bases and {len(self.shares)} shares; expected as many, at least one"
            raise InvalidProblemError(words, path="SequenceBasis")

    @cached_property
    def size(self) -> int:
        return sum(basis.size for basis in self.bases)

    @property
    def labels(self) -> list[str]:
        return [f"piece{i}.{label}" for i, basis in enumerate(self.bases, 1) for label in basis.labels]

    def knots(self, horizon: float) -> Array:
        """Where the pieces begin and end, pieces + 1 times."""
        return horizon * self._ends

    @cached_property
    def _ends(self) -> Array:
        return np.array([0.0, *accumulate(self.shares[:-1]), 1.0])

    def values(self, time: Array, horizon: float) -> Array:
        xp, knots = namespace(time), self.knots(horizon)
        parts = []
        for i, basis in enumerate(self.bases):
            after = xp.where(time >= knots[i], 1.0, 0.0) if i else 1.0
            before = xp.where(time < knots[i + 1], 1.0, 0.0) if i + 1 < len(self.bases) else 1.0
            parts.append(after * before * basis.values(time - knots[i], knots[i + 1] - knots[i]))
        return xp.concatenate(parts)

    def table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return self._by_piece(lambda basis, t, duration: basis.table(t, duration, side), times, horizon, side)

    def local_table(self, times: Array, horizon: float, side: Side = "right") -> Table:
        times, place, knots = self._placed(times, horizon, side)
        width = self._width
        values, columns = np.zeros((len(times), width)), np.zeros(len(times), dtype=int)
        for i in np.unique(place) if len(place) > 1 else place:
            mine = place == i
            table = self.bases[i].local_table(times[mine] - knots[i], knots[i + 1] - knots[i], side)
            own = self._firsts[i] + (0 if table.first is None else table.first)
            columns[mine] = np.minimum(own, self.size - width)
            shifted = (own - columns[mine])[:, None] + np.arange(table.values.shape[1])
            values[np.flatnonzero(mine)[:, None], shifted] = table.values
        return Table(values, self.size, columns)

    @cached_property
    def _width(self) -> int:
        """The most functions that are not zero at one time."""
        return max(basis.local_table(np.zeros(1), 1.0).values.shape[1] for basis in self.bases)

    @cached_property
    def _firsts(self) -> list[int]:
        """The place of each piece's first function."""
        return list(accumulate((basis.size for basis in self.bases[:-1]), initial=0))

    def _placed(self, times: Array, horizon: float, side: Side) -> tuple[Array, Array, Array]:
        """Times, those next to a knot put on it, the piece that is on at each, and the knots."""
        times, knots = np.asarray(times, dtype=float), self.knots(horizon)
        nearest = knots[np.abs(times[:, None] - knots).argmin(axis=1)]
        times = np.where(np.abs(times - nearest) < ROUNDING * horizon, nearest, times)
        place = np.searchsorted(knots, times, side="right" if side == "right" else "left") - 1
        return times, np.maximum(np.minimum(place, len(self.bases) - 1), 0), knots

    def piece(self, first: float, last: float, horizon: float) -> tuple[ControlBasis, slice, float, float]:
        knots = self.knots(horizon)
        i = int(np.searchsorted(knots[1:-1], 0.5 * (first + last)))
        columns = slice(self._firsts[i], self._firsts[i] + self.bases[i].size)
        return self.bases[i], columns, float(knots[i]), float(knots[i + 1] - knots[i])

    def derivative_table(self, times: Array, horizon: float, side: Side = "right") -> Array:
        return self._by_piece(
            lambda basis, t, duration: basis.derivative_table(t, duration, side), times, horizon, side
        )

    def _by_piece(
        self, part: Callable[[ControlBasis, Array, float], Array], times: Array, horizon: float, side: Side
    ) -> Array:
        """A table whose rows the piece fills that is on at the time; the other pieces' functions are 0 there."""
        times, place, knots = self._placed(times, horizon, side)
        table = np.zeros((len(times), self.size))
        for i, (basis, first) in enumerate(zip(self.bases, self._firsts, strict=True)):
            mine = place == i
            columns = slice(first, first + basis.size)
            table[mine, columns] = part(basis, times[mine] - knots[i], knots[i + 1] - knots[i])
        return table

    def gram(self, horizon: float) -> Gram:
        parts = zip(self.bases, self.shares, strict=True)
        grams = [Gram.of(basis.gram(fraction * horizon)).bands for basis, fraction in parts]
        most = max(len(bands) for bands in grams)
        return Gram(np.hstack([np.pad(bands, ((0, most - len(bands)), (0, 0))) for bands in grams]))

    @property
    def oscillations(self) -> float:
        return max(
            basis.oscillations / fraction for basis, fraction in zip(self.bases, self.shares, strict=True)
        )

    def breakpoints(self, horizon: float) -> Array:
        knots = self.knots(horizon)
        inner = [knots[i] + basis.breakpoints(knots[i + 1] - knots[i]) for i, basis in enumerate(self.bases)]
        return np.sort(np.concatenate([knots[1:-1], *inner]))

    def parameters(self) -> dict[str, Any]:
        return {"bases": self.bases, "shares": self.shares}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> tuple[Self, Array]:
        pieces = []
        for piece in data["pieces"]:
            basis, coefficients = BASES[piece["basis"]].from_json(piece)
            pieces.append(Control(basis, coefficients, piece["horizon"]))
        joined = join(pieces)
        basis = joined.basis
        return cls(basis.bases, basis.shares), joined.coefficients  # type: ignore[attr-defined]

    def to_json(self, coefficients: Array, horizon: float) -> dict[str, Any]:
        pieces, first, coefficients = [], 0, np.asarray(coefficients)
        for basis, fraction in zip(self.bases, self.shares, strict=True):
            pieces.append(basis.to_json(coefficients[:, first : first + basis.size], fraction * horizon))
            first += basis.size
        return {"basis": self.kind, "horizon": horizon, "pieces": pieces}


def join(pieces: Sequence[Control]) -> Control:
    """One control that does these, one after another; its horizon is the sum of theirs."""
    horizon = sum(piece.horizon for piece in pieces)
    basis = SequenceBasis(
        tuple(piece.basis for piece in pieces), tuple(piece.horizon / horizon for piece in pieces)
    )
    return Control(basis, np.hstack([piece.coefficients for piece in pieces]), horizon)


def retimed(control: Control, horizon: float) -> Control:
    """The control that makes the motion of a driftless system in another time: u(t T/T') T/T' over [0, T']."""
    return Control(control.basis, control.horizon / horizon * np.asarray(control.coefficients), horizon)
