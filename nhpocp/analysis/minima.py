"""Minima of functions of one number, many at once: zeros that a function touches without changing its sign."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nhpocp.arrays import Array

GOLDEN = 0.5 * (5**0.5 - 1)
STEPS = 40  # shrink an interval to 4e-9 of itself


def golden_section(function: Callable[[Array], Array], low: Array, high: Array) -> tuple[Array, Array]:
    """Minima of unimodal functions between low (k,) and high (k,): where, and how low; all are evaluated together."""
    inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    for _ in range(STEPS):
        left = function(inner) < function(outer)
        low, high = np.where(left, low, inner), np.where(left, outer, high)
        inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    middle = 0.5 * (low + high)
    return middle, function(middle)
