"""Accelerations of the legs from the replayed pose alone: second differences of the distances between their joints."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.verification.geometry import leg_frames
from nhpocp.verification.replay import Path

NODES = 9  # of a stencil
STEP = 2e-3  # of the horizon, between its nodes, at most
FINEST = 25  # nodes a period of the control's fastest function, at least


def second_differences(system: Any, path: Path, times: Array, control: Control) -> Array:
    """l̈ of the legs with a motor at times (k,) → (k, legs), seen from inside the control's smooth pieces.

    times: in order; a breakpoint stands twice, the side before it first. Each time has a stencil in its own piece,
    which is one-sided near the ends. A piece that is shorter than a few roundings has none: NaN.
    """
    ends = np.concatenate(
        [[0.0], np.unique(control.breakpoints[control.breakpoints < path.reached]), [path.reached]]
    )
    again = np.r_[False, np.diff(times) == 0]
    place = np.where(again, np.searchsorted(ends, times, "right"), np.searchsorted(ends, times, "left")) - 1
    place = np.clip(place, 0, len(ends) - 2)
    low, high = ends[place], ends[place + 1]
    most = control.horizon * min(STEP, 1.0 / (FINEST * max(control.basis.oscillations, 1e-9)))
    step = np.minimum(most, (high - low) / (NODES - 1))
    first = np.clip(times - (NODES - 1) / 2 * step, low, high - (NODES - 1) * step)
    nodes = first[:, None] + step[:, None] * np.arange(NODES)
    lengths = _lengths(system, path(np.minimum(nodes, path.reached).ravel())).reshape(*nodes.shape, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = _second_derivative((times - first) / step) / step[:, None] ** 2
        return np.einsum("kn,knl->kl", weights, lengths - lengths[:, :1])


def _lengths(system: Any, states: Array) -> Array:
    """Lengths of the legs with a motor at poses (k, size) → (k, legs)."""
    blocks = system.state_space.split(states)
    rotation = blocks["orientation"]
    position = blocks.get("position", np.zeros((len(states), 3)))
    return np.stack([leg_frames(leg, position, rotation)[0] for leg in system.legs if leg.actuated], axis=1)


@cache
def _monomials() -> Array:
    """Coefficients of the polynomials that are 1 at one node and 0 at the others, a column each; by falling powers."""
    return np.linalg.inv(np.vander(np.arange(NODES) - (NODES - 1) / 2))


def _second_derivative(places: Array) -> Array:
    """Of these polynomials at places (k,) between the nodes 0 … NODES - 1 → (k, NODES)."""
    x, powers = places - (NODES - 1) / 2, np.arange(NODES - 1, -1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        raised = np.where(powers >= 2, powers * (powers - 1) * x[:, None] ** np.maximum(powers - 2, 0), 0.0)
    return raised @ _monomials()
