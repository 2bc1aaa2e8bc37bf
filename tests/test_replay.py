"""Replays of controls that jump, and the places where a determinant changes its sign."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from conftest import PAPER_START, paper_problem

from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.crossings import sign_changes
from nhpocp.verification.replay import inputs_on_piece, integrate, replay, sample


class Jump(Fourier):
    """-1 before t = 0.3, then 5 (1 + 0 t): two constants."""

    def __init__(self):
        super().__init__(0)

    def breakpoints(self, horizon):
        return np.array([0.3])

    def table(self, times, horizon, side="right"):
        times = np.asarray(times)
        return np.where((times > 0.3) | ((times == 0.3) & (side == "right")), 5.0, -1.0)[:, None]


class JumpingRamp(Jump):
    """-1 before t = 0.3, then 5 t."""

    def table(self, times, horizon, side="right"):
        table = super().table(times, horizon, side)
        return np.where(table > 0, table * np.asarray(times)[:, None], table)


@pytest.mark.parametrize(("basis", "end"), [(Jump(), 3.2), (JumpingRamp(), 1.975)])
def test_nothing_straddles_a_discontinuity(basis, end):
    """A control that jumps is integrated exactly, whether it is constant between the jumps or not."""
    path = integrate(lambda t, x, u: u, Control(basis, [[1.0]]), np.zeros(1))
    np.testing.assert_allclose(path([0.15, 0.3, 1.0])[:, 0], [-0.15, -0.3, end], atol=1e-14)
    assert path.at(0.3) == pytest.approx(-0.3, abs=1e-14)


def test_sampling_gives_both_sides_of_a_breakpoint():
    control = Control(Jump(), [[1.0]])
    samples = sample(integrate(lambda t, x, u: u, control, np.zeros(1)), control, 11)
    at_jump = samples.times == 0.3
    assert samples.controls[at_jump, 0].tolist() == [-1.0, 5.0]


BASES = [Fourier(0), Fourier(1), Fourier(30), PiecewiseConstant(1), PiecewiseConstant(7), JumpingRamp()]


@pytest.mark.parametrize("basis", BASES, ids=lambda basis: f"{type(basis).__name__} {basis.size}")
@pytest.mark.parametrize("horizon", [0.4, 1.0, 3.0])
def test_inputs_on_a_piece_are_the_controls(basis, horizon):
    coefficients = np.random.default_rng(0).normal(size=(2, basis.size))
    control = Control(basis, coefficients, horizon)
    knots = np.unique([0.0, *control.breakpoints, horizon])
    for first, last in pairwise(knots):
        inputs = inputs_on_piece(control, first, last)
        for time in np.linspace(first, last, 12)[:-1]:
            np.testing.assert_allclose(inputs(time), control(np.array([time]))[0], atol=1e-14)
        np.testing.assert_allclose(inputs(last), control(np.array([last]), "left")[0], atol=1e-14)


def test_a_constant_piece_is_evaluated_once():
    """The law of what a replay costs, in place of a stopwatch."""
    looked = []

    class Counting(PiecewiseConstant):
        def table(self, times, horizon, side="right"):
            looked.append(len(times))
            return super().table(times, horizon, side)

    problem, middles = paper_problem(), np.arange(20) / 20 + 0.025
    control = Control(Counting(20), Control(Fourier(2), PAPER_START)(middles).T)
    replay(NumericSystem(problem.system), control, problem.start_point)
    assert len(looked) == 20


def test_equal_pieces_lead_where_one_constant_does():
    problem, constant = paper_problem(), np.array([[0.2], [-0.1], [1.0]])
    numeric = NumericSystem(problem.system)
    controls = [Control(basis, np.tile(constant, basis.size)) for basis in (Fourier(0), PiecewiseConstant(9))]
    whole, parts = (replay(numeric, control, problem.start_point).at(1.0) for control in controls)
    np.testing.assert_allclose(parts, whole, atol=1e-11)


@pytest.mark.parametrize("zeros", [[0.123456789], [0.5], [0.501, 0.5013], [0.2, 0.7, 0.71]])
def test_sign_changes_are_found_to_nine_digits(zeros):
    def function(t):
        return float(np.prod([t - zero for zero in zeros]))

    times = np.linspace(0, 1, 101)  # 0.5 is a sample; 0.501 and 0.5013 fall between two
    found = sign_changes(function, times, np.array([function(t) for t in times]))
    np.testing.assert_allclose(found, zeros, atol=1e-9)


def test_touching_zero_is_no_change_of_sign():
    times = np.linspace(0, 1, 101)
    assert sign_changes(lambda t: (t - 0.503) ** 2 + 1e-9, times, (times - 0.503) ** 2 + 1e-9) == []
