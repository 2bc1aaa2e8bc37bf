r"""The growth of Δ¹ ⊂ Δ² ⊂ …, the spans of the brackets up to a degree, and what it says of controllability.

The fields are those of the inputs, g1 … gm, and of the drift f if there is one. If Δ^k(x) is the whole tangent space,
the Lie algebra rank condition (LARC) holds at x, and the least such k is the degree of non-holonomy. [Bellaïche]
Without drift it makes the system controllable near x, [Chow]; with drift it makes it accessible: what it reaches has
inner points, [Sussmann, Jurdjevic].

Ranks depend on no unit: rows are divided by the mechanism's length where they are lengths, inputs count in the same
length or in radians over the horizon, and then each row and each bracket is divided by its own size over states near by
(`Balance`). A bracket that is small everywhere is one in other units; one that is small at a single state, against
its size around it, is degenerate there. One that is nowhere larger than the rounding of its evaluation is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import qr

from nhpocp.analysis.minima import golden_section
from nhpocp.analysis.spectrum import Spectrum
from nhpocp.arrays import Array
from nhpocp.singular_values import svd
from nhpocp.systems.brackets import LieAlgebra, TooLargeError, Word, factors
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

GENERIC = 5  # seeded points around the first one, which say how far the ranks can grow
SINGULAR = 1e-9  # σ_min of a matrix that the equations divide by, at and below which they have no value
SAME_TIME = 1e-7  # fractions of a path that are nearer are one
SPREAD = 0.2  # of those points: lengths of the mechanism, and radians
JITTER = 2.0**-48  # relative change of a state, some units of rounding
ROUNDING = 2.0**10  # times what the jitter changes: a number that is no larger is rounding
ROUNDS = 20  # of dividing rows and columns by their sizes in turn


@dataclass(frozen=True)
class Growth:
    """How Δ^k grows at one point: a spectrum a degree, up to the one after which nothing is gained."""

    dimension: int
    spectra: tuple[Spectrum, ...]  # none where the fields are not finite
    # rank without the drift itself: what can be reached at one given time, if there is a drift
    strong: int = 0
    basis: tuple[str, ...] = ()  # fields that span as far as it goes

    def __repr__(self) -> str:
        return f"<Growth {self.vector} of {self.dimension} dimensions>"

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

    @property
    def doubtful(self) -> bool:
        """Whether another tolerance would find another rank at some degree."""
        return any(spectrum.doubtful and spectrum.largest_dropped is not None for spectrum in self.spectra)

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

    def __repr__(self) -> str:
        return f"<Filtration at {len(self.points)} states, generic {self.generic.vector}>"

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

    def at(self, points: Array, degree: int) -> Array:
        """Values (k, dimension, words) of the brackets up to a degree at points (k, size), balanced about each."""
        near = self._near(points)  # (k, GENERIC, size)
        signs = np.where(np.arange(near.shape[2]) % 2, 1.0, -1.0)
        everywhere = [
            points,
            near.reshape(-1, near.shape[2]),
            (near * (1.0 + JITTER * signs)).reshape(-1, near.shape[2]),
        ]
        values = self._raw(np.concatenate(everywhere), degree)
        here, beside, moved = np.split(values, [len(points), len(points) * (1 + GENERIC)])
        shape = len(points), GENERIC, *values.shape[1:]
        rows, columns = balance(beside.reshape(shape), moved.reshape(shape))
        return here * rows[:, :, None] * columns[:, None, :]

    def _raw(self, points: Array, degree: int) -> Array:
        """Values in units of the scales, (k, dimension, words)."""
        rows, generators = self.scales.rows(self.system), self.scales.generators(self.system)
        layers = self.algebra.layers[:degree]
        values = [layer.at(points) * rows[:, None] * factors(layer, generators) for layer in layers]
        values[0] = np.where(self._divisible(points)[:, None, None], values[0], np.nan)
        return np.concatenate(values, axis=2)

    def _near(self, points: Array) -> Array:
        """Seeded states around each point, the same for all, (k, GENERIC, size)."""
        steps = offsets(self.system, self.scales)
        retract = self.system.state_space.retract
        return np.array([[retract(point, step) for step in steps] for point in points])

    def _divisible(self, points: Array) -> Array:
        """Whether the matrices that the equations divide by are regular; else rounding makes numbers of anything."""
        good = np.ones(len(points), dtype=bool)
        if names := self.system.breaking():
            sigmas = numeric_system(self.system).sigmas(points, self.scales.length)
            for name in names:
                good &= np.nan_to_num(sigmas[name]) > SINGULAR
        return good

    def margin(self, points: Array, degree: int, rank: int) -> Array:
        """σ_rank/σ_1 of the brackets up to a degree at points (k, size), (k,); NaN where they are not finite."""
        margins = np.full(len(points), np.nan)
        if not rank:  # no brackets were finite
            return margins
        values = self.at(points, degree)
        good = np.isfinite(values).all(axis=(1, 2))
        if good.any():
            spectra = svd(values[good], compute_uv=False)
            margins[good] = spectra[:, rank - 1] / np.maximum(spectra[:, 0], 1e-300)
        return margins


def filtration(fields: Fields, points: Array, tolerance: float, limit: int) -> Filtration:
    """The growth at points (k, size), k ≥ 1, with brackets up to the degree ``limit`` where it takes so many.

    A rank that stays as it is at one point may grow later, if that point is singular; at almost every point it cannot.
    So seeded points near by, the generic ones, tell when to stop.
    """
    algebra, dimension, count = fields.algebra, fields.system.state_space.dimension, len(points)
    retract = fields.system.state_space.retract
    generic = [retract(points[0], step) for step in offsets(fields.system, fields.scales)]
    everywhere = np.vstack([points, generic])
    spectra: list[list[Spectrum]] = []
    weak: list[list[int]] = []  # ranks without the drift itself, which may take longer
    settled, refused = False, None
    while True:
        degree = len(spectra) + 1
        values = fields.at(everywhere, degree)
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
    growths = [
        _growth([one[i] for one in spectra], matrix, words, algebra) for i, matrix in enumerate(values)
    ]
    best = max(growths[count:], key=lambda growth: (growth.rank, growth.weakest or 0.0))
    return Filtration(tuple(growths[:count]), best, len(spectra), settled, algebra.drifting, refused)


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


def offsets(system: System, scales: Scales) -> Array:
    """Seeded tangent vectors, (GENERIC, dimension), to states near by at which nothing is special."""
    space, random = system.state_space, np.random.default_rng(0)
    return SPREAD * random.standard_normal((GENERIC, space.dimension)) * scales.units(space.tangent_units)


def balance(values: Array, moved: Array) -> tuple[Array, Array]:
    """Factors of rows (k, dimension) and columns (k, words) that make the geometric mean in each 1, zeros left out.

    They undo whatever units rows and columns are in, for the logarithms' least squares are the same in all.

    values, moved: brackets at states around k points, (k, states, dimension, words), and after a jitter of those
    states. What the jitter changes by its own size is rounding: a column of such numbers gets the factor 0.
    """
    with np.errstate(invalid="ignore"):
        noise = ROUNDING * np.nan_to_num(np.abs(moved - values)).max(axis=1)
    sizes = np.nan_to_num(np.abs(values), posinf=0.0).max(axis=1)
    sizes = np.where(sizes > noise, sizes, 0.0)
    there = sizes > 0
    logs = np.log(np.where(there, sizes, 1.0))
    in_row, in_column = (np.maximum(there.sum(axis=axis), 1) for axis in (2, 1))
    rows, columns = np.zeros(sizes.shape[:2]), np.zeros((len(sizes), sizes.shape[2]))
    for _ in range(ROUNDS):
        columns = -np.where(there, logs + rows[:, :, None], 0.0).sum(axis=1) / in_column
        rows = -np.where(there, logs + columns[:, None, :], 0.0).sum(axis=2) / in_row
    return np.exp(rows), np.where(there.any(axis=1), np.exp(columns), 0.0)


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
