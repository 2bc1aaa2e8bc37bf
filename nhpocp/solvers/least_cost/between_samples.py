"""How low a quantity gets between the samples of a path."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array

NEAR = 0.1  # of a bound's size: how near to it a dip is looked at again
SLIGHT = 1e-4  # of a bound's size: what is lower by less is not chased, a tenth of what verification forgives
LOOKS = 8  # in each step beside it


def lowest_between(times: Array, values: Array) -> Array:
    """Values (k, columns), those that are less than both neighbours made as low as the parabola through the three.

    In units of a bound's size. A body that passes a corner is nearest to it between two samples. Nothing where times
    repeat.
    """
    steps = np.diff(times)
    even = np.isclose(steps[:-1], steps[1:], rtol=1e-3, atol=0.0) & (steps[:-1] > 0)
    before, here, after = values[:-2], values[1:-1], values[2:]
    with np.errstate(all="ignore"):
        below = (after - before) ** 2 / (8.0 * (after - 2.0 * here + before))
    dips = even[:, None] & (here <= before) & (here <= after) & (below > SLIGHT)
    lowest = np.array(values)
    lowest[1:-1] -= np.where(dips, below, 0.0)
    return lowest


def dips_of(times: Array, values: Array) -> Array:
    """Places at which a column of values (k, columns) is less than at both neighbours, and near 0, by even steps."""
    steps = np.diff(times)
    even = np.isclose(steps[1:], steps[:-1], rtol=1e-3, atol=0.0) & (steps[:-1] > 0)
    inner = values[2:-2]
    dips = ((inner <= values[1:-3]) & (inner <= values[3:-1]) & (inner < NEAR)).any(axis=1)
    return np.flatnonzero(dips & even[:-2] & even[1:-1] & even[2:]) + 2


def around(places: Array, times: Array, states: Array) -> tuple[Array, Array]:
    """Times in both steps beside each place, and states (k, n) there by the cubic through the four that are nearest.

    The path is smooth, what is measured along it may have a kink: where one corner is nearer than another.
    """
    s = np.arange(LOOKS) / LOOKS
    cubic = np.column_stack(  # Lagrange's, over -1, 0, 1, 2
        [
            -s * (s - 1) * (s - 2) / 6,
            (s + 1) * (s - 1) * (s - 2) / 2,
            -(s + 1) * s * (s - 2) / 2,
            (s + 1) * s * (s - 1) / 6,
        ]
    )
    begins = np.stack([places - 1, places], axis=1)  # of the steps
    width = times[places + 1] - times[places]
    when = times[begins][..., None] + s * width[:, None, None]
    nearest = states[begins[..., None] + np.arange(-1, 3)]  # (places, 2, 4, n)
    return when.ravel(), np.einsum("sk,pbkn->pbsn", cubic, nearest).reshape(when.size, -1)
