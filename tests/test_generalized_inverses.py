"""Laws of the inverses and metrics."""

import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier
from nhpocp.solvers.generalized_inverses import (
    CoefficientMetric,
    Damped,
    L2Metric,
    MoorePenrose,
    Transpose,
)

RANDOM = np.random.default_rng(3)
JACOBIAN, ERROR = RANDOM.normal(size=(6, 15)), RANDOM.normal(size=6)


@pytest.mark.parametrize("metric", [CoefficientMetric(), L2Metric()], ids=lambda metric: metric.kind)
def test_step_solves_the_linear_equation_and_is_shortest_in_the_metric(metric):
    factor = metric.factor(Fourier(2), 3, 1.7)
    found = MoorePenrose()(JACOBIAN, ERROR, factor)
    np.testing.assert_allclose(JACOBIAN @ found.step, -ERROR, atol=1e-12)
    assert found.rank == 6
    null = np.linalg.svd(JACOBIAN)[2][6:]
    np.testing.assert_allclose(null @ (factor @ factor.T) @ found.step, 0, atol=1e-12)


def test_coefficient_metric_is_the_pseudo_inverse():
    found = MoorePenrose()(JACOBIAN, ERROR, CoefficientMetric().factor(Fourier(2), 3, 1.0))
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
    found = MoorePenrose()(left @ right, ERROR, np.eye(15))
    assert found.rank == rank
    np.testing.assert_allclose(found.step, -np.linalg.pinv(left @ right, rcond=1e-8) @ ERROR, atol=1e-9)


def test_damped_is_moore_penrose_away_from_singularity():
    factor = L2Metric().factor(Fourier(2), 3, 1.0)
    assert np.linalg.cond(np.linalg.solve(factor, JACOBIAN.T)) < 50
    np.testing.assert_allclose(
        Damped()(JACOBIAN, ERROR, factor).step, MoorePenrose()(JACOBIAN, ERROR, factor).step
    )


def test_damped_stays_bounded_where_moore_penrose_does_not():
    left, _, right = np.linalg.svd(JACOBIAN, full_matrices=False)
    for least in (1e-3, 1e-6, 0.0):
        nearly = left @ np.diag([3, 2, 2, 1, 1, least]) @ right
        found = Damped()(nearly, ERROR, np.eye(15))
        assert np.linalg.norm(found.step) < 0.5 / (0.02 * 3) * np.linalg.norm(ERROR) + np.linalg.norm(ERROR)
        assert not found.blocked
    assert (
        np.linalg.norm(MoorePenrose()(left @ np.diag([3, 2, 2, 1, 1, 1e-3]) @ right, ERROR, np.eye(15)).step)
        > 100
    )


def test_transpose_is_the_best_step_along_steepest_descent():
    found = Transpose()(JACOBIAN, ERROR, np.eye(15))
    np.testing.assert_allclose(np.cross(found.step[:3], (JACOBIAN.T @ ERROR)[:3]), 0, atol=1e-12)
    at = lambda share: np.linalg.norm(ERROR + share * JACOBIAN @ found.step)  # noqa: E731
    assert at(1.0) < min(at(0.9), at(1.1), at(0.0))
