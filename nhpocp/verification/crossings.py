"""Where a determinant changes its sign along a path, found by sampling, bracketing and Brent's method."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.solution import Crossing
from nhpocp.state_space import StateSpace
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.replay import Path


def find_crossings(numeric: NumericSystem, path: Path, times: Array) -> list[Crossing]:
    """Every sign change of every regularity determinant, in order of time."""
    times = np.unique(times)
    found = []
    for name, values in numeric.determinants(path(times)).items():

        def determinant(t: float, name: str = name) -> float:
            return float(numeric.determinants(path(np.array([t])))[name][0])

        signs = np.sign(values[np.isfinite(values) & (values != 0)])
        returns = bool(len(signs) and signs[0] == signs[-1])
        for time in sign_changes(determinant, times, values):
            state = describe_state(numeric.system.state_space, path(np.array([time]))[0])
            found.append(Crossing(f"det_{name}", time, state, returns))
    return sorted(found, key=lambda crossing: crossing.time)


def sign_changes(function: Callable[[float], float], times: Array, values: Array) -> list[float]:
    """Zeros with a change of sign of a function known at times; also pairs that fall between two samples."""
    usable = np.isfinite(values) & (values != 0)  # a sample exactly on a zero is bracketed by its neighbours
    times, values = times[usable], values[usable]
    knots = [(float(t), float(np.sign(value))) for t, value in zip(times, values, strict=True)]
    knots += [(dip, -sign) for dip, sign in _dips(function, times, values)]
    zeros = []
    for (low, before), (high, after) in pairwise(sorted(knots)):
        if before != after:
            zeros.append(float(brentq(function, low, high, xtol=1e-12)))
    return zeros


def _dips(function: Callable[[float], float], times: Array, values: Array) -> list[tuple[float, float]]:
    """Times between samples at which |f| dips through zero and back, with the sign f has around them."""
    size, signs = np.abs(values), np.sign(values)
    dips = []
    for k in range(1, len(values) - 1):
        if not (signs[k - 1] == signs[k] == signs[k + 1] and size[k] <= min(size[k - 1], size[k + 1])):
            continue
        curvature = size[k - 1] - 2 * size[k] + size[k + 1]
        sag = (size[k + 1] - size[k - 1]) ** 2 / (8 * curvature) if curvature > 0 else 0.0
        if sag < 0.5 * size[k]:  # the parabola through three samples stays well clear of zero
            continue
        lowest = minimize_scalar(
            lambda t, sign=signs[k]: sign * function(t),
            bounds=(times[k - 1], times[k + 1]),
            method="bounded",
            options={"xatol": 1e-12},
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
