"""Where a determinant is zero along a path, its sign changing there or not: samples, brackets, Brent's method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.solution import Crossing
from nhpocp.state_space import StateSpace
from nhpocp.systems.margins import det
from nhpocp.systems.margins import sigma as sigma_of
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.replay import Path

MOST = 100  # zeros of a function that are found out exactly; more of them lie no closer than its samples
TOUCH = 1e-6  # σ_min, dimensionless: below it, dividing by it leaves six of a replay's twelve digits


def find_crossings(numeric: NumericSystem, path: Path, times: Array, length_scale: float) -> list[Crossing]:
    """Every zero of every regularity determinant, in order of time: sign changes, and touches from one side."""
    times = np.unique(times)
    states, crossings = path(times), []
    margins = numeric.margins(states, length_scale)
    for name in numeric.regularity(states[:1]):
        values, sigmas = margins[det(name).name], margins[sigma_of(name).name]

        def determinant(t: float, name: str = name) -> float:
            return float(numeric.determinants(path(np.array([t])))[name][0])

        def sigma(t: float, name: str = name) -> float:
            return float(numeric.sigmas(path(np.array([t])), length_scale)[name][0])

        signs = np.sign(values[np.isfinite(values) & (values != 0)])
        returns = bool(len(signs) and signs[0] == signs[-1])
        crossed = sign_changes(determinant, times, values)
        touched = touches(sigma, times, sigmas, crossed)
        for time, touch in [*((t, False) for t in crossed), *((t, True) for t in touched)]:
            state = describe_state(numeric.system.state_space, path(np.array([time]))[0])
            crossings.append(Crossing(det(name).name, time, state, touch or returns, touch))
    return sorted(crossings, key=lambda crossing: crossing.time)


def touches(
    function: Callable[[float], float], times: Array, values: Array, crossed: Sequence[float] = ()
) -> list[float]:
    """Times at which a function ≥ 0, known at times, comes below `TOUCH`; one of each stretch of samples.

    Stretches that hold one of the times ``crossed`` are left out. Of more than `MOST` places the lowest are looked at.
    """
    usable = np.isfinite(values)
    times, values = times[usable], values[usable]
    touched: list[float] = []
    places = _low_places(values)
    if len(places) > MOST:
        places = sorted(sorted(places, key=lambda k: values[k])[:MOST])
    for k in places:
        span = times[max(k - 1, 0) : k + 2]
        if any(span[0] <= time <= span[-1] for time in crossed):
            continue
        lowest = minimize_scalar(
            function, bounds=(span[0], span[-1]), method="bounded", options={"xatol": 1e-12 * times[-1]}
        )
        time = float(lowest.x if lowest.fun < values[k] else times[k])
        if min(lowest.fun, values[k]) <= TOUCH and not (touched and time - touched[-1] < span[-1] - span[0]):
            touched.append(time)
    return touched


def _low_places(values: Array) -> list[int]:
    """Samples beside which a function ≥ 0 may come below `TOUCH`: where it does so first, and minima low enough."""
    if not len(values):
        return []
    low, sides = values <= TOUCH, _beside(values)
    first = low & ~np.append(False, low[:-1])
    # over half a step it falls by no more than over the whole ones beside it
    steepest = np.abs(sides - values).max(axis=0)
    minimum = ~low & (values <= sides.min(axis=0)) & (values - steepest <= TOUCH)
    return [int(k) for k in np.flatnonzero(first | minimum)]


def _beside(values: Array) -> Array:
    """The samples before and after each, (2, k); at the ends the sample itself."""
    return np.stack([np.append(values[:1], values[:-1]), np.append(values[1:], values[-1:])])


def sign_changes(function: Callable[[float], float], times: Array, values: Array) -> list[float]:
    """Zeros with a change of sign of a function known at times; also pairs that fall between two samples.

    More than `MOST` are rounding, or more than samples resolve: each then lies where a straight line between two of
    them has it.
    """
    usable = np.isfinite(values) & (values != 0)  # a sample exactly on a zero is bracketed by its neighbours
    times, values = times[usable], values[usable]
    changes = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    if len(changes) > MOST:
        fractions = 1.0 / (1.0 + np.abs(values[changes + 1] / values[changes]))
        return [float(t) for t in times[changes] + fractions * (times[changes + 1] - times[changes])]
    knots = [(float(t), float(np.sign(value))) for t, value in zip(times, values, strict=True)]
    knots += [(dip, -sign) for dip, sign in _dips(function, times, values)]
    zeros = []
    for (low, before), (high, after) in pairwise(sorted(knots)):
        if before != after:
            zeros.append(float(brentq(function, low, high, xtol=1e-12 * (high - low))))
    return zeros


def _dips(function: Callable[[float], float], times: Array, values: Array) -> list[tuple[float, float]]:
    """Times between samples at which |f| dips through zero and back, with the sign f has around them."""
    if len(values) < 3:
        return []
    size, signs = np.abs(values), np.sign(values)
    before, after = _beside(size)
    curvature = before - 2 * size + after
    with np.errstate(all="ignore"):
        sag = np.where(curvature > 0, (after - before) ** 2 / (8 * curvature), 0.0)
    # the parabola through three samples comes close to zero
    near = (signs == _beside(signs)).all(axis=0) & (size <= np.minimum(before, after)) & (sag >= 0.5 * size)
    near[[0, -1]] = False
    dips: list[tuple[float, float]] = []
    for k in np.flatnonzero(near)[:MOST]:
        lowest = minimize_scalar(
            lambda t, sign=signs[k]: sign * function(t),
            bounds=(times[k - 1], times[k + 1]),
            method="bounded",
            options={"xatol": 1e-12 * (times[k + 1] - times[k - 1])},
        )
        if lowest.fun < 0:
            dips.append((float(lowest.x), float(signs[k])))
    return dips


def describe_state(space: StateSpace, point: Array) -> dict[str, list[float] | float]:
    """A state as plain data: vectors as lists, rotations as (roll, pitch, yaw) [rad], with the yaw once more alone."""
    described: dict[str, list[float] | float] = {}
    for block in space.blocks:
        value = point[space.point_slice(block.name)]
        if block.kind == "rotation":
            value = so3.to_rpy(value.reshape(3, 3))
            described["yaw"] = float(value[2])
        described[block.name] = float(value[0]) if block.kind == "scalar" else [float(x) for x in value]
    return described
