"""Least cost in the null space: closed forms, and the NLP over the same basis."""

import numpy as np
import pytest
from conftest import PAPER_START, paper_problem

from nhpocp import planning
from nhpocp.controls.fourier import Fourier
from nhpocp.solution import Outcome
from nhpocp.solvers.continuation import Continuation
from nhpocp.solvers.multiple_shooting import MultipleShooting
from nhpocp.solvers.null_space import minimise
from nhpocp.solvers.step_rules import Adaptive


def effort(y):
    return float(y @ y), 2 * y


def test_nearest_point_of_a_sphere():
    centre = np.array([3.0, -1.0, 2.0])
    found = minimise(
        lambda y: (np.array([(y - centre) @ (y - centre) - 1]), 2 * (y - centre)[None]),
        effort,
        centre + np.array([0, 1.0, 0]),
    )
    assert found.converged
    np.testing.assert_allclose(found.y, centre * (1 - 1 / np.linalg.norm(centre)), atol=1e-7)


def test_rosenbrock_on_a_circle():
    """A curved valley; the minimiser on |y|² = 2 is the free one, (1, 1)."""

    def cost(y):
        a, b = y[1] - y[0] ** 2, 1 - y[0]
        return float(100 * a * a + b * b), np.array([-400 * a * y[0] - 2 * b, 200 * a])

    found = minimise(lambda y: (np.array([y @ y - 2]), 2 * y[None]), cost, np.array([-1.0, 1.0]))
    assert found.cost < 4.01  # the other minimum of the circle, or better
    assert found.optimality < 1e-6


def test_unusable_points_are_stepped_back_from():
    """The half-plane y₀ ≤ 0.5 cannot be evaluated; the minimiser beyond it is not reached, the way to it is gone."""
    line = np.array([[0.0, 1.0]])
    found = minimise(
        lambda y: None if y[0] < 0.5 else (np.array([y[1] - 1]), line), effort, np.array([2.0, 1.0])
    )
    assert 0.5 <= found.y[0] < 0.6


@pytest.mark.parametrize(
    ("preset", "harmonics"),
    [("default", 1), ("default", 2), ("normal75", 3), ("paper_conjecture", 4), ("vertical_equal", 2)],
)
def test_equals_the_nlp_over_the_same_basis(preset, harmonics):
    basis = Fourier(harmonics)
    start = np.zeros((3, basis.size))
    start[:, : min(5, basis.size)] = PAPER_START[:, : min(5, basis.size)]
    problem = paper_problem(preset, basis=basis, initial=start)
    solution = Continuation(step_rule=Adaptive(), objective="effort").solve(problem)
    assert solution.outcome is Outcome.CONVERGED
    nlp = MultipleShooting(over_basis=True, intervals=30, steps_per_interval=3).solve(problem)
    assert solution.control.effort == pytest.approx(nlp.details["objective_value"], rel=1e-5)


@pytest.mark.parametrize("objective", ["leg_effort", "path_length"])
def test_other_objectives(objective):
    solution = planning.solve(
        paper_problem("normal75"), Continuation(step_rule=Adaptive(), objective=objective)
    )
    assert solution.converged
    assert solution.objective == objective
    nlp = MultipleShooting(over_basis=True, intervals=30, steps_per_interval=3).solve(
        paper_problem("normal75", objective=objective)
    )
    assert solution.costs[objective] == pytest.approx(nlp.details["objective_value"], rel=1e-5)


def test_the_goal_reached_is_kept_when_the_search_is_cut_short(problem):
    solver = Continuation(step_rule=Adaptive(), objective="effort", max_iterations=15)
    solution = planning.solve(problem, solver)
    assert solution.converged
    assert "max_iterations" in solution.message
