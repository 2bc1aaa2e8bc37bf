"""A Runge–Kutta scheme is data: its order shows in every text that is made of it, CasADi's and C's."""

from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest

from nhpocp import provenance
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.compiled import kernel_build
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.shot import Shot, part
from nhpocp.flow.tableau import CLASSICAL, Tableau

HEUN = Tableau(2, (0.0, 1.0), (0, 1), ((), (1.0,)), (1.0, 1.0))
KUTTA = Tableau(3, (0.0, 0.5, 1.0), (0, 1, 2), ((), (0.5,), (-1.0, 2.0)), (1.0, 4.0, 1.0))
THREE_EIGHTHS = Tableau(
    4,
    (0.0, 1 / 3, 2 / 3, 1.0),
    (0, 1, 2, 3),
    ((), (1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)),
    (1.0, 3.0, 3.0, 1.0),
)
TABLEAUS = {"Heun": HEUN, "Kutta": KUTTA, "3/8": THREE_EIGHTHS}
STEPS = (20, 40, 80)
START = np.array([0.9, 0.4])
CONTROLS = np.random.default_rng(3).normal(0.0, 0.6, (9, 1, 5))  # of so many no error vanishes by chance
COEFFICIENTS = CONTROLS[8]


@pytest.fixture(params=TABLEAUS, autouse=True)
def tableau(request, tmp_path, monkeypatch) -> Tableau:
    monkeypatch.setenv("NHPOCP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(kernel_build, "FLAGS", (("-O0", "-fPIC", "-shared"),))
    return TABLEAUS[request.param]


@pytest.fixture(params=[Interpreted(), Compiled()], ids=["interpreted", "compiled"])
def way(request):
    if request.param == Compiled() and not provenance.c_compiler():
        pytest.skip("no C compiler")
    return request.param


def rate(y, u):
    return ca.vertcat(y[1] * u + ca.cos(y[0]), ca.sin(y[0] * y[1]) - u**2)


def dynamics() -> Dynamics:
    y, u = ca.SX.sym("y", 2), ca.SX.sym("u", 1)
    return Dynamics(ca.Function("rate", [y, u], [rate(y, u)]))


def orders(errors) -> np.ndarray:
    """As errors at `STEPS` have them."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def test_the_order_is_the_tableaus(tableau, way):
    def ended(scheme: Tableau, steps: int):
        flow = RungeKutta4(steps, way, scheme).flow(dynamics(), Fourier(2), 1.0)
        path, derivatives, _ = flow.sensitivity(START, COEFFICIENTS)
        ends = flow.ends(START, CONTROLS)
        np.testing.assert_allclose(ends.states[8], path[-1], atol=1e-13)
        np.testing.assert_allclose(ends.derivatives[8], derivatives[-1], atol=1e-12)
        return ends.states, ends.derivatives

    exact = ended(CLASSICAL, 1024)
    for reached, expected in zip(zip(*map(partial(ended, tableau), STEPS), strict=True), exact, strict=True):
        errors = [np.linalg.norm(value - expected) for value in reached]
        np.testing.assert_allclose(orders(errors), tableau.order, atol=0.3)


def test_a_step_is_differentiated_as_it_is(tableau, way):
    flow = RungeKutta4(5, way, tableau).flow(dynamics(), Fourier(2), 1.0)
    _, (derivative,), _ = flow.sensitivity(START, COEFFICIENTS)
    for column, change in enumerate(1e-5 * np.eye(5)):
        there, back = (flow.end(START, COEFFICIENTS + sign * change) for sign in (1, -1))
        np.testing.assert_allclose(derivative[:, column], (there - back) / 2e-5, atol=1e-8)


def shot(tableau: Tableau, steps: int) -> tuple[Shot, np.ndarray]:
    """One interval from y = z under u = s sin(3 t), and the parameters of one column."""
    z, y, s, h, phi = (ca.SX.sym(name, size) for name, size in zip("zyshf", (2, 2, 1, 1, 1), strict=True))
    first, others = (z, s, h, phi), (y, s, h, phi)
    made = Shot(
        part("opened", first, z),
        part("slope", others, h * rate(y, s * phi)),
        part("rows", others, y[0] * phi),
        part("closed", others, ca.vertcat(ca.dot(y, y), y)),
        np.where(np.arange(steps + 1) == steps // 2, 2, -1)[:, None],
        tableau,
    )
    knots = np.arange(steps)[:, None] + np.array(tableau.fractions)[:-1]
    return made, np.append(1.0 / steps, np.sin(3.0 * np.append(knots, steps) / steps))


def test_intervals_of_an_nlp_have_it_too(tableau, way):
    def outputs(scheme: Tableau, steps: int) -> np.ndarray:
        made, p = shot(scheme, steps)
        w = np.vstack([np.tile(START[:, None], 9), np.linspace(-1.0, 1.0, 9)])
        p = np.tile(p[:, None], 9)
        return np.array(way.shots(made, 9, lambda: (w.T, p.T)).value(w, p))

    exact = outputs(CLASSICAL, 512)
    errors = [np.linalg.norm(outputs(tableau, steps) - exact) for steps in STEPS]
    np.testing.assert_allclose(orders(errors), tableau.order, atol=0.3)


@pytest.mark.skipif(not provenance.c_compiler(), reason="no C compiler")
def test_second_derivatives_are_those_of_casadi(tableau):
    made, p = shot(tableau, 3)
    chance = np.random.default_rng(1)
    w, p = chance.normal(size=(3, 9)), np.tile(p[:, None], 9)
    weights = chance.normal(size=9), chance.normal(size=(3, 9))
    compiled, expected = (way.shots(made, 9, lambda: (w.T, p.T)) for way in (Compiled(), Interpreted()))
    assert type(compiled) is not type(expected)
    for name, given in (("gradient", ()), ("jacobian", ()), ("hessian", weights)):
        values = (
            getattr(shots, name)(w, p, *(np.atleast_2d(g) for g in given)) for shots in (compiled, expected)
        )
        for ours, casadis in zip(*(v if isinstance(v, tuple) else (v,) for v in values), strict=True):
            np.testing.assert_allclose(np.array(ours), np.array(casadis), atol=1e-10)


def test_a_kernel_is_of_one_tableau(tableau):
    from nhpocp.flow.compiled import shot_source, sweep_source
    from nhpocp.flow.compiled.c_functions import numbers_apart
    from nhpocp.flow.runge_kutta import scheme

    other = replace(tableau, weights=(*tableau.weights[:-1], 2.0))
    given = dynamics()
    (text, numbers), (_, others) = (
        numbers_apart(sweep_source.c_source(scheme(given, each))) for each in (tableau, other)
    )
    assert "NUMBERS[" in text
    assert list(numbers) != list(others)
    assert shot_source.identity(shot(tableau, 2)[0]) != shot_source.identity(shot(other, 2)[0])
