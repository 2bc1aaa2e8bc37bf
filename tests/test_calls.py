"""CasADi functions on arrays: many samples at once, in either order, and results that are lent."""

import casadi as ca
import numpy as np
import pytest

from nhpocp.calls import PAID, _side_by_side, call, lent, mapped, side_by_side

X, Y = ca.SX.sym("x", 3), ca.SX.sym("Y", 2, 3)
FUNCTIONS = {
    "every kind": ca.Function(
        "kinds",
        [X, Y],
        [
            ca.vertcat(
                ca.sin(X[0]) / X[1],
                ca.atan2(X[2], X[0]),
                ca.fmax(X[0], 0.3),
                ca.sqrt(ca.fabs(X[1])),
                2 * X[2],
            ),
            ca.densify(Y.T @ Y * ca.if_else(X[0] > 0.5, X[1], -X[1])),
        ],
    ),
    "constants": ca.Function("constants", [X, Y], [ca.vertcat(1.5, X[0], 0.0), X]),
    "nothing": ca.Function("nothing", [X, Y], [ca.SX(0, 1), X[1] ** 2]),
}


@pytest.mark.parametrize("samples", [1, 2, 60])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_side_by_side_is_one_by_one(name, samples):
    random, function = np.random.default_rng(samples), FUNCTIONS[name]
    x, y = random.uniform(0.1, 1.0, (samples, 3)), random.uniform(-1.0, 1.0, (3 * samples, 2))
    together, one_by_one = call(_side_by_side(function, samples), x, y), call(mapped(function, samples), x, y)
    for found, expected in zip(together, one_by_one, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_what_is_lent_is_written_over_and_what_is_called_for_is_not():
    double = ca.Function("double", [X], [2 * X])
    kept, (taken,) = call(double, np.ones(3))[0], lent(double, np.ones(3))
    call(double, np.zeros(3))
    assert (kept == 2.0).all()
    assert (taken == 0.0).all()


def test_wrong_sizes_are_named():
    with pytest.raises(ValueError, match="4 numbers for i0, 3 expected"):
        call(ca.Function("double", [X], [2 * X]), np.ones(4))


def test_side_by_side_is_made_once_it_would_have_paid():
    function, samples = ca.Function("triple", [X], [3 * X]), 1000
    asked = [side_by_side(function, samples) for _ in range(PAID // samples + 3)]
    made = [found is not mapped(function, samples) for found in asked]
    assert made == [False] * (PAID // samples) + [True] * 3
