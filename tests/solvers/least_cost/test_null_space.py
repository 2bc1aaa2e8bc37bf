"""Least cost in the null space: closed forms, and the NLP over the same basis."""

from itertools import combinations

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.least_cost import curvature
from nhpocp.solvers.least_cost.null_space import NoSurfaceError, minimise
from nhpocp.solvers.least_cost.slsqp import BoundedProblem, Point, rounds
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from tests.conftest import PAPER_START, paper_problem


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
        found.stationarity < 1e-5
    )  # what is left to gain is below rounding: its square over a curvature of hundreds


def test_where_the_cost_is_infinite_no_control_is_used():
    """Walls price a path only when it reaches the goal; what is not clear then is refused there."""
    seen = []

    def cost(y):
        clear = y[0] > 0.5
        seen.append(clear)
        return (float(y @ y) if clear else np.inf), 2 * y

    found = minimise(
        lambda y: (y[1:] - 1.0, np.array([[0.0, 1.0]])), cost, np.array([3.0, 1.5]), tolerance=1e-6
    )
    assert not all(seen)
    assert not found.converged  # the least is beyond
    assert 0.5 < found.y[0] < 0.51
    with pytest.raises(NoSurfaceError):
        minimise(lambda y: (y[1:] - 1.0, np.array([[0.0, 1.0]])), cost, np.array([0.4, 1.0]))


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
    model = curvature.Curvature.first(1.0, len(true))
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


def test_a_point_beside_the_surface_from_which_none_leads_back_does_not_end_the_search():
    """Its model says that a step is good, and what it led to can neither be gone on from nor be brought back."""

    def surface(y):
        error = y[0] - 0.05 * np.sin(8.0 * y[1]) - 0.2 * y[1] ** 2
        slopes = [1.0, -0.4 * np.cos(8.0 * y[1]) - 0.4 * y[1]]
        return (np.array([error]), np.array([slopes])) if abs(y[0]) < 0.3 else None

    def cost(y):
        there = y - [0.0, 3.0]
        return float(there @ there), 2.0 * there

    ended = minimise(surface, cost, np.array([0.2 - 0.05 * np.sin(8.0), -1.0]))
    assert ended.y[0] == pytest.approx(0.3, abs=1e-3)  # where the usable ends
    assert ended.y[1] > 1.2
    assert ended.infeasibility < 1e-9


@pytest.mark.parametrize(
    ("preset", "harmonics"),
    [("default", 1), ("normal75", 3), ("paper_conjecture", 4), ("vertical_equal", 2)],
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


def on_a_plane(matrix, limits, gap=0.0):
    """|y|² on y0 + y1 + y2 = 3 within A y ≥ b; between its samples g lies lower by ``gap``."""
    matrix, limits = np.array(matrix, dtype=float), np.array(limits, dtype=float)

    def evaluate(y):
        return Point(np.array([y.sum() - 3.0]), np.ones((1, 3)), *effort(y), matrix @ y - limits)

    return BoundedProblem(evaluate, lambda y: matrix, lambda y: matrix @ y - limits - gap)


def last_round(problem, hessian=2.0):
    *_, last = rounds(problem, np.array([1.0, 2, 0]), hessian * np.eye(3), slack=1e-9, budget=Budget())
    return last


@pytest.mark.parametrize("seed", range(8))
def test_the_least_effort_within_linear_rows_is_that_of_an_active_set(seed):
    """By hand: of all sets of rows that press, the one whose stationary point keeps every row with κ ≥ 0."""
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(6, 3))
    limits = matrix @ np.array([2.0, 1.5, -0.5]) - random.uniform(0, 1, 6)
    last = last_round(on_a_plane(matrix, limits))
    assert last.converged
    assert last.least >= -1e-9
    assert last.stationarity < 1e-6
    costs = []
    for active in (subset for size in range(3) for subset in combinations(range(6), size)):
        rows = np.vstack([np.ones(3), matrix[list(active)]])
        multipliers = np.linalg.lstsq(rows @ rows.T, np.append(3.0, limits[list(active)]), rcond=None)[0]
        y = rows.T @ multipliers
        if (multipliers[1:] >= 0).all() and (matrix @ y - limits >= -1e-9).all():
            costs.append(y @ y)
    assert last.cost == pytest.approx(min(costs), rel=1e-7)


@pytest.mark.parametrize("gap", [0.0, 0.3])
@pytest.mark.parametrize("hessian", [2.0, 50.0, 0.1])
def test_the_search_ends_on_the_bound(gap, hessian):
    """Nearest point of the plane with y0 ≥ 2 (and the path between the samples lower by the gap): by symmetry."""
    last = last_round(on_a_plane([[1, 0, 0]], [2.0], gap), hessian)
    assert last.converged
    first = 2.0 + gap
    np.testing.assert_allclose(last.y, [first, (3 - first) / 2, (3 - first) / 2], atol=3e-4)
    assert last.y[0] >= first - 1e-8


def test_a_bound_that_does_not_press_is_not_felt():
    last = last_round(on_a_plane([[1, 0, 0]], [-5.0]))
    assert last.converged
    np.testing.assert_allclose(last.y, [1, 1, 1], atol=1e-6)


def test_a_right_model_of_the_hessian_leaves_one_step():
    assert last_round(on_a_plane([[1, 0, 0]], [2.0])).steps <= 2


def test_bounds_that_contradict_each_other_end_at_the_least_violation():
    last = last_round(on_a_plane([[1, 0, 0], [-1, 0, 0]], [2.0, -1.0]))
    assert last.least == pytest.approx(-0.5, abs=1e-3)  # midway: both are missed by as much


def test_unusable_points_are_stepped_back_from_within_bounds_too():
    """Beyond y0 = 1.9 nothing can be evaluated; the bound is at 2."""
    problem = on_a_plane([[1, 0, 0]], [2.0])
    usable = BoundedProblem(
        lambda y: problem.evaluate(y) if y[0] < 1.9 else None, problem.row_slopes, problem.between
    )
    for ended in rounds(usable, np.array([1.0, 2, 0]), 2.0 * np.eye(3), slack=1e-9, budget=Budget()):
        assert ended.y[0] < 1.9
    with pytest.raises(NoSurfaceError):
        next(rounds(usable, np.array([2.0, 1, 0]), 2.0 * np.eye(3), slack=1e-9, budget=Budget()))
