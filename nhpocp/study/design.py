"""Design points: which values the axes of a study have together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, log, log2, prod
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.study.schema import SpreadData, StudyData
from nhpocp.written_numbers import parse_number

END = "goal."  # keys below it can be changed without a new problem


@dataclass(frozen=True)
class Factor:
    """Axes whose values change together: at each of its levels, one value an axis. drawn: rather than chosen."""

    paths: tuple[str, ...]
    levels: tuple[tuple[Any, ...], ...]
    drawn: bool = False

    @property
    def size(self) -> int:
        """How many levels there are."""
        return len(self.levels)

    @property
    def of_goal(self) -> bool:
        """Whether only the goal changes with it."""
        return all(path.startswith(END) for path in self.paths)


@dataclass(frozen=True)
class Trials(Factor):
    """The outermost factor of a design that is optimised: a level a trial, known once it is proposed.

    most: how many trials there will be, so that points have their numbers before.
    """

    most: int = 0

    @property
    def size(self) -> int:
        return self.most

    @property
    def of_goal(self) -> bool:
        """No: goals are innermost, trials outermost."""
        return False


@dataclass(frozen=True)
class Design:
    """All combinations of the levels of its factors, those of the goal innermost; the last changes fastest.

    Points are made when they are asked for: memory grows with the levels, not with the points.
    """

    factors: tuple[Factor, ...]

    def __len__(self) -> int:
        return prod(factor.size for factor in self.factors)

    @property
    def goals(self) -> int:
        """How many points in a row differ in their goals alone."""
        return prod(factor.size for factor in self.factors if factor.of_goal)

    @property
    def trials(self) -> Trials | None:
        """What an optimiser proposes."""
        outermost = self.factors[0] if self.factors else None
        return outermost if isinstance(outermost, Trials) else None

    def proposed(self, levels: Sequence[tuple[Any, ...]]) -> Design:
        """With the trials that are known by now."""
        trials, *others = self.factors
        return replace(self, factors=(replace(trials, levels=tuple(levels)), *others))

    def point(self, index: int) -> dict[str, Any]:
        """The values of one point by the paths of the axes."""
        values: dict[str, Any] = {}
        for factor, level in zip(self.factors, self.places(index), strict=True):
            values |= zip(factor.paths, factor.levels[level], strict=True)
        return values

    def places(self, index: int) -> list[int]:
        """Which level of each factor a point has."""
        places = []
        for factor in reversed(self.factors):
            index, level = divmod(index, factor.size)
            places.append(level)
        return places[::-1]


def design_of(data: StudyData) -> Design:
    """The design of a study file. Drawn axes of one sampling, number and seed are one factor, drawn together."""
    factors: list[Factor] = []
    together: dict[tuple[str, int, int], dict[str, SpreadData]] = {}
    for path, axis in data.axes.items():
        if isinstance(axis, list):
            factors.append(Factor((path,), tuple((plain(level),) for level in axis)))
        elif axis.uniform is None and axis.loguniform is None:
            factors.append(Factor((path,), tuple((value,) for value in _spread(axis))))
        else:
            sampling, seed = axis.sampling or data.sampling, data.seed if axis.seed is None else axis.seed
            count = axis.samples or data.samples
            if sampling == "grid":
                shares = [k / (count - 1) if count > 1 else 0.5 for k in range(count)]
                factors.append(Factor((path,), tuple((_between(axis, share),) for share in shares)))
            else:
                together.setdefault((sampling, count, seed), {})[path] = axis
    for (sampling, count, seed), axes in together.items():
        factors.append(_drawn(axes, sampling, count, seed))
    factors.sort(key=lambda factor: factor.of_goal)
    if data.optimise:
        factors.insert(0, Trials(tuple(data.optimise.over), (), drawn=True, most=data.optimise.trials))
    return Design(tuple(factors))


def plain(level: Any) -> Any:
    """Numbers as numbers, radians where degrees were written; whatever else as it is."""
    try:
        return level if isinstance(level, int | float) else float(parse_number(level))
    except ValueError:
        return level


def _spread(axis: SpreadData) -> list[float]:
    if axis.range:
        first, last, step = axis.range
        return [first + k * step for k in range(int((last - first) / step * (1 + 1e-12) + 1e-12) + 1)]
    first, last, number = axis.linspace or axis.logspace or []
    count = int(number)
    if axis.logspace:
        first, last = log(first), log(last)
    values = [first + (last - first) * k / max(count - 1, 1) for k in range(count)]
    if axis.logspace:
        values = [exp(value) for value in values]
    ends = axis.linspace or axis.logspace or []
    return [ends[0], *values[1:-1], ends[1]] if count > 1 else ends[:1]


def _between(axis: SpreadData, share: float) -> float:
    """The quantile of an axis's distribution."""
    if axis.uniform:
        first, last = axis.uniform
        return first + (last - first) * share
    first, last = axis.loguniform or []
    return first * (last / first) ** share


def _drawn(axes: Mapping[str, SpreadData], sampling: str, count: int, seed: int) -> Factor:
    shares = _shares(sampling, count, len(axes), seed)
    levels = tuple(
        tuple(_between(axis, float(share)) for axis, share in zip(axes.values(), row, strict=True))
        for row in shares
    )
    return Factor(tuple(axes), levels, drawn=True)


def _shares(sampling: str, count: int, dimensions: int, seed: int) -> Array:
    """Points of the unit cube, count × dimensions, the same for the same seed."""
    generator = np.random.default_rng(seed)
    if sampling == "random":
        return generator.random((count, dimensions))
    from scipy.stats import qmc

    if sampling == "latin_hypercube":
        shares: Array = qmc.LatinHypercube(dimensions, seed=generator).random(count)
        return shares
    # a whole power of two, of which the first are taken: what a Sobol sequence is balanced for
    sequence: Array = qmc.Sobol(dimensions, seed=generator).random_base2(
        ceil(log2(count)) if count > 1 else 0
    )
    return sequence[:count]
