"""Laws that every control basis keeps."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import planning
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
NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)


def pieces(basis, horizon, first=0.0, last=None):
    """Gauss-Legendre times and weights on the smooth pieces between two times."""
    last = horizon if last is None else last
    inner = basis.breakpoints(horizon)
    knots = np.concatenate([[first], inner[(inner > first) & (inner < last)], [last]])
    middles, halves = 0.5 * (knots[1:] + knots[:-1])[:, None], 0.5 * np.diff(knots)[:, None]
    return (middles + halves * NODES).ravel(), (halves * WEIGHTS).ravel()


def apart_from_breakpoints(basis, share, horizon):
    """A time with room for a difference quotient on both sides."""
    time, corners = share * horizon, np.concatenate([[0.0], basis.breakpoints(horizon), [horizon]])
    nearest = corners[np.abs(corners - time).argmin()]
    if abs(time - nearest) < 1e-3 * horizon:
        time = nearest + (2e-3 if nearest < 0.5 * horizon else -2e-3) * horizon
    return time


@every_basis
@LAW
@given(horizon=horizons)
def test_gram_is_the_integral_of_products(basis, horizon):
    times, weights = pieces(basis, horizon)
    table = basis.table(times, horizon)
    np.testing.assert_allclose(
        basis.gram(horizon), table.T @ (weights[:, None] * table), rtol=0, atol=1e-12 * horizon
    )


@every_basis
def test_a_local_table_is_the_table(basis):
    times = np.sort(np.concatenate([np.linspace(0, 2.5, 31), basis.breakpoints(2.5)]))
    weights = np.random.default_rng(0).normal(size=(len(times), 3))
    for side in ("left", "right"):
        table, local = basis.table(times, 2.5, side), basis.local_table(times, 2.5, side)
        np.testing.assert_allclose(local.dense(), table, rtol=0, atol=1e-14)
        columns = np.arange(2.0 * basis.size).reshape(basis.size, 2)
        np.testing.assert_allclose(local @ columns, table @ columns, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(local.transposed(weights), table.T @ weights, rtol=0, atol=1e-12)


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


@every_basis
@LAW
@given(horizon=horizons, share=st.floats(0, 1))
def test_derivative_is_that_of_the_table(basis, horizon, share):
    time = apart_from_breakpoints(basis, share, horizon)
    step = 1e-4 * horizon
    offsets = step * np.array([-2.0, -1.0, 1.0, 2.0])
    differences = np.array([1.0, -8.0, 8.0, -1.0]) / 12 @ basis.table(time + offsets, horizon) / step
    found = basis.derivative_table(np.array([time]), horizon)[0]
    np.testing.assert_allclose(found, differences, rtol=0, atol=1e-7 * basis.size**2 / horizon)


@every_basis
@LAW
@given(horizon=horizons)
def test_one_sided_derivatives_at_a_breakpoint(basis, horizon):
    corners, step = basis.breakpoints(horizon), 1e-7 * horizon
    for side, beside in (("left", corners - step), ("right", corners + step)):
        found = basis.derivative_table(corners, horizon, side)
        near = basis.derivative_table(beside, horizon)
        np.testing.assert_allclose(found, near, rtol=0, atol=1e-4 * basis.size**2 / horizon)


@every_basis
def test_values_are_the_table_for_numbers_and_symbols(basis):
    times = np.array([apart_from_breakpoints(basis, share, 2.5) for share in np.linspace(0, 1, 23)])
    table = basis.table(times, 2.5)
    assert table.shape == (23, basis.size)
    assert len(basis.labels) == basis.size
    np.testing.assert_allclose([basis.values(time, 2.5) for time in times], table, rtol=0, atol=1e-13)
    for kind in (ca.SX, ca.MX):
        time = kind.sym("t")
        phi = ca.Function("phi", [time], [basis.values(time, 2.5)])
        found = [np.array(phi(time)).ravel() for time in times]
        np.testing.assert_allclose(found, table, rtol=0, atol=1e-13)


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


@every_basis
def test_a_file_holds_the_same_control(basis):
    control = Control(basis, np.random.default_rng(1).normal(size=(3, basis.size)), 2.5)
    again, times = control_from_json(control.to_json()), np.linspace(0, 2.5, 101)
    for side in ("left", "right"):
        np.testing.assert_allclose(again(times, side), control(times, side), rtol=0, atol=1e-13)
    assert again.effort == pytest.approx(control.effort, rel=1e-13)
    assert type(basis)(**basis.parameters()) == basis


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
