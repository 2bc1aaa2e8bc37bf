"""A control: values, effort, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError

LAW = settings(max_examples=25, deadline=None, derandomize=True)


@st.composite
def controls(draw):
    harmonics, inputs = draw(st.integers(0, 4)), draw(st.integers(1, 3))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    coefficients = generator.normal(size=(inputs, 2 * harmonics + 1))
    return Control(Fourier(harmonics), coefficients, draw(st.floats(0.1, 20)))


@LAW
@given(controls())
def test_effort_is_the_integral_of_the_square_and_the_sum_of_coefficients(control):
    integral = quad(lambda t: np.sum(control(t) ** 2), 0, control.horizon, epsabs=1e-12, limit=200)[0]
    constants, waves = control.coefficients[:, 0], control.coefficients[:, 1:]
    by_hand = control.horizon * (np.sum(constants**2) + 0.5 * np.sum(waves**2))
    assert control.effort == pytest.approx(integral, rel=1e-9)
    assert control.effort == pytest.approx(by_hand, rel=1e-13)


@LAW
@given(controls())
def test_values_are_the_coefficients_times_the_basis(control):
    times = np.linspace(0, control.horizon, 7)
    expected = [control.coefficients @ control.basis.values(t, control.horizon) for t in times]
    assert np.allclose(control(times), expected, rtol=0, atol=1e-12)
    assert control(times[3]).shape == (1, len(control.coefficients))


def test_the_papers_first_guess():
    control = Control(Fourier(2), [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])
    for t in (0.0, 0.2, 0.77):
        s, c = np.sin(2 * np.pi * t), np.cos(2 * np.pi * t)
        assert np.allclose(control(t), [[0.5 * s, 0.5 * s, 1 + 0.5 * c]])
    assert control.effort == pytest.approx(1.375)


@pytest.mark.parametrize("coefficients", [[1.0, 2, 3], [[1.0, 2], [3, 4]], [[[1.0, 2, 3]]], [], 5.0])
def test_wrong_shapes_are_refused_with_the_expected_columns(coefficients):
    with pytest.raises(InvalidProblemError, match=r"3 columns \(const, sin1, cos1\)"):
        Control(Fourier(1), coefficients)


def test_a_control_cannot_be_changed_from_outside():
    mine = np.ones((1, 3))
    control = Control(Fourier(1), mine)
    mine[0, 0] = 7
    assert control.coefficients[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        control.coefficients[0, 0] = 2


def test_json_and_breakpoints_come_from_the_basis():
    control = Control(Fourier(1), [[1, 2, 3]], 4.0)
    assert control.to_json() == Fourier(1).to_json(control.coefficients, 4.0)
    assert control.breakpoints.size == 0
