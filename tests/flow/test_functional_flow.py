"""The Λ-flow (16) over finer and finer piecewise-constant controls tends to the functional flow (14)."""

import numpy as np
import pytest
from functional_flow import (
    coefficient_flow,
    distance,
    distance_of_means,
    functional_direction,
    functional_flow,
)

from nhpocp.flow.end_point_map import VariationalEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from tests.conftest import paper_problem


def test_the_functional_direction_moves_the_end_point_by_minus_e():
    problem = paper_problem()
    times = np.linspace(0, 1, 401)
    values = problem.control(problem.initial)(times)
    direction = functional_direction(problem, times, values)
    variational = VariationalEndPointMap(
        problem.system, problem.basis, 1.0, problem.start_point, RungeKutta4(400)
    )
    end, gram = variational(problem.initial), variational.gram(problem.initial)
    # ∫ |δv|² = eᵀ D⁻¹ e, with D from the differential equation of the library, not by the script's adjoints
    e = problem.tasks[-1].difference(end.state)
    cost = np.trapezoid(np.sum(direction**2, axis=1), times)
    assert cost == pytest.approx(e @ np.linalg.solve(gram, e), rel=1e-4)


def test_finer_piecewise_constant_controls_tend_to_the_functional_flow():
    problem = paper_problem()
    times, values = functional_flow(problem, steps=160)
    found = {intervals: coefficient_flow(problem, intervals) for intervals in (10, 20, 40)}
    apart = [distance(control, times, values) for control in found.values()]
    of_means = [distance_of_means(control, times, values) for control in found.values()]
    assert apart[-1] < 0.05
    assert of_means[-1] < 0.004
    assert np.all(np.log2(np.divide(apart[:-1], apart[1:])) > 0.95)  # order 1, as a staircase can
    assert np.all(np.log2(np.divide(of_means[:-1], of_means[1:])) > 1.9)  # its steps are right to order 2
