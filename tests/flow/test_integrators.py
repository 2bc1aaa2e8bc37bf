"""Laws of every integrator: order, agreement, exact derivatives."""

import casadi as ca
import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier
from nhpocp.flow.dynamics import Dynamics, dynamics
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4, uniform_grid
from nhpocp.flow.runge_kutta import runge_kutta_step
from nhpocp.systems.numeric import NumericSystem
from tests.conftest import PAPER_START

INTEGRATORS = [RungeKutta4(), CasadiRungeKutta(), Cvodes()]


@pytest.fixture(params=INTEGRATORS, ids=lambda integrator: integrator.kind)
def integrator(request):
    return request.param


def rate_of(problem):
    return NumericSystem(problem.system).rate_function


def test_end_is_last_state_and_first_state_is_start(integrator, problem):
    flow = integrator.flow(Dynamics(rate_of(problem)), problem.basis, 1.0)
    states = flow.states(problem.start_point, PAPER_START)
    assert states.shape == (len(flow.times), 12)
    np.testing.assert_array_equal(states[0], problem.start_point)
    np.testing.assert_allclose(flow.end(problem.start_point, PAPER_START), states[-1], atol=1e-8)


def test_integrators_agree(problem):
    ends = [
        i.flow(Dynamics(rate_of(problem)), problem.basis, 1.0).end(problem.start_point, PAPER_START)
        for i in INTEGRATORS
    ]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-12)  # the same scheme
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-7)


def test_runge_kutta_has_order_four_and_the_known_errors(problem):
    """[physics §2]: end-point error at Λ0 with N = 50, 100, 200 steps."""
    exact = (
        RungeKutta4(1600)
        .flow(Dynamics(rate_of(problem)), problem.basis, 1.0)
        .end(problem.start_point, PAPER_START)
    )
    errors = []
    for steps in (50, 100, 200):
        end = (
            RungeKutta4(steps)
            .flow(Dynamics(rate_of(problem)), problem.basis, 1.0)
            .end(problem.start_point, PAPER_START)
        )
        errors.append(np.abs(end - exact).max())
    np.testing.assert_allclose(errors, [1.8e-7, 1.2e-8, 7.3e-10], rtol=0.1)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4, atol=0.15)


def test_the_ends_of_many_controls_are_those_of_each(integrator, problem):
    flow = integrator.flow(dynamics(problem.system), problem.basis, 1.0)
    controls = PAPER_START * np.array([1.0, 0.8])[:, None, None]
    found, bare = (flow.ends(problem.start_point, controls, way) for way in (True, False))
    for k, coefficients in enumerate(controls):
        path, derivatives, watched = flow.sensitivity(problem.start_point, coefficients)
        np.testing.assert_allclose(found.states[k], path[-1], atol=1e-12)
        np.testing.assert_allclose(bare.states[k], path[-1], atol=1e-8)
        np.testing.assert_allclose(found.derivatives[k], derivatives[-1], atol=1e-12)
        np.testing.assert_allclose(found.watched[k], watched, rtol=1e-12)
    assert not bare.derivatives.size


def test_sensitivity_is_the_derivative(integrator, problem):
    flow = integrator.flow(Dynamics(rate_of(problem)), problem.basis, 1.0)
    states, jacobian, _ = flow.sensitivity(problem.start_point, PAPER_START)
    np.testing.assert_allclose(states[-1], flow.end(problem.start_point, PAPER_START), atol=1e-9)
    step = 1e-4
    for column in (0, 3, 7, 14):
        change = np.zeros(15)
        change[column] = step
        there = flow.end(problem.start_point, PAPER_START + change.reshape(3, 5))
        back = flow.end(problem.start_point, PAPER_START - change.reshape(3, 5))
        np.testing.assert_allclose(jacobian[-1][:, column], (there - back) / (2 * step), atol=1e-5)


def test_sensitivity_at_stops_is_that_of_shorter_flows(integrator, problem):
    """dy/dλ half way through is what a flow that ends there would give."""
    flow = integrator.flow(Dynamics(rate_of(problem)), problem.basis, 1.0)
    half = int(np.abs(flow.times - 0.5).argmin())
    states, jacobians, _ = flow.sensitivity(problem.start_point, PAPER_START, (half, -1))
    assert jacobians.shape == (2, 12, 15)
    column, step = 7, 1e-4
    change = np.zeros(15)
    change[column] = step
    there, back = (flow.states(problem.start_point, PAPER_START + s * change.reshape(3, 5)) for s in (1, -1))
    differences = (there[[half, -1]] - back[[half, -1]]) / (2 * step)
    np.testing.assert_allclose(jacobians[:, :, column], differences, atol=1e-5)
    np.testing.assert_allclose(states[-1], flow.end(problem.start_point, PAPER_START), atol=1e-9)


def test_own_chain_equals_casadi_differentiating_the_whole(problem):
    """The stepwise chain rule against one `ca.jacobian` of all steps in one expression."""
    integrator = RungeKutta4(40)
    times = integrator.grid(problem.basis, 1.0)
    middles = 0.5 * (times[:-1] + times[1:])
    tables = [problem.basis.table(t, 1.0) for t in (times[:-1], middles, times[1:])]
    vector, end = ca.MX.sym("lambda", 15), ca.DM(problem.start_point)
    coefficients, step = ca.reshape(vector, 5, 3).T, runge_kutta_step(rate_of(problem))
    for h, *functions in zip(np.diff(times), *tables, strict=True):
        end = step(end, h, coefficients @ np.array(functions).T)
    whole = ca.Function("whole", [vector], [ca.jacobian(end, vector)])
    _, own, _ = integrator.flow(Dynamics(rate_of(problem)), problem.basis, 1.0).sensitivity(
        problem.start_point, PAPER_START
    )
    np.testing.assert_allclose(own[-1], np.array(whole(PAPER_START.ravel())), atol=1e-12)


def test_cvodes_is_right_where_parameters_outnumber_outputs(problem):
    """casadi#4383: 51 parameters, 12 outputs; CasADi would choose the adjoint, silently wrong here."""
    basis = Fourier(8)
    coefficients = np.pad(PAPER_START, ((0, 0), (0, basis.size - 5)))
    flows = [way.flow(Dynamics(rate_of(problem)), basis, 1.0) for way in (Cvodes(steps=2), RungeKutta4(800))]
    (_, jacobian, _), (_, exact, _) = (flow.sensitivity(problem.start_point, coefficients) for flow in flows)
    np.testing.assert_allclose(jacobian, exact, atol=1e-7 * np.abs(exact).max())


def test_grid_takes_in_breakpoints_once():
    np.testing.assert_allclose(
        uniform_grid(4, [0.3, 0.5 + 1e-14], 1.0), [0, 0.25, 0.3, 0.5, 0.75, 1.0], atol=1e-12
    )
