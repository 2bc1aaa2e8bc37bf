"""Laws that every control basis keeps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import planning
from nhpocp.arrays import namespace
from nhpocp.controls import samples
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.chebyshev import Chebyshev
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.controls.samples import Samples
from nhpocp.controls.sequence import SequenceBasis
from nhpocp.controls.table import Gram
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.simulation import simulate
from nhpocp.problem_file import control_from_json, dump_problem, parse_problem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.testing import check_basis
from nhpocp.testing.bases import LAWS, LAWS_OF_A_HORIZON, derivative_is_that_of_the_table
from tests.conftest import paper_problem

LAW = settings(max_examples=25, deadline=None, derandomize=True)
BASES = [
    Fourier(0),
    Fourier(3),
    Legendre(0),
    Legendre(1),
    Legendre(7),
    Chebyshev(0),
    Chebyshev(7),
    BSpline(0, 4),
    BSpline(1, 1),
    BSpline(1, 5),
    BSpline(2, 3),
    BSpline(3, 8),
    BSpline(5, 2),
    PiecewiseConstant(6),
    SequenceBasis((Fourier(1), BSpline(2, 3), Chebyshev(2)), (0.25, 0.45, 0.3)),
]
every_basis = pytest.mark.parametrize("basis", BASES, ids=lambda b: f"{b.kind}-{b.size}")
horizons = st.floats(0.05, 50.0)


@every_basis
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_holds(law, basis):
    law(basis)


@every_basis
@pytest.mark.parametrize("law", LAWS_OF_A_HORIZON, ids=lambda law: law.__name__)
@LAW
@given(horizon=horizons)
def test_a_law_holds_over_every_horizon(law, basis, horizon):
    law(basis, horizon)


@every_basis
@LAW
@given(horizon=horizons, share=st.floats(0, 1))
def test_derivative_is_that_of_the_table(basis, horizon, share):
    derivative_is_that_of_the_table(basis, horizon, share)


def test_the_laws_hold_over_the_horizons_that_a_plugin_is_tried_on():
    check_basis(Legendre(4))
    check_basis(BSpline(2, 3))
    with pytest.raises(InvalidProblemError, match="expected a basis"):
        check_basis(Legendre)


class WrongGram(Legendre):
    def gram(self, horizon):
        return 1.01 * np.asarray(super().gram(horizon))


class Flat(Legendre):
    def derivative_table(self, times, horizon, side="right"):
        return 0 * self.table(times, horizon, side)


class Numeric(Legendre):
    def values(self, time, horizon):
        return self.table(np.array([float(time)]), horizon)[0]


class Anonymous(Legendre):
    @property
    def labels(self):
        return ["P"] * self.size


class Twins(Legendre):
    def table(self, times, horizon, side="right"):
        return np.ones((len(times), self.size))

    def values(self, time, horizon):
        return namespace(time).vector([1.0] * self.size)

    def gram(self, horizon):
        return np.full((self.size, self.size), horizon)


class Sloppy(Legendre):
    def to_json(self, coefficients, horizon):
        return super().to_json(np.round(coefficients, 3), horizon)


BROKEN = {
    WrongGram: r"legendre over 0.05: gram is the integral of products: no. gram\(horizon\) is",
    Flat: "derivative is that of the table: no. derivative_table at t = ",
    Numeric: "values are the table for numbers and symbols",
    Anonymous: "labels are not distinct: P, P",
    Twins: "its functions are independent: no. the least eigenvalue",
    Sloppy: "a file holds the same control: no",
}


@pytest.mark.parametrize("broken", BROKEN)
def test_a_basis_that_breaks_a_law_is_told_which(broken):
    with pytest.raises(AssertionError, match=BROKEN[broken]):
        check_basis(broken(3))


@every_basis
def test_samples_are_the_same_in_slices(basis, monkeypatch):
    """Tables that are too large to be kept are made again, part by part."""
    times, left = np.linspace(0, 2.5, 31), np.arange(31) % 3 == 0
    coefficients, rows = np.ones((2, basis.size)), np.random.default_rng(0).normal(size=(31, 4))
    whole = Samples(basis, 2.5, times, left)
    monkeypatch.setattr(samples, "KEPT", 0)
    monkeypatch.setattr(samples, "SLICE", 40)
    sliced = Samples(basis, 2.5, times, left)
    for side, mine in (("left", left), ("right", ~left)):
        control = Control(basis, coefficients, 2.5)(times, side)
        np.testing.assert_allclose(whole.controls(coefficients)[mine], control[mine], atol=1e-13)
    np.testing.assert_allclose(sliced.controls(coefficients), whole.controls(coefficients), atol=1e-13)
    np.testing.assert_allclose(sliced.transposed(rows), whole.transposed(rows), atol=1e-12)
    np.testing.assert_allclose(sliced.dense(), whole.dense(), atol=1e-14)


@every_basis
def test_gram_matrices_are_solved_and_rooted_by_their_bands(basis):
    gram, columns = Gram.of(basis.gram(2.5)), np.random.default_rng(0).normal(size=(basis.size, 3))
    full = np.asarray(gram)
    root = np.linalg.cholesky(full)
    np.testing.assert_allclose(np.asarray(Gram.of(full)), full, atol=1e-15)
    np.testing.assert_allclose(gram @ columns, full @ columns, atol=1e-12)
    np.testing.assert_allclose(gram.solve(columns), np.linalg.solve(full, columns), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(gram.solve_root(columns), np.linalg.solve(root, columns), rtol=1e-9, atol=1e-9)
    back = np.linalg.solve(root.T, columns)
    np.testing.assert_allclose(gram.solve_root_transposed(columns), back, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(gram.root_transposed(columns), root.T @ columns, atol=1e-12)


@pytest.mark.parametrize("basis", [b for b in BASES if isinstance(b, BSpline | PiecewiseConstant)])
@LAW
@given(horizon=horizons, share=st.floats(0, 1))
def test_splines_are_a_partition_of_unity(basis, horizon, share):
    for side in ("left", "right"):
        (row,) = basis.table(np.array([share * horizon]), horizon, side)
        assert row.min() >= -1e-15
        assert row.sum() == pytest.approx(1.0, abs=1e-13)
    ends = basis.table(np.array([0.0, horizon]), horizon, "left")
    np.testing.assert_allclose(ends[[0, 1], [0, -1]], 1.0, rtol=0, atol=1e-13)


def test_knots_that_are_not_uniform_are_refused():
    data = Control(BSpline(2, 4), np.zeros((1, 6))).to_json()
    data["knots"][4] += 0.01
    with pytest.raises(InvalidProblemError, match="only equal intervals"):
        control_from_json(data)


def test_a_spline_of_degree_0_is_written_as_piecewise_constant():
    data = Control(BSpline(0, 3), [[1.0, 2.0, 3.0]], 1.5).to_json()
    assert data == {
        "basis": "piecewise_constant",
        "horizon": 1.5,
        "grid": [0.0, 0.5, 1.0, 1.5],
        "values": [[1.0], [2.0], [3.0]],
    }


@pytest.mark.parametrize("basis", [Legendre(4), BSpline(3, 6)], ids=lambda b: b.kind)
def test_both_solvers_reach_the_papers_goal(basis):
    problem = replace(paper_problem(), basis=basis, initial=None)
    start = project(paper_problem().control(paper_problem().initial), basis)
    problem = replace(problem, initial=start.coefficients)
    reached = planning.solve(problem, Continuation(step_rule=Adaptive(), objective="effort"))
    optimum = planning.solve(problem, MultipleShooting(over_basis=True, intervals=24, steps_per_interval=4))
    assert reached.converged
    assert optimum.converged
    # the same functions, so the same least effort, up to the integrations of either
    assert reached.costs["effort"] == pytest.approx(optimum.costs["effort"], rel=1e-4)


def verified(solution, control):
    """What verification says of another control in a solution's place, with the motion that it makes."""
    motion = simulate(solution.problem, control)
    claim = replace(
        solution, control=control, trajectory=motion.trajectory, costs=motion.costs, tolerance=1e-5
    )
    return planning.verify(claim)


def test_a_fourier_solution_carried_to_splines_still_verifies():
    solution = planning.solve(paper_problem(), Continuation(step_rule=Adaptive(), tolerance=1e-6))
    carried = project(solution.control, BSpline(5, 12))
    verdict = verified(solution, carried)
    assert verdict.ok, verdict.reasons
    # too few of them miss the goal, and verification says so
    coarse = project(solution.control, BSpline(1, 4))
    assert not verified(solution, coarse).ok


@pytest.mark.parametrize(
    "block", ["{basis: legendre, degree: 3}", "{basis: bspline, degree: 2, intervals: 4}"]
)
def test_a_problem_file_names_them(block):
    text = (
        "nhpocp: 1\nsystem: {model: three_upu}\nstart: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}\n"
        f"goal: {{position: [0, 0, 26]}}\ncontrol: {block}\n"
    )
    problem = parse_problem(text)
    assert problem.basis.kind in block
    assert parse_problem(dump_problem(problem)).basis == problem.basis
