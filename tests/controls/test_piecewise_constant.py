"""Controls that jump between equal intervals."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import InvalidProblemError

LAW = settings(max_examples=30, deadline=None, derandomize=True)
counts, horizons = st.integers(1, 60), st.floats(1e-3, 1e3)


@LAW
@given(counts, horizons, st.floats(0, 1))
def test_exactly_one_function_is_one(intervals, horizon, share):
    basis = PiecewiseConstant(intervals)
    for side in ("left", "right"):
        (row,) = basis.table(np.array([share * horizon]), horizon, side)
        assert sorted(row) == [0.0] * (intervals - 1) + [1.0]


@LAW
@given(counts, horizons)
def test_sides_differ_by_one_interval_at_the_breakpoints_only(intervals, horizon):
    basis = PiecewiseConstant(intervals)
    left, right = (basis.table(basis.breakpoints(horizon), horizon, side) for side in ("left", "right"))
    np.testing.assert_array_equal(left, np.eye(intervals)[:-1])
    np.testing.assert_array_equal(right, np.eye(intervals)[1:])
    middles = (np.arange(intervals) + 0.5) * horizon / intervals
    for side in ("left", "right"):
        np.testing.assert_array_equal(basis.table(middles, horizon, side), np.eye(intervals))
        ends = basis.table(np.array([0.0, horizon]), horizon, side)
        np.testing.assert_array_equal(ends, np.eye(intervals)[[0, -1]])


@LAW
@given(counts, horizons)
def test_the_gram_matrix_is_the_integral(intervals, horizon):
    basis = PiecewiseConstant(intervals)
    middles = (np.arange(4 * intervals) + 0.5) * horizon / (4 * intervals)
    table = basis.table(middles, horizon)
    np.testing.assert_allclose(basis.gram(horizon), table.T @ table * horizon / (4 * intervals), rtol=1e-12)


@LAW
@given(st.integers(1, 12), st.floats(0, 1))
def test_values_agree_with_the_table_for_numbers_and_symbols(intervals, share):
    basis, t = PiecewiseConstant(intervals), ca.SX.sym("t")
    if abs(share * intervals - round(share * intervals)) < 1e-6:
        share = 0.5 / intervals  # beside a breakpoint rounding decides
    row = basis.table(np.array([2.0 * share]), 2.0)[0]
    np.testing.assert_array_equal(basis.values(2.0 * share, 2.0), row)
    symbolic = ca.Function("phi", [t], [basis.values(t, 2.0)])
    np.testing.assert_array_equal(np.array(symbolic(2.0 * share)).ravel(), row)


@LAW
@given(counts, horizons)
def test_json_round_trip(intervals, horizon):
    values = np.random.default_rng(intervals).normal(size=(3, intervals))
    data = Control(PiecewiseConstant(intervals), values, horizon).to_json()
    assert (data["basis"], len(data["grid"]), len(data["values"])) == (
        "piecewise_constant",
        intervals + 1,
        intervals,
    )
    basis, coefficients = PiecewiseConstant.from_json(data)
    assert basis == PiecewiseConstant(intervals)
    np.testing.assert_array_equal(coefficients, values)
    assert PiecewiseConstant(**basis.parameters()) == basis
    assert len(basis.labels) == basis.size == intervals


def test_an_uneven_grid_is_refused():
    data = {"horizon": 1.0, "grid": [0, 0.3, 1], "values": [[1.0], [2.0]]}
    with pytest.raises(InvalidProblemError, match="only equal intervals"):
        PiecewiseConstant.from_json(data)
    with pytest.raises(InvalidProblemError, match="only equal intervals"):
        PiecewiseConstant.from_json({**data, "grid": [0, 1]})
