"""Least cost on the surface e = 0 within inequalities g ≥ 0: the method of multipliers around the null-space search.

The inequalities enter as an exterior penalty, as Divelbiss and Wen (1997) have them in the null space of J. Alone it
would stop outside by about κ/ρ, κ the multiplier and ρ the weight; shifting every row by that much, round after round,
leads to the constrained optimum itself at a moderate ρ. [Nocedal, Wright, ch. 17.3 and 17.4]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.curvature import Curvature
from nhpocp.solvers.least_cost.null_space import Constraint, Cost, NullSpaceResult, Penalty, minimise

ROUNDS = 12
FIRST_WEIGHT = 1e3  # times the scale of the cost, on rows in units of their limits
MOST_WEIGHT = 1e7
STEPS = 100  # at most, of the search in one round
PATIENCE = (
    3  # rounds one after another that hardly reduce the violation, before the bounds count as out of reach
)
GAIN = 4.0  # by which a round should reduce the violation; else the weight grows
COMPLEMENTARY = 2e-4  # of its limit: the room that a row which presses may leave


class Rows(Protocol):
    """Inequalities g(y) ≥ 0 sampled along a path."""

    def values(self, y: Array) -> Array:
        """g at the samples, (k,)."""
        ...

    def slopes(self, y: Array) -> Array:
        """∂g/∂y, (k, len(y))."""
        ...

    def between(self, y: Array) -> Array:
        """The least g in the neighbourhood of every sample, (k,): what has to be ≥ 0."""
        ...


@dataclass(frozen=True)
class Round:
    """Where one round of the method of multipliers ended."""

    found: NullSpaceResult
    least: float  # g between the samples too; negative: the violation
    weight: float
    settled: bool  # neither the violation nor the multipliers ask for another round


def rounds(
    constraint: Constraint,
    cost: Cost,
    rows: Rows,
    y: Array,
    *,
    scale: float,
    slack: float,
    tolerance: float,
    goal: float,
    curvature: float = 2.0,
    hessian: Curvature | None = None,
    budget: Budget | None = None,
) -> Iterator[Round]:
    """One result after another, each nearer to the least cost with every g ≥ -slack.

    Ends when that is found, or after `ROUNDS`. A row is shifted by how much worse the path is near its sample than at
    it, and by its multiplier over the weight, which grows by what is lacking there and shrinks by what is to spare.
    ``scale``: a typical value of the cost; the others: as in `minimise`.
    """
    weight, before, hopeless = FIRST_WEIGHT * scale, np.inf, 0
    offset, pressure = np.array(0.0), np.array(0.0)  # per row: g at the sample - least g near it, κ/ρ
    for _ in range(ROUNDS):
        penalty = Penalty(rows.values, rows.slopes, offset + pressure, weight)
        found = minimise(
            constraint,
            cost,
            y,
            penalty=penalty,
            curvature=curvature,
            hessian=hessian,
            tolerance=tolerance,
            goal=goal,
            most=STEPS,
            budget=budget,
        )
        y, hessian = found.y, found.hessian
        between = rows.between(y)
        least = float(np.min(between)) if np.isfinite(between).all() else -np.inf
        offset, pressure = found.rows - between, np.maximum(0.0, offset + pressure - found.rows)
        spare = float(np.max(np.minimum(pressure, between)))
        settled = least >= -slack and spare <= COMPLEMENTARY
        yield Round(found, least, weight, settled)
        hopeless = hopeless + 1 if -least > max(slack, 0.9 * before) else 0
        if settled or not np.isfinite(least) or hopeless == PATIENCE:
            return
        pressure = np.maximum(0.0, pressure - between)
        if -least > max(slack, before / GAIN) and weight < MOST_WEIGHT * scale:
            weight, pressure = 10.0 * weight, pressure / 10.0
        before = -least
