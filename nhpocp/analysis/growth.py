r"""The growth of Δ¹ ⊂ Δ² ⊂ …, the spans of the brackets up to a degree, and what it says of controllability.

The fields are those of the inputs, g1 … gm, and of the drift f if there is one. If Δ^k(x) is the whole tangent space,
the Lie algebra rank condition (LARC) holds at x, and the least such k is the degree of non-holonomy. [Bellaïche]
Without drift it makes the system controllable near x, [Chow]; with drift it makes it accessible: what it reaches has
inner points, [Sussmann, Jurdjevic].

Rows are divided by the mechanism's length where they are lengths, inputs count in the same length or in radians over
the horizon, and all fields are divided by the largest singular value of Δ¹, so that ranks depend on no unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import qr

from nhpocp.analysis.brackets import LieAlgebra, TooLargeError, Word, factors
from nhpocp.analysis.minima import golden_section
from nhpocp.analysis.spectrum import Spectrum
from nhpocp.arrays import Array
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

GENERIC = 5  # seeded points around the first one, which say how far the ranks can grow
SINGULAR = 1e-9  # σ_min of a matrix that the equations divide by, at and below which they have no value
SAME_TIME = 1e-7  # shares of a path that are nearer are one
SPREAD = 0.2  # of those points: lengths of the mechanism, and radians


@dataclass(frozen=True)
class Growth:
    """How Δ^k grows at one point: a spectrum a degree, up to the one after which nothing is gained."""

    dimension: int
    spectra: tuple[Spectrum, ...]  # none where the fields are not finite
    strong: int = (
        0  # rank without the drift itself: what can be reached at one given time, if there is a drift
    )
    basis: tuple[str, ...] = ()  # fields that span as far as it goes

    @property
    def vector(self) -> tuple[int, ...]:
        """(dim Δ¹, dim Δ², …)."""
        return tuple(spectrum.rank for spectrum in self.spectra)

    @property
    def rank(self) -> int:
        return self.vector[-1] if self.spectra else 0

    @property
    def full(self) -> bool:
        """Whether the Lie algebra rank condition holds here."""
        return self.rank == self.dimension

    @property
    def degree(self) -> int | None:
        """The degree of non-holonomy, the length of the growth vector; None where the condition does not hold."""
        return len(self.spectra) if self.full else None

    @property
    def weakest(self) -> float | None:
        """The least singular value that counts in the last Δ^k, over its largest."""
        return self.spectra[-1].least_kept if self.spectra else None

    def to_json(self) -> dict[str, Any]:
        return {
            "growth_vector": list(self.vector),
            "degree_of_nonholonomy": self.degree,
            "full_rank": self.full,
            "strong_rank": self.strong,
            "basis": list(self.basis),
            "layers": [spectrum.to_json() for spectrum in self.spectra],
        }


@dataclass(frozen=True)
class Filtration:
    """Growth at points, and how far it can go at all: ``generic`` is the rank at almost every point near them.

    ``limit``: the degree up to which brackets were looked at where more might have come; ``settled``: whether no
    bracket of a higher degree could add anything anywhere.
    """

    points: tuple[Growth, ...]
    generic: Growth
    limit: int
    settled: bool
    drifting: bool
    refused: str | None = None  # brackets that were too large to be made

    @property
    def full(self) -> bool:
        return all(growth.full for growth in self.points)


@dataclass(frozen=True)
class Scales:
    """What makes bracket values dimensionless: a length, and a time for the drift."""

    length: float
    time: float

    def rows(self, system: System) -> Array:
        return 1.0 / self.units(system.state_space.tangent_units)

    def generators(self, system: System) -> Array:
        inputs = self.units(system.input_space.tangent_units)
        return inputs if system.driftless else np.concatenate([[self.time], inputs])

    def units(self, units: Sequence[str]) -> Array:
        """The size of each unit."""
        return np.where(np.array(units) == "length", self.length, 1.0)


class Fields:
    """The dimensionless brackets of one system at points, made as far as they are asked for."""

    def __init__(self, system: System, scales: Scales) -> None:
        self.system, self.scales, self.algebra = system, scales, LieAlgebra(system)

    def at(self, points: Array, degree: int) -> list[Array]:
        """Values (k, dimension, words) at points (k, size), an array for each degree up to ``degree``."""
        rows, generators = self.scales.rows(self.system), self.scales.generators(self.system)
        layers = self.algebra.layers[:degree]
        values = [layer.at(points) * rows[:, None] * factors(layer, generators) for layer in layers]
        values[0] = np.where(self._divisible(points)[:, None, None], values[0], np.nan)
        sizes = _sizes(values[0])[:, None, None]
        return [layer * sizes**k for k, layer in enumerate(values, 1)]

    def _divisible(self, points: Array) -> Array:
        """Whether the matrices that the equations divide by are regular; else rounding makes numbers of anything."""
        good = np.ones(len(points), dtype=bool)
        if names := self.system.breaking():
            margins = numeric_system(self.system).margins(points, self.scales.length)
            for name in names:
                good &= np.nan_to_num(margins[f"sigma_{name}"]) > SINGULAR
        return good

    def margin(self, points: Array, degree: int, rank: int) -> Array:
        """σ_rank/σ_1 of the brackets up to a degree at points (k, size), (k,); NaN where they are not finite."""
        found = np.full(len(points), np.nan)
        values = np.concatenate(self.at(points, degree), axis=2)
        good = np.isfinite(values).all(axis=(1, 2))
        if rank and good.any():
            spectra = np.linalg.svd(values[good], compute_uv=False)
            found[good] = spectra[:, rank - 1] / np.maximum(spectra[:, 0], 1e-300)
        return found


def filtration(fields: Fields, points: Array, tolerance: float, limit: int) -> Filtration:
    """The growth at points (k, size), k ≥ 1, with brackets up to the degree ``limit`` where it takes so many.

    A rank that stays as it is at one point may grow later, if that point is singular; at almost every point it cannot.
    So seeded points near by, the generic ones, tell when to stop.
    """
    algebra, dimension, count = fields.algebra, fields.system.state_space.dimension, len(points)
    everywhere = np.vstack([points, _near(fields.system, points[0], fields.scales)])
    spectra: list[list[Spectrum]] = []
    weak: list[list[int]] = []  # ranks without the drift itself, which may take longer
    settled, refused = False, None
    while True:
        degree = len(spectra) + 1
        values = np.concatenate(fields.at(everywhere, degree), axis=2)
        spectra.append([_spectrum(matrix, tolerance) for matrix in values])
        weak.append([_spectrum(matrix[:, algebra.drifting :], tolerance).rank for matrix in values])
        finite = np.isfinite(values[:count]).all(axis=(1, 2))
        ranks = np.array([[spectrum.rank for spectrum in one] for one in spectra])
        settled = all(_settled(np.array(one), count, finite, dimension) for one in (ranks, weak))
        if settled or degree >= limit:
            break
        try:
            if degree == len(algebra.layers) and not algebra.deepen():
                settled = True
                break
        except TooLargeError as error:
            refused = str(error)
            break
    words = [word for layer in algebra.layers[: len(spectra)] for word in layer.words]
    found = [_growth([one[i] for one in spectra], matrix, words, algebra) for i, matrix in enumerate(values)]
    best = max(found[count:], key=lambda growth: (growth.rank, growth.weakest or 0.0))
    return Filtration(tuple(found[:count]), best, len(spectra), settled, algebra.drifting, refused)


def _settled(ranks: Array, count: int, finite: Array, dimension: int) -> bool:
    """Whether no more can come, by ranks (degrees, points) of which the last points are the generic ones."""
    generic = ranks[:, count:].max(axis=1)
    final = generic[-1] == dimension or (len(generic) > 1 and generic[-1] == generic[-2])
    return bool(final and (ranks[-1, :count][finite] >= generic[-1]).all())


def rank_losses(
    fields: Fields, path: Callable[[Array], Array], times: Array, generic: Growth, tolerance: float
) -> Array:
    """Times between the given ones at which the path meets a state of lower rank than at almost every state.

    Looked for at the degree at which the generic rank is reached: where its least singular value dips, the dip's floor.
    """
    degree, rank = len(generic.spectra), generic.rank

    def margin(at: Array) -> Array:
        return np.nan_to_num(fields.margin(path(at), degree, rank), nan=np.inf)

    if len(times) < 2 or not rank:
        return np.empty(0)
    values = margin(times)
    around = np.concatenate([[np.inf], values, [np.inf]])
    dips = np.flatnonzero((values < around[:-2]) & (values <= around[2:]))
    low, high = times[np.maximum(dips - 1, 0)], times[np.minimum(dips + 1, len(times) - 1)]
    where, least = golden_section(margin, low, high)
    new = np.abs(where[:, None] - times).min(axis=1) > SAME_TIME * np.ptp(times)
    return np.asarray(where[(least <= tolerance) & new])


def _near(system: System, point: Array, scales: Scales) -> Array:
    space, random = system.state_space, np.random.default_rng(0)
    steps = SPREAD * random.standard_normal((GENERIC, space.dimension)) * scales.units(space.tangent_units)
    return np.array([space.retract(point, step) for step in steps])


def _sizes(generators: Array) -> Array:
    """1 over the largest singular value of each point's generators."""
    largest = [_spectrum(matrix, 0.0).largest for matrix in generators]
    return np.array([1.0 / value if value > 0 else 1.0 for value in largest])


def _spectrum(matrix: Array, tolerance: float) -> Spectrum:
    finite = np.isfinite(matrix).all()
    return Spectrum.of(matrix, tolerance) if finite and matrix.size else Spectrum((), tolerance)


def _growth(spectra: list[Spectrum], values: Array, words: list[Word], algebra: LieAlgebra) -> Growth:
    """The growth at one point from its spectra and its brackets (dimension, words)."""
    dimension = len(values)
    if not np.isfinite(values).all():
        return Growth(dimension, ())
    last = spectra[-1].rank
    used = next(k for k, spectrum in enumerate(spectra, 1) if spectrum.rank == last)
    basis = _spanning(values, words, [spectrum.rank for spectrum in spectra[:used]])
    names = tuple(words[place].written(algebra.names) for place in basis)
    strong = _spectrum(values[:, algebra.drifting :], spectra[-1].tolerance).rank
    return Growth(dimension, tuple(spectra[:used]), strong, names)


def _spanning(values: Array, words: list[Word], ranks: Sequence[int]) -> list[int]:
    """Columns that span, of the least degree and as far from each other as there are."""
    kept: list[int] = []
    rest = values
    for degree, rank in enumerate(ranks, 1):
        places = [i for i, word in enumerate(words) if word.degree == degree]
        order = qr(rest[:, places], mode="r", pivoting=True)[1][: rank - len(kept)] if places else []
        kept += sorted(places[i] for i in order)
        directions = np.linalg.qr(values[:, kept])[0]
        rest = values - directions @ (directions.T @ values)
    return kept
