"""Least cost in the null space: closed forms, and the NLP over the same basis."""

import numpy as np
import pytest
from conftest import PAPER_START, paper_problem
from scipy.optimize import minimize

from nhpocp import planning
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.solution import Outcome
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.least_cost import curvature
from nhpocp.solvers.least_cost.augmented_lagrangian import rounds
from nhpocp.solvers.least_cost.null_space import NoSurfaceError, Penalty, minimise
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting


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
    assert (
        found.optimality < 1e-5
    )  # what is left to gain is below rounding: its square over a curvature of hundreds


def test_what_a_search_costs_is_linear_in_the_coefficients():
    """Six numbers, or each spread evenly over 10 000: the same steps. A matrix of the larger size would take 29 GB."""
    weights, start = np.array([1.0, 4.0, 9.0, 1.0, 4.0, 9.0]), np.array([0.3, 0.6, 1.0, 0.4, 0.5, 0.5])

    def search(part):
        def few(y):
            return y.reshape(6, part).sum(axis=1) / np.sqrt(part)

        def many(z):
            return np.repeat(z, part, axis=-1) / np.sqrt(part)

        def surface(y):
            z = few(y)
            slopes = np.array([2 * z + np.array([z[1], z[0], 0, 0, 0, 0]), np.eye(6)[5]])
            return np.array([z @ z + z[0] * z[1] - 2.0, z[5] - 0.5]), many(slopes)

        def cost(y):
            z = few(y)
            return float(weights @ z**2 + z[2] ** 4), many(2 * weights * z + 4 * z**3 * np.eye(6)[2])

        return minimise(surface, cost, many(start))

    dense, spread = search(1), search(10_000)
    assert dense.converged
    assert spread.converged
    assert spread.cost == pytest.approx(dense.cost, rel=1e-9)
    assert len(spread.history) == len(dense.history)


def test_a_model_that_knows_enough_forgets_what_differs_least():
    most = curvature.MOST
    true = np.exp(np.random.default_rng(0).uniform(-1.5, 3, 3 * most))  # of a diagonal matrix, 1 at first
    model = curvature.Curvature.first(1.0, len(true), full=False)
    for k in range(2 * most):
        step = np.eye(len(true))[k]
        model = model.updated(step, true * step)
    assert model.seen.shape == (len(true), most)
    kept = np.argsort(np.abs(np.log(true[: 2 * most])))[-most:]
    expected = np.ones(len(true))
    expected[kept] = true[kept]
    np.testing.assert_allclose(model @ np.eye(len(true)), np.diag(expected), atol=1e-9)


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
    assert "not at a stationary point" in solution.message


@pytest.mark.parametrize("objective", ["effort", "leg_effort", "path_length"])
@pytest.mark.parametrize("preset", ["default", "normal75"])
def test_the_gradient_of_every_cost(objective, preset):
    problem = paper_problem(preset)
    cost = cost_map(objective, problem, problem.basis, 1.0, RungeKutta4(30))
    step = 1e-6
    for direction in np.random.default_rng(1).normal(size=(3, 3, 5)):
        values = [cost(PAPER_START + sign * step * direction)[0] for sign in (1, -1)]
        slope = cost(PAPER_START)[1] @ direction.ravel()
        assert slope == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-6)


def test_there_must_be_a_control_that_reaches_the_goal():
    with pytest.raises(NoSurfaceError):
        minimise(lambda y: (np.array([1.0]), np.array([[1e-9, 0]])), effort, np.ones(2))


# --- inequalities ---------------------------------------------------------------------------------------------------


class Linear:
    """A y ≥ b; between its samples it lies lower by ``gap``."""

    def __init__(self, matrix, limits, gap=0.0):
        self.matrix, self.limits, self.gap = np.array(matrix, dtype=float), np.array(limits, dtype=float), gap

    def values(self, y):
        return self.matrix @ y - self.limits

    def slopes(self, y):
        return self.matrix

    def between(self, y):
        return self.values(y) - self.gap


def plane(y):
    """y0 + y1 + y2 = 3."""
    return np.array([y.sum() - 3.0]), np.ones((1, 3))


SETTINGS = {"scale": 3.0, "slack": 1e-9, "tolerance": 1e-9, "goal": 1e-10}


@pytest.mark.parametrize("seed", range(8))
def test_a_penalised_step_is_the_minimum_of_pieces(seed):
    """A convex quadratic cost and linear rows: one step of the model is the answer, whatever the weight."""
    random = np.random.default_rng(seed)
    matrix, limits, weight = random.normal(size=(30, 3)), random.normal(size=30), 10.0 ** random.uniform(0, 6)
    rows = Linear(matrix, limits)
    penalty = Penalty(rows.values, rows.slopes, np.zeros(30), weight)
    found = minimise(plane, effort, np.array([3.0, 0, 0]), penalty=penalty)
    assert found.converged
    assert len(found.history) <= 5

    def merit(y):
        return y @ y + 0.5 * weight * np.sum(np.maximum(0, limits - matrix @ y) ** 2)

    best = minimize(
        lambda z: merit(np.array([z[0], z[1], 3 - z[0] - z[1]])), found.y[:2], tol=1e-12, method="Nelder-Mead"
    )
    assert merit(found.y) <= best.fun * (1 + 1e-9)


def test_the_gradient_of_the_penalty():
    """What `optimality` reports is the projected slope of cost and penalty together."""
    rows = Linear([[1, 0, 0], [0, 1, -1]], [2.0, 0.5])
    penalty = Penalty(rows.values, rows.slopes, np.array([0.1, 0.0]), 50.0)
    start = np.array([0.5, 1.5, 1.0])
    found = minimise(plane, effort, start, penalty=penalty, most=1)

    def merit(y):
        return y @ y + 25.0 * np.sum(np.maximum(0, penalty.shift - rows.values(y)) ** 2)

    step = 1e-6 * np.eye(3)
    gradient = np.array([merit(start + d) - merit(start - d) for d in step]) / 2e-6
    assert found.history[0]["optimality"] == pytest.approx(
        np.linalg.norm(gradient - gradient.mean()), rel=1e-6
    )


@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_the_method_of_multipliers_ends_on_the_bound(gap):
    """Nearest point of the plane with y0 ≥ 2 (and the path between the samples lower by the gap): by symmetry."""
    *_, last = rounds(plane, effort, Linear([[1, 0, 0]], [2.0], gap), np.array([1.0, 2, 0]), **SETTINGS)
    assert last.settled
    first = 2.0 + gap
    np.testing.assert_allclose(last.found.y, [first, (3 - first) / 2, (3 - first) / 2], atol=3e-4)
    assert last.found.y[0] >= first - 1e-8


def test_a_bound_that_does_not_press_is_not_felt():
    *_, last = rounds(plane, effort, Linear([[1, 0, 0]], [-5.0]), np.array([1.0, 2, 0]), **SETTINGS)
    assert last.settled
    np.testing.assert_allclose(last.found.y, [1, 1, 1], atol=1e-6)


def test_bounds_that_contradict_each_other_end_the_rounds():
    *others, last = rounds(
        plane, effort, Linear([[1, 0, 0], [-1, 0, 0]], [2.0, -1.0]), np.array([1.0, 2, 0]), **SETTINGS
    )
    assert not last.settled
    assert last.least == pytest.approx(-0.5, abs=1e-3)  # midway: both are missed by as much
    assert len(others) < 8
