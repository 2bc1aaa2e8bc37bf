"""The end point's Jacobian and the agility ellipsoid: known ranks, closed forms, and laws of ellipsoids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.analysis.agility import Ellipsoid, end_point_analysis, velocities
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.problem_file.registry import system_class
from tests.conftest import PAPER_START, Integrators, Runaway, paper_problem

TOLERANCE = 1e-8
ONLY_YAW = np.array([[0.0] * 5, [0.0] * 5, [1.0, 0, 0, 0, 0]])


def of(problem, coefficients):
    control = Control(Fourier(2), coefficients)
    found = end_point_analysis(problem.system, control, problem.start_point, problem.scale, TOLERANCE)
    assert found is not None
    return found


@pytest.mark.parametrize(("coefficients", "rank"), [(0 * PAPER_START, 3), (ONLY_YAW, 5), (PAPER_START, 6)])
def test_ranks_of_the_papers_jacobian(coefficients, rank):
    """[physics §1]: 3 at Λ = 0, 5 with λ30 = 1 alone, 6 at Λ0."""
    found = of(paper_problem(), coefficients)
    assert found.jacobian.shape == (6, 15)
    assert found.spectrum.rank == rank
    assert not found.spectrum.doubtful
    assert np.isfinite(found.condition) == (rank == 6)


def test_the_jacobian_is_the_solvers_own_with_lengths_scaled():
    problem = paper_problem()
    own = DifferentiatedEndPointMap(problem.system, Fourier(2), 1.0, problem.start_point, RungeKutta4(200))
    expected = own(PAPER_START).jacobian / np.array([15.0] * 3 + [1.0] * 3)[:, None]
    np.testing.assert_allclose(of(problem, PAPER_START).jacobian, expected, atol=1e-6)


def test_straight_integrators_move_alike_in_every_direction():
    """ẋ = u: D = T · 1, so the semi-axes are √T and the dexterity is T."""
    system = Integrators()
    control = Control(Fourier(1), np.ones((2, 3)), 2.5)
    found = end_point_analysis(system, control, np.zeros(2), 1.0, TOLERANCE)
    np.testing.assert_allclose(found.agility.semi_axes, np.sqrt(2.5), rtol=1e-9)
    assert found.agility.volume == pytest.approx(2.5)
    np.testing.assert_allclose(found.agility.matrix, 2.5 * np.eye(2), atol=1e-9)


def test_heisenbergs_ellipsoid_without_control_is_flat():
    """At rest at (x, y) = 0 nothing moves z to first order."""
    system = system_class("heisenberg")()
    found = end_point_analysis(system, Control(Fourier(1), np.zeros((2, 3))), np.zeros(3), 1.0, TOLERANCE)
    np.testing.assert_allclose(found.agility.semi_axes, [1, 1, 0], atol=1e-7)
    assert found.spectrum.rank == 2
    assert found.agility.words(2) == "z"


def test_a_larger_basis_fills_the_ellipsoid():
    """J M⁻¹ Jᵀ, M the basis' Gram matrix, is what that basis sees of D: never more, and all of it in the limit."""
    problem, before = paper_problem(), None
    for harmonics in (2, 8, 24):
        coefficients = np.zeros((3, 2 * harmonics + 1))
        coefficients[:, :5] = PAPER_START
        control = Control(Fourier(harmonics), coefficients)
        found = end_point_analysis(problem.system, control, problem.start_point, problem.scale, TOLERANCE)
        weights = np.kron(np.eye(3), np.linalg.inv(control.basis.gram(1.0)))
        missing = found.agility.matrix - found.jacobian @ weights @ found.jacobian.T
        eigenvalues = np.linalg.eigvalsh(missing)
        assert eigenvalues[0] > -1e-9
        assert before is None or eigenvalues[-1] < 0.6 * before
        before = eigenvalues[-1]


def test_a_path_that_runs_away_has_no_end_point():
    control = Control(Fourier(0), np.array([[50.0]]))
    assert end_point_analysis(Runaway(), control, np.ones(1), 1.0, TOLERANCE) is None


def test_velocities_are_those_of_unit_controls():
    """The robot turns as fast as v says: three semi-axes are at least 1, the others 0."""
    problem = paper_problem()
    found = velocities(problem.system, problem.start_point, problem.scale)
    assert (found.semi_axes[:3] >= 1).all()
    np.testing.assert_allclose(found.semi_axes[3:], 0, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 8))
def test_an_ellipsoid_is_the_same_from_its_map_and_from_its_gram_matrix(seed, rows, columns):
    matrix = np.random.default_rng(seed).standard_normal((rows, columns))
    labels = tuple(f"c{i}" for i in range(rows))
    one, two = Ellipsoid.of_map(matrix, labels), Ellipsoid.of_gram(matrix @ matrix.T, labels)
    np.testing.assert_allclose(one.semi_axes, two.semi_axes, atol=1e-6)
    np.testing.assert_allclose(one.matrix, matrix @ matrix.T, atol=1e-10)
    np.testing.assert_allclose(one.axes.T @ one.axes, np.eye(rows), atol=1e-12)
    assert one.volume == pytest.approx(np.sqrt(max(np.linalg.det(matrix @ matrix.T), 0)), abs=1e-6)
    unit = np.linalg.lstsq(matrix, one.axes[:, 0] * one.semi_axes[0], rcond=None)[0]
    assert np.linalg.norm(unit) == pytest.approx(1.0)  # the longest axis is reached by one unit
