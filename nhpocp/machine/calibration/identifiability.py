"""What measurements say of parameters, and what they do not, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.singular_values import svd

UNSEEN = 0.1  # of a parameter's scale: what is known no better than that is not seen
ALONE = 0.95  # of a direction's entries: so large a one is the direction
PART = 0.2  # smaller ones are not named
CORRELATED = 0.95


@dataclass(frozen=True)
class Direction:
    """A direction of the parameters, each divided by its scale. value: singular value, one over a standard deviation.

    parts: the entries by name, the largest first, the small ones left out.
    """

    value: float
    parts: tuple[tuple[str, float], ...]

    @property
    def seen(self) -> bool:
        return self.value * UNSEEN >= 1.0

    @property
    def words(self) -> str:
        """What is not seen, in a sentence."""
        if abs(self.parts[0][1]) > ALONE or len(self.parts) == 1:
            return f"{self.parts[0][0]} is not seen by these data"
        combination = " ".join(
            f"{'+' if part >= 0 else '-'} {abs(part):.2f} {name}" for name, part in self.parts
        )
        names = [name for name, _ in self.parts]
        apart = f"{', '.join(names[:-1])} and {names[-1]}"
        return f"these data cannot tell {apart} apart: {combination.lstrip('+ ')} is not seen"


def directions(information: Array, scales: Array, names: Sequence[str]) -> list[Direction]:
    """Of whitened rows by θ (r, n), the best seen first."""
    count = len(names)
    rows = np.vstack([information * scales, np.zeros((count, count))])
    _, values, turned = svd(rows, full_matrices=False)
    found = []
    for value, along in zip(values[:count], turned[:count], strict=True):
        order = np.argsort(-np.abs(along))
        along = along * np.sign(along[order[0]])
        parts = [(names[i], float(along[i])) for i in order if abs(along[i]) >= PART or i == order[0]]
        found.append(Direction(float(value), tuple(parts)))
    return found


def correlations(covariance: Array, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Pairs whose errors go together, the closest first."""
    deviations = np.sqrt(np.diag(covariance))
    matrix = covariance / np.outer(deviations, deviations)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) > CORRELATED
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))
