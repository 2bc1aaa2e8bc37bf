"""The front of two costs, by its definition."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nhpocp.views.fronts import front, on_front

ROWS = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=30)


@given(ROWS)
def test_the_front_is_what_nothing_betters(rows):
    values = np.array(rows, dtype=float)
    kept = {tuple(row) for row in values[on_front(values)]}
    free = {row for row in rows if not any(a <= row[0] and b <= row[1] and (a, b) != row for a, b in rows)}
    assert kept == free
    assert len(on_front(values)) == len(free)


def test_it_is_drawn_as_a_staircase_over_all_points():
    (axes,) = front(np.array([[1.0, 3.0], [2.0, 1.0], [3.0, 4.0], [np.nan, 0.0]]), ("effort", "time")).axes
    dots, stairs, best = axes.get_lines()
    assert len(dots.get_xdata()) == 3
    assert list(stairs.get_xdata()) == list(best.get_xdata()) == [1.0, 2.0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("effort", "time")
