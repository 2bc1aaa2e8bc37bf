"""Laws of the inverses and metrics."""

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, RungeKutta4
from nhpocp.flow.variational import VariationalEquations
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.end_point_error import EndPointError
from nhpocp.solvers.continuation.evaluation import Evaluator
from nhpocp.solvers.continuation.generalized_inverses import Damped, Lagrangian, MoorePenrose, Transpose
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.metrics import CoefficientMetric, Coordinates, L2Metric, WeightedMetric
from nhpocp.via import Via
from tests.conftest import paper_problem

RANDOM = np.random.default_rng(3)
JACOBIAN, ERROR = RANDOM.normal(size=(6, 15)), RANDOM.normal(size=6)


METRICS = [
    CoefficientMetric(),
    L2Metric(),
    WeightedMetric([1, 2, 3]),
    WeightedMetric([[2, 1, 0], [1, 2, 0], [0, 0, 1]]),
]


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.kind)
def test_step_solves_the_linear_equation_and_is_shortest_in_the_metric(metric):
    factor = metric.factor(Fourier(2), 3, 1.7)
    found = MoorePenrose()(JACOBIAN, ERROR, Coordinates(factor))
    np.testing.assert_allclose(JACOBIAN @ found.step, -ERROR, atol=1e-12)
    assert found.rank == 6
    null = np.linalg.svd(JACOBIAN)[2][6:]
    np.testing.assert_allclose(null @ (factor @ factor.T) @ found.step, 0, atol=1e-12)


def test_coefficient_metric_is_the_pseudo_inverse():
    found = MoorePenrose()(JACOBIAN, ERROR, Coordinates(CoefficientMetric().factor(Fourier(2), 3, 1.0)))
    np.testing.assert_allclose(found.step, -np.linalg.pinv(JACOBIAN) @ ERROR, atol=1e-12)


def test_l2_metric_measures_the_effort():
    basis, coefficients = Fourier(2), RANDOM.normal(size=(3, 5))
    factor = L2Metric().factor(basis, 3, 2.0)
    times = np.linspace(0, 2.0, 20001)
    values = basis.table(times, 2.0) @ coefficients.T
    assert np.sum((factor.T @ coefficients.ravel()) ** 2) == pytest.approx(
        np.trapezoid(np.sum(values**2, 1), times)
    )


@pytest.mark.parametrize("rank", range(6))
def test_rank_is_found_and_the_rest_left_alone(rank):
    left, right = RANDOM.normal(size=(6, rank)), RANDOM.normal(size=(rank, 15))
    found = MoorePenrose()(left @ right, ERROR, Coordinates(np.eye(15)))
    assert found.rank == rank
    np.testing.assert_allclose(found.step, -np.linalg.pinv(left @ right, rcond=1e-8) @ ERROR, atol=1e-9)


def test_damped_is_moore_penrose_away_from_singularity():
    factor = L2Metric().factor(Fourier(2), 3, 1.0)
    assert np.linalg.cond(np.linalg.solve(factor, JACOBIAN.T)) < 50
    np.testing.assert_allclose(
        Damped()(JACOBIAN, ERROR, Coordinates(factor)).step,
        MoorePenrose()(JACOBIAN, ERROR, Coordinates(factor)).step,
    )


def test_damped_stays_bounded_where_moore_penrose_does_not():
    left, _, right = np.linalg.svd(JACOBIAN, full_matrices=False)
    for least in (1e-3, 1e-6, 0.0):
        nearly = left @ np.diag([3, 2, 2, 1, 1, least]) @ right
        found = Damped()(nearly, ERROR, Coordinates(np.eye(15)))
        assert np.linalg.norm(found.step) < 0.5 / (0.02 * 3) * np.linalg.norm(ERROR) + np.linalg.norm(ERROR)
        assert not found.blocked
    assert (
        np.linalg.norm(
            MoorePenrose()(left @ np.diag([3, 2, 2, 1, 1, 1e-3]) @ right, ERROR, Coordinates(np.eye(15))).step
        )
        > 100
    )


def test_transpose_is_the_best_step_along_steepest_descent():
    found = Transpose()(JACOBIAN, ERROR, Coordinates(np.eye(15)))
    np.testing.assert_allclose(np.cross(found.step[:3], (JACOBIAN.T @ ERROR)[:3]), 0, atol=1e-12)
    at = lambda share: np.linalg.norm(ERROR + share * JACOBIAN @ found.step)  # noqa: E731
    assert at(1.0) < min(at(0.9), at(1.1), at(0.0))


def test_weighted_metric_weighs_the_effort_of_each_input():
    basis, coefficients = Fourier(2), RANDOM.normal(size=(3, 5))
    R = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 3.0]])
    times = np.linspace(0, 2.0, 20001)
    values = basis.table(times, 2.0) @ coefficients.T
    factor = WeightedMetric(R).factor(basis, 3, 2.0)
    weighed = np.trapezoid(np.einsum("ki,ij,kj->k", values, R, values), times)
    assert np.sum((factor.T @ coefficients.ravel()) ** 2) == pytest.approx(weighed)
    plain = L2Metric().factor(basis, 3, 2.0)
    np.testing.assert_allclose(WeightedMetric(1.0).factor(basis, 3, 2.0), plain, atol=1e-14)


@pytest.mark.parametrize(
    "weights", [[1, 2], [1, 1, -1], 0.0, np.ones((3, 2)), [[1, 2, 0], [0, 1, 0], [0, 0, 1]]]
)
def test_weights_that_are_no_metric_are_refused(weights):
    with pytest.raises(InvalidProblemError, match="weights"):
        WeightedMetric(weights).factor(Fourier(1), 3, 1.0)


# --- the Lagrangian inverse ---------------------------------------------------------------------------------


def evaluated(problem, inverse, factory=DifferentiatedEndPointMap, integrator=None):
    """The evaluation of a problem's own start, and J and e there."""
    shares = [task.share for task in problem.tasks[:-1]]
    end_point_map = factory(
        problem.system,
        problem.basis,
        1.0,
        problem.start_point,
        integrator or RungeKutta4(200),
        shares,
        along=inverse.looks_along,
    )
    factor = L2Metric().factor(problem.basis, 3, 1.0)
    found = Evaluator(problem, end_point_map, inverse, Coordinates(factor))(problem.initial)
    return found, EndPointError(problem, found.end)


Q = np.diag([1.0, 1.0, 4.0, 0.0, 0.5, 0.5])
R = np.diag([1.0, 2.0, 0.5])


@pytest.mark.parametrize("via", [(), [Via(0.37, {"position": [0, 0, 30]})]], ids=["goal", "via"])
def test_lagrangian_step_is_the_minimiser_of_its_integral(via):
    """Against the optimality conditions of the dense quadratic programme, made from (11)-(12) on a finer grid."""
    problem = paper_problem("normal75", via=via)
    found, residual = evaluated(problem, Lagrangian(Q, R))
    equations = VariationalEquations(problem.system, problem.basis, 1.0, RungeKutta4(800))
    _, M, _ = equations.states(problem.start_point, problem.initial)
    M = M / np.array([problem.scale] * 3 + [1.0] * 3)[:, None]
    times = np.linspace(0, 1, 801)
    P = np.einsum("ij,kf->kijf", np.eye(3), problem.basis.table(times, 1.0)).reshape(801, 3, -1)
    integrand = np.einsum("kia,ij,kjb->kab", M, Q, M) + np.einsum("kia,ij,kjb->kab", P, R, P)
    W = np.trapezoid(integrand, times, axis=0)
    J, e = residual.jacobian, found.residual
    conditions = np.block([[W, J.T], [J, np.zeros((len(e), len(e)))]])
    exact = np.linalg.solve(conditions, np.concatenate([np.zeros(15), -e]))[:15]
    step = found.direction.step
    np.testing.assert_allclose(J @ step, -e, atol=1e-11)
    np.testing.assert_allclose(step, exact, atol=1e-4 * np.abs(exact).max())
    null = np.linalg.svd(J)[2][len(e) :]
    for direction in null:
        for size in (-0.1, 0.1):
            other = step + size * direction
            assert other @ W @ other > step @ W @ step


def test_lagrangian_without_state_weight_is_moore_penrose_in_the_l2_metric():
    problem = paper_problem()
    plain, _ = evaluated(problem, MoorePenrose())
    found, _ = evaluated(problem, Lagrangian(state_weight=0.0))
    assert plain.end.variations is None
    np.testing.assert_allclose(found.direction.step, plain.direction.step, atol=1e-12)
    weighed, _ = evaluated(problem, Lagrangian())
    assert np.abs(weighed.direction.step - plain.direction.step).max() > 0.01


@pytest.mark.parametrize(
    ("factory", "integrator"),
    [(VariationalEndPointMap, RungeKutta4(200)), (DifferentiatedEndPointMap, CasadiRungeKutta(steps=200))],
)
def test_every_end_point_map_gives_the_same_lagrangian_step(factory, integrator):
    problem = paper_problem()
    one, _ = evaluated(problem, Lagrangian())
    other, _ = evaluated(problem, Lagrangian(), factory, integrator)
    np.testing.assert_allclose(other.direction.step, one.direction.step, atol=1e-6)


@pytest.mark.parametrize("preset", ["default", "normal75", "paper_conjecture", "vertical_equal"])
@pytest.mark.parametrize("rule", [Euler(1.0), Adaptive()], ids=lambda rule: rule.kind)
def test_lagrangian_reaches_the_goal(preset, rule):
    """(17) with γ = 1 runs `vertical_equal` into det S = 0 by either inverse; γ = 0.1 does not."""
    if preset == "vertical_equal" and isinstance(rule, Euler):
        rule = Euler(0.1)
    solution = planning.solve(paper_problem(preset), Continuation(step_rule=rule, inverse=Lagrangian()))
    assert solution.converged, solution.message


@pytest.mark.parametrize("basis", [Fourier(2), BSpline(3, 4)], ids=lambda basis: basis.kind)
@pytest.mark.parametrize(
    "metric", [CoefficientMetric(), L2Metric(), WeightedMetric([[2, 1, 0], [1, 2, 0], [0, 0, 1]])]
)
def test_coordinates_need_no_matrix_of_all_coefficients(metric, basis):
    """L is a product of a small matrix and a Gram matrix's root; so are the coordinates of single and many vectors."""
    sizes, random = np.array([2.0, 0.5, 1.0]), np.random.default_rng(0)
    found = Coordinates.natural(metric, basis, sizes, 1.7)
    units = np.repeat(np.broadcast_to(metric.unit(sizes, 1.7), 3), basis.size)
    full = Coordinates(metric.factor(basis, 3, 1.7) / units[:, None])
    rows, columns = random.normal(size=(2, 4, 3 * basis.size)), random.normal(size=(3 * basis.size, 2))
    np.testing.assert_allclose(found.jacobian(rows), full.jacobian(rows), rtol=1e-9, atol=1e-9)
    for vectors in (columns, columns[:, 0]):
        np.testing.assert_allclose(found.of(vectors), full.of(vectors), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            found.coefficients(vectors), full.coefficients(vectors), rtol=1e-9, atol=1e-9
        )
    assert found.length(columns[:, 0]) == pytest.approx(full.length(columns[:, 0]))
