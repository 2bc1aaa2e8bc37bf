"""How laws are run, and what a law that does not hold says: an `AssertionError` with a sentence, whatever runs it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import one_line

Law = Callable[..., None]


def run(subject: str, laws: Iterable[Law], *arguments: Any) -> None:
    """Holds a member of a family against laws, one after another.

    Errors: `AssertionError` naming the first law that does not hold, and why.
    """
    for law in laws:
        words = f"{subject}: {law.__name__.strip('_').replace('_', ' ')}"
        try:
            law(*arguments)
        except AssertionError as error:
            raise AssertionError(f"{words}: no. {error}") from None
        except Exception as error:
            raise AssertionError(f"{words}: {one_line(error)}") from error


def holds(condition: Any, sentence: str) -> None:
    """Errors: `AssertionError` with the sentence, unless the condition holds."""
    if not condition:
        raise AssertionError(sentence)


def apart(came: Any, expected: Any, scale: float = 1.0) -> float:
    """The largest distance of two arrays of one shape, relative to the largest number expected, or to ``scale``.

    scale: what counts as 1 where all that is expected is less; 0: the distance itself.
    """
    came, expected = np.asarray(came, dtype=float), np.asarray(expected, dtype=float)
    holds(came.shape == expected.shape, f"shape {came.shape}; expected {expected.shape}")
    largest = float(np.abs(expected).max(initial=0.0))
    return float(np.abs(came - expected).max(initial=0.0)) / (max(scale, largest) if scale else 1.0)


def agree(what: str, came: Any, expected: Any, tolerance: float, scale: float = 1.0) -> None:
    """Errors: `AssertionError` where two arrays are further `apart` than a tolerance, or one is no number."""
    try:
        distance = apart(came, expected, scale)
    except AssertionError as error:
        raise AssertionError(f"{what} is of {error}") from None
    holds(
        distance <= tolerance,
        f"{what} is {_shown(came)}; expected {_shown(expected)} to within {tolerance:g}, they are {distance:.3g} apart",
    )


def _shown(value: Any) -> str:
    numbers: Array = np.asarray(value, dtype=float)
    return np.array2string(numbers, precision=9, threshold=12, edgeitems=3).replace("\n", "")
