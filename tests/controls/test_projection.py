"""Carrying a control from one basis to another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project

LAW = settings(max_examples=25, deadline=None, derandomize=True)
bases = st.one_of(st.builds(Fourier, st.integers(0, 6)), st.builds(PiecewiseConstant, st.integers(1, 30)))


@st.composite
def controls(draw):
    basis = draw(bases)
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return Control(basis, generator.normal(size=(2, basis.size)), draw(st.floats(0.1, 20)))


def inner(one, other):
    """∫ one · other dt by a fine midpoint rule on the common breakpoints of every uniform grid up to 30."""
    knots = np.unique(np.concatenate([[0.0, one.horizon], one.breakpoints, other.breakpoints]))
    shares = (np.arange(400) + 0.5) / 400
    times = (knots[:-1, None] + np.diff(knots)[:, None] * shares).ravel()
    weights = np.repeat(np.diff(knots) / 400, 400)
    return weights @ np.sum(one(times) * other(times), axis=1)


@LAW
@given(controls())
def test_a_control_is_its_own_projection(control):
    again = project(control, control.basis)
    np.testing.assert_allclose(again.coefficients, control.coefficients, atol=1e-10)
    assert again.horizon == control.horizon


@LAW
@given(controls(), bases)
def test_what_is_lost_is_orthogonal_to_the_basis(control, basis):
    """∫ control · φ = ∫ projection · φ for every projection, itself the nearest: Pythagoras."""
    nearest = project(control, basis)
    assert inner(control, nearest) == pytest.approx(nearest.effort, rel=1e-3, abs=1e-4)
    assert nearest.effort <= control.effort * (1 + 1e-9)
    np.testing.assert_allclose(project(nearest, basis).coefficients, nearest.coefficients, atol=1e-9)


@LAW
@given(st.integers(1, 20), st.integers(1, 4), st.floats(0.1, 10))
def test_refining_a_grid_loses_nothing(intervals, times, horizon):
    generator = np.random.default_rng(intervals)
    coarse = Control(PiecewiseConstant(intervals), generator.normal(size=(3, intervals)), horizon)
    fine = project(coarse, PiecewiseConstant(intervals * times))
    np.testing.assert_allclose(fine.coefficients, np.repeat(coarse.coefficients, times, axis=1), atol=1e-10)


def test_on_a_grid_it_is_the_mean_over_each_interval():
    control = Control(Fourier(1), [[0.0, 1.0, 0.0]], 1.0)
    (values,) = project(control, PiecewiseConstant(4)).coefficients
    mean = 2 / np.pi  # of sin 2πt over a quarter
    np.testing.assert_allclose(values, [mean, mean, -mean, -mean], atol=1e-12)
