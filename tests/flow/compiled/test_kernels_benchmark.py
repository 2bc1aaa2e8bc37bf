"""The hot functions under pytest-benchmark; each runs once unless asked: pytest -n0 --benchmark-enable TESTS."""

import end_points as jacobians
import numpy as np
import pytest
from goals import paper_task

from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler


@pytest.fixture(scope="module")
def exact():
    """The position rows, which every way has, of the plain Jacobian."""
    return jacobians.plain(2, 100)(jacobians.coefficients(2))[:3]


@pytest.mark.parametrize("name", jacobians.ways(2))
def test_end_point_and_jacobian(benchmark, exact, name):
    way, given = jacobians.ways(2)[name](), jacobians.coefficients(2)
    found = benchmark(way, given)
    np.testing.assert_allclose(found[:3], exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("harmonics", [2, 50])
def test_the_kernel_at_500_steps(benchmark, harmonics):
    way, given = jacobians.ways(harmonics, 500)["rk4, compiled"](), jacobians.coefficients(harmonics)
    found = benchmark(way, given)
    assert found.shape == (6, 3 * (2 * harmonics + 1))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("kernels", [Compiled(), Interpreted()], ids=["compiled", "interpreted"])
def test_a_continuation(benchmark, kernels):
    solver = Continuation(step_rule=Euler(1.0), integrator=RungeKutta4(kernels=kernels))
    solution = benchmark(solver.solve, paper_task("default"))
    assert solution.outcome is Outcome.CONVERGED
    assert solution.control.effort == pytest.approx(3.5093, abs=1e-3)  # (17) at γ = 1


@pytest.mark.parametrize("kernels", [Compiled(), Interpreted()], ids=["compiled", "interpreted"])
def test_the_ends_of_64_controls(benchmark, kernels):
    problem = paper_task("default")
    flow = RungeKutta4(kernels=kernels).flow(dynamics(problem.system), problem.basis, 1.0)
    noise = np.random.default_rng(0).normal(0.0, 0.1, (64, *problem.initial.shape))
    found = benchmark(flow.ends, problem.start_point, problem.initial + noise)
    assert found.derivatives.shape == (64, 6, 15)
    np.testing.assert_allclose(
        found.states[7], flow.end(problem.start_point, problem.initial + noise[7]), atol=1e-12
    )
