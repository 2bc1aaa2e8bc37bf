"""What the runs of a study found together, as data whose size does not grow with their number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, exp, floor, isfinite, log, log2, log10
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.problem import PlanningProblem

STEPS = 256  # of a performance profile, for every factor of two
FACTORS = 20  # of two: a ratio beyond is as good as a failure
TIE = 1.0005  # ratios below it are no difference


@dataclass(frozen=True)
class Axis:
    """One key of the problem that varies. path: of the key. levels: its values, angles in radians. drawn: rather than
    chosen. degrees: whether its study file writes angles. logarithmic: of constant ratio."""

    path: str
    levels: tuple[Any, ...]
    drawn: bool = False
    degrees: bool = False
    logarithmic: bool = False

    @property
    def numeric(self) -> bool:
        return all(isinstance(level, int | float) and not isinstance(level, bool) for level in self.levels)

    def shown(self, value: Any) -> Any:
        """A level as users read it: angles in degrees."""
        return round(float(np.degrees(value)), 9) + 0.0 if self.degrees else value

    def places(self) -> Array:
        """Where the levels stand on an axis of a picture: numbers at their values, others in a row."""
        shown = [self.shown(level) for level in self.levels] if self.numeric else range(len(self.levels))
        return np.asarray(shown, dtype=float)


@dataclass(frozen=True)
class Quantity:
    """What is measured of a run: name and kind, which is "cost", "error", "evaluations", "seconds" or "margin"."""

    name: str
    kind: str


@dataclass(frozen=True)
class Spread:
    """How a quantity is distributed over the solved runs of a solver: ``count`` of them, and quantiles, evenly spaced
    from the least to the largest."""

    count: int
    quantiles: Array

    def at(self, share: float) -> float | None:
        """A quantile, None where there is no run."""
        return (
            float(np.interp(share, np.linspace(0, 1, len(self.quantiles)), self.quantiles))
            if self.count
            else None
        )


@dataclass(frozen=True)
class Cells:
    """The runs of one solver in the cells of a map: arrays (panels, rows, columns).

    outcome: the place of the commonest failure in `Survey.outcomes`, 0 where none failed, -1 where nothing ran.
    medians: of the solved runs, by quantity, NaN where there is none.
    """

    stored: Array
    solved: Array
    outcome: Array
    medians: Mapping[str, Array]


@dataclass(frozen=True)
class Map:
    """Cells over two chosen axes, or one (``rows`` None), a panel a level of a third.

    beside: axes over which the cells take shares and medians. group: how many levels in a row one column or row holds.
    """

    columns: Axis
    rows: Axis | None
    panels: Axis | None
    beside: tuple[Axis, ...]
    group: tuple[int, int]
    cells: Mapping[str, Cells]

    @property
    def single(self) -> bool:
        """Whether no cell can hold more than one run."""
        return not any(len(axis.levels) > 1 for axis in self.beside) and self.group == (1, 1)


@dataclass(frozen=True)
class Points:
    """Runs one by one, where axes are drawn: of each solver the places (n, axes), outcomes and costs (n,) of at most
    so many, and how many there are in all."""

    axes: tuple[Axis, ...]
    places: Mapping[str, Array]
    outcomes: Mapping[str, Array]
    costs: Mapping[str, Array]
    stored: int


@dataclass(frozen=True)
class Failures:
    """Runs that failed alike.

    broken: the bounds and determinants by which. run: the first that can be had again from the store (``kept``), else
    the first; message: its own. counts: by solver.
    """

    outcome: str
    broken: tuple[str, ...]
    counts: Mapping[str, int]
    run: int
    message: str
    kept: bool

    @property
    def count(self) -> int:
        return sum(self.counts.values())


@dataclass
class Profiles:
    """Performance profiles of solvers by one quantity, and their shifted geometric means.

    Of every design point that all solvers have run, the ratio of each solver's value to the least of those that solved
    it; a failure has none. ρ(τ) is the share of points with a ratio of at most τ [Dolan & Moré 2002].
    shift: of the means, which are over the points that every solver solved.
    """

    solvers: tuple[str, ...]
    shift: float
    points: int = 0
    shared: int = 0
    counts: Array = field(init=False)
    _logarithms: Array = field(init=False)

    def __post_init__(self) -> None:
        self.counts = np.zeros((len(self.solvers), STEPS * FACTORS + 1))
        self._logarithms = np.zeros(len(self.solvers))

    def add(self, values: Sequence[float | None]) -> None:
        """The values of all solvers at one point, None for a failure."""
        self.points += 1
        known = [value for value in values if value is not None and isfinite(value)]
        best = min(known, default=0.0)
        for k, value in enumerate(values):
            if value is None or not isfinite(value):
                continue
            ratio = 1.0 if value <= best * TIE else value / best if best > 0 else 2.0 ** (FACTORS + 1)
            place = 0 if ratio <= TIE else ceil(STEPS * log2(ratio))
            if place < self.counts.shape[1]:
                self.counts[k, place] += 1
        if len(known) == len(values) and best >= 0:
            self.shared += 1
            self._logarithms += [log(value + self.shift) for value in known]

    @property
    def ratios(self) -> Array:
        """τ at which the profiles are known, from 1."""
        return np.asarray(2.0 ** (np.arange(self.counts.shape[1]) / STEPS))

    @property
    def shares(self) -> Array:
        """ρ(τ), solvers × ratios."""
        return np.asarray(np.cumsum(self.counts, axis=1) / max(self.points, 1))

    @property
    def means(self) -> list[float | None]:
        """The shifted geometric mean of each solver."""
        if not self.shared:
            return [None] * len(self.solvers)
        return [exp(total / self.shared) - self.shift for total in self._logarithms]


def shift_of(medians: Iterable[float | None]) -> float:
    """A shift for geometric means, beside which small values count little: the power of ten below the least median."""
    least = min((value for value in medians if value is not None and value > 0), default=1.0)
    return float(10.0 ** floor(log10(least)))


@dataclass(frozen=True)
class Survey:
    """What a study found.

    store: the file. text, problem_text: the study file and the problem file. problem: the one around which the axes
    vary. runs: of the study, stored or not. solvers: labels of its variants. tallies: of each solver how many runs
    are stored and solved. outcomes: the first is success, the commonest failures follow. quantities: those of which
    there is a value. cost: the name of the one that is the cost. spreads: by quantity and solver. environments: of
    every session. seconds: by the clock, of all sessions; processor: of solving and verifying, all runs together.
    batched: whether runs were planned together, and time is a share. unminimised: whether the Jacobian method took
    the first control that reached the goal.
    """

    name: str
    store: str
    text: str
    problem_text: str
    problem: PlanningProblem
    runs: int
    order: str
    axes: tuple[Axis, ...]
    solvers: tuple[str, ...]
    tallies: Mapping[str, tuple[int, int]]
    outcomes: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    cost: str
    spreads: Mapping[str, Mapping[str, Spread]]
    chart: Map | Points | None
    profiles: Mapping[str, Profiles]
    failures: tuple[Failures, ...]
    environments: tuple[Mapping[str, Any], ...]
    seconds: float
    processor: float
    workers: tuple[int, ...]
    batched: bool
    unminimised: bool

    @property
    def stored(self) -> int:
        return sum(stored for stored, _ in self.tallies.values())

    @property
    def solved(self) -> int:
        return sum(solved for _, solved in self.tallies.values())
