"""Singular surfaces that a path runs into or jumps across, noticed while a solver evaluates it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import EndPoint
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.ending import Ending
from nhpocp.solvers.continuation.trust_region import Number
from nhpocp.systems.numeric import NumericSystem

SINGULAR = {"s": Outcome.SINGULAR_S, "w": Outcome.SINGULAR_W}  # by the name of the regularity matrix
SINGULAR_BELOW = 0.05  # |det| against its value at the start, before a path that is not finite


def keeps_sign(determinants: Array) -> Number:
    """Whether determinants (…, times) have one sign along each path; no if one is not a number."""
    return (np.minimum.reduce(determinants, axis=-1) > 0) | (np.maximum.reduce(determinants, axis=-1) < 0)


def determinants(numeric: NumericSystem, end: EndPoint, finite: bool) -> dict[str, Array]:
    """Of the matrices that the equations divide by; undefined counts as zero (a leg along its own w4 has no w3)."""
    watched = end.watched if finite else end.watched[np.isfinite(end.path).all(axis=1)]
    return {
        name: np.where(np.isnan(values), 0.0, values) for name, values in numeric.breaking(watched).items()
    }


def first_crossing(determinants: Mapping[str, Array], times: Array) -> Ending | None:
    """The first change of sign of a determinant that the equations divide by."""
    for name, values in determinants.items():
        if keeps_sign(values):
            continue
        changes = np.flatnonzero(np.sign(values) * np.sign(values[0]) <= 0)
        if changes.size and changes[0] == 0:
            return _singular(name, "vanishes at the start")
        if changes.size:
            before, after = times[changes[0] - 1 : changes[0] + 1]
            return _singular(name, f"changes sign between t = {before:.4g} and {after:.4g}")
    return None


def nearest_approach(determinants: Mapping[str, Array], times: Array) -> Ending | None:
    """A path that is not finite may have landed on the same side of a surface that it ran into."""
    for name, values in determinants.items():
        fraction = np.abs(values / values[0])
        if fraction.min() < SINGULAR_BELOW:
            where = times[int(np.argmin(fraction))]
            return _singular(name, f"falls to {fraction.min():.2g} of its first value at t = {where:.4g}")
    return None


def _singular(name: str, words: str) -> Ending:
    return Ending(SINGULAR.get(name, Outcome.NOT_FINITE), f"det {name.upper()} {words}")
