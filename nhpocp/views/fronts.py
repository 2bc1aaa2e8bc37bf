"""What can be had of two costs at once: the front of the points that no other betters in both."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nhpocp.arrays import Array
from nhpocp.views.style import COLOURS, axes_grid, styled

WIDE = 30.0  # most over least, from which an axis is logarithmic


def on_front(values: Array) -> Array:
    """Which of the rows (n, 2), both to be small, no other row betters, by the first number; of equal rows one."""
    order = np.lexsort(values.T[::-1])
    best = np.minimum.accumulate(values[order, 1])
    better = np.r_[True, values[order, 1][1:] < best[:-1]]
    return np.asarray(order[better])


@styled
def front(values: Array, labels: tuple[str, str]) -> Figure:
    """Rows of two costs (n, 2), the smaller the better, and their front as a staircase."""
    figure, (axes,) = axes_grid(1, 1)
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known).all(axis=1)]
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "rasterized": len(known) > 400}
    axes.plot(*known.T, color="0.65", markersize=2.5, label="dominated", **dots)
    if len(known):
        best = known[on_front(known)]
        axes.step(*best.T, where="post", color=COLOURS[0], linewidth=1.0)
        axes.plot(*best.T, color=COLOURS[0], markersize=4, label="front", **dots)
    for some, scale in zip(known.T, (axes.set_xscale, axes.set_yscale), strict=True):
        if some.size and some.min() > 0 and some.max() > WIDE * some.min():
            scale("log")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.legend(loc="upper right")
    return figure
