"""The Fourier basis of [Paper] eq. (15)."""

import casadi as ca
import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier

CASES = [(h, horizon) for h in (0, 1, 2, 7) for horizon in (1.0, 0.3, 12.0)]


@pytest.mark.parametrize(("harmonics", "horizon"), CASES)
def test_gram_is_the_integral_of_products(harmonics, horizon):
    basis = Fourier(harmonics)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    table = basis.table(0.5 * horizon * (nodes + 1), horizon)
    integral = 0.5 * horizon * table.T @ (weights[:, None] * table)
    assert np.allclose(integral, basis.gram(horizon), rtol=0, atol=1e-12 * horizon)


@pytest.mark.parametrize(("harmonics", "horizon"), CASES)
def test_table_holds_the_values_of_numbers_and_symbols(harmonics, horizon):
    basis, times = Fourier(harmonics), np.linspace(0, horizon, 11)
    expected = np.array([basis.values(t, horizon) for t in times])
    assert expected.shape == (11, basis.size)
    assert np.allclose(basis.table(times, horizon), expected, rtol=0, atol=1e-13)
    for kind in (ca.SX, ca.MX):
        time = kind.sym("t")
        function = ca.Function("phi", [time], [basis.values(time, horizon)])
        found = np.array([np.array(function(t)).ravel() for t in times])
        assert np.allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("harmonics", "horizon"), CASES)
def test_the_functions_are_periodic_and_smooth(harmonics, horizon):
    basis = Fourier(harmonics)
    ends = basis.table(np.array([0.0, horizon]), horizon)
    assert np.allclose(ends[0], ends[1], rtol=0, atol=1e-13)
    assert np.array_equal(basis.table([0.2], horizon, "left"), basis.table([0.2], horizon, "right"))
    assert basis.breakpoints(horizon).size == 0


def test_functions_stand_in_the_papers_order():
    basis = Fourier(2)
    assert basis.labels == ["const", "sin1", "cos1", "sin2", "cos2"]
    t = 0.13
    a = 2 * np.pi * t
    expected = [1, np.sin(a), np.cos(a), np.sin(2 * a), np.cos(2 * a)]
    assert np.allclose(basis.table([t], 1.0), [expected])
    assert len(Fourier(4).labels) == Fourier(4).size == 9


def test_parameters_rebuild_the_basis():
    assert Fourier(**Fourier(3).parameters()) == Fourier(3)


def test_json_holds_plain_numbers():
    data = Fourier(1).to_json(np.array([[1.0, 2, 3]]), 2.5)
    assert data == {"basis": "fourier", "horizon": 2.5, "coefficients": [[1.0, 2.0, 3.0]]}
