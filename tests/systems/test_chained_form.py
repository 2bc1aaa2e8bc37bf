"""Chained forms there and back, their feedback against differences of the coordinates, and the canonical sinusoids."""

from __future__ import annotations

from math import factorial, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file.registry import SYSTEMS, system_class

FORMS = {
    "chained": {"n": 6},
    "heisenberg": {"scale": -0.5},
    "unicycle": {},
    "car": {"wheelbase": 2},
    "car_with_trailers": {"lengths": [1, 0.7, 0.5]},
    "nonholonomic_manipulator": {"gains": [1, 0.5, 2]},
}


def states(system, seed, count=5):
    """A point and others about it, angles and hitch angles small."""
    random = np.random.default_rng(seed)
    near = random.uniform(-1, 1, system.state_space.size) * (0.3 if system.model != "unicycle" else 3)
    return near, near + random.uniform(-0.2, 0.2, (count, len(near)))


def test_every_system_that_says_it_has_one_is_here():
    has = []
    for model in SYSTEMS:
        system = system_class(model)()
        if system.chained_form(np.zeros(system.state_space.size)) is not None:
            has.append(model)
    assert set(has) == set(FORMS)


@pytest.mark.parametrize("model", FORMS)
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_there_and_back_and_the_feedback(model, seed):
    system = system_class(model)(**FORMS[model])
    near, points = states(system, seed)
    form = system.chained_form(near)
    z = form.to_chained(points)
    np.testing.assert_allclose(form.from_chained(z), points, atol=1e-9)
    inputs = np.random.default_rng(seed).standard_normal((len(points), 2))
    v = form.to_chained_input(points, inputs)
    np.testing.assert_allclose(form.from_chained_input(points, v), inputs, atol=1e-9)
    for point, u, own, coordinates in zip(points, inputs, v, z, strict=True):
        rate, step = np.asarray(system.rate(point, u), dtype=float).ravel(), 1e-5
        moved = (form.to_chained(point + step * rate) - form.to_chained(point - step * rate)) / (2 * step)
        expected = np.array([*own, *(coordinates[1:-1] * own[0])])
        np.testing.assert_allclose(moved, expected, atol=1e-6 * max(1, np.abs(expected).max()))


def test_outside_its_chart_a_state_is_refused():
    form = system_class("car")().chained_form(np.zeros(4))
    with pytest.raises(InvalidProblemError, match="outside the chart"):
        form.to_chained([0, 0, 2.0, 0])


def test_trailers_off_the_axle_have_none():
    assert (
        system_class("car_with_trailers")(lengths=[1], hitch_offsets=[0.2]).chained_form(np.zeros(4)) is None
    )


@pytest.mark.parametrize(("k", "known"), [(1, 0.0724154991), (2, 0.0037457175), (3, None)])
def test_sinusoids_move_one_number(k, known):
    """u1 = a sin ωt, u2 = b cos kωt: (a/2ω)^k (b/k!) (2π/ω) in x_{k+2}, and what is below comes back."""
    a, b, omega = 1.3, 0.7, 2 * pi
    system = system_class("chained")(n=k + 2)
    path = solve_ivp(
        lambda t, x: np.asarray(
            system.rate(x, np.array([a * np.sin(omega * t), b * np.cos(k * omega * t)]))
        ).ravel(),
        (0, 1),
        np.zeros(k + 2),
        rtol=1e-12,
        atol=1e-13,
    )
    expected = (a / (2 * omega)) ** k * b / factorial(k) * 2 * pi / omega
    np.testing.assert_allclose(path.y[:-1, -1], 0, atol=1e-10)
    assert path.y[-1, -1] == pytest.approx(expected, abs=1e-10)
    if known:
        assert expected == pytest.approx(known, abs=1e-10)
