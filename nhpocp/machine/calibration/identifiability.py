"""What measurements say of parameters, and what they do not, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.singular_values import svd

UNSEEN = 0.1  # of a parameter's scale: what is known no better than that is not seen
ABOVE = (
    3.0  # noises: by how much a change as large as the scale has to move what is measured, root mean square
)
ALONE = 0.95  # of a direction's entries: so large a one is the direction
PART = 0.2  # smaller ones are not named
CORRELATED = 0.95


@dataclass(frozen=True)
class Direction:
    """A direction of the parameters, each divided by its scale. value: singular value, one over a standard deviation.

    seen: whether that deviation is small, and the data move by more than their noise: what a machine that stands still
    seems to say of its parameters is its noise. parts: the entries by name, the largest first, the small ones left out.
    vector: all of them, (n,).
    """

    value: float
    seen: bool
    parts: tuple[tuple[str, float], ...]
    vector: Array


def directions(information: Array, scales: Array, names: Sequence[str], samples: int) -> list[Direction]:
    """Of whitened rows by θ (r, n) of so many samples, the best seen first; none where a row is not finite."""
    least = max(1.0 / UNSEEN, ABOVE * samples**0.5)
    if not np.isfinite(information).all():
        return []
    count = len(names)
    rows = np.vstack([information * scales, np.zeros((count, count))])
    _, values, turned = svd(rows, full_matrices=False)
    found = []
    for value, along in zip(values[:count], turned[:count], strict=True):
        found.append(Direction(float(value), bool(value >= least), _parts(along, names), along))
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


def unseen_words(every: Sequence[Direction], names: Sequence[str]) -> str:
    """What is not seen: parameters by themselves, then combinations of others; "" where all is seen."""
    unseen = [each.vector for each in every if not each.seen]
    if not unseen:
        return ""
    rows = np.array(unseen)
    alone = np.linalg.norm(rows, axis=0) > ALONE
    said = [f"{name} is not seen by these data" for name, lost in zip(names, alone, strict=True) if lost]
    _, values, turned = svd(np.where(alone, 0.0, rows), full_matrices=False)
    for value, along in zip(values, turned, strict=True):
        if value > 0.5:
            parts = _parts(along, names)
            told = [name for name, _ in parts]
            sum_of = " ".join(f"{'+' if part >= 0 else '-'} {abs(part):.2f} {name}" for name, part in parts)
            apart = f"{', '.join(told[:-1])} and {told[-1]}" if len(told) > 1 else told[0]
            said.append(f"these data cannot tell {apart} apart: {sum_of.lstrip('+ ')} is not seen")
    return "; ".join(said)


def _parts(along: Array, names: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """The entries of a direction by name, the largest first and positive, the small ones left out."""
    order = np.argsort(-np.abs(along))
    sign = 1.0 if along[order[0]] >= 0 else -1.0
    kept = [i for i in order if abs(along[i]) >= PART or i == order[0]]
    return tuple((names[i], float(sign * along[i])) for i in kept)
