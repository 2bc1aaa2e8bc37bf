"""`initial: auto`: every regular system has a seeded start, over every basis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.initial_control import RANK, NoStartError, initial_coefficients, seeded_start
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.guesses import ProblemGuess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from tests import wheels
from tests.analysis.test_growth import Leaves
from tests.conftest import LIBRARY, PAPER_START, library_problem, paper_problem

REGISTERED = {
    problem.system.model: problem
    for problem in map(library_problem, reversed(LIBRARY))
    if "outcome" not in problem.reference.get("jacobian", {})
}
BASES = (
    Fourier(2),
    Legendre(5),
    BSpline(3, 8),
    PiecewiseConstant(10),
    PiecewiseConstant(30),
    PiecewiseConstant(100),
)
over_every_basis = pytest.mark.parametrize("basis", BASES, ids=lambda basis: f"{basis.kind}-{basis.size}")


def at_rest(system, **changes):
    origin = dict.fromkeys(system.state_space.names, 0.0)
    return PlanningProblem(system=system, start=origin, goal=origin, **changes)


def end_points(problem):
    return DifferentiatedEndPointMap(
        problem.system, problem.basis, problem.horizon.fixed, problem.start_point, RungeKutta4(100)
    )


def check_a_start(problem):
    """Of full rank, by the Jacobian of the state's own tangent numbers too, along a finite path."""
    the_map = end_points(problem)
    end = the_map(initial_coefficients(problem, the_map, 0))
    values = np.linalg.svd(end.jacobian, compute_uv=False)
    assert np.isfinite(end.path).all()
    assert len(values) == problem.system.state_space.dimension
    assert values[-1] > RANK * values[0]


def test_every_registered_system_is_tried():
    assert set(REGISTERED) == set(SYSTEMS)


@over_every_basis
@pytest.mark.parametrize("model", SYSTEMS)
def test_every_registered_system_has_a_start_over_every_basis(model, basis):
    check_a_start(replace(REGISTERED[model], basis=basis, initial=None))


@over_every_basis
@pytest.mark.parametrize("system", wheels.EVERY, ids=lambda s: f"{s.model}-{s.state_space.size}")
def test_so_have_systems_whose_brackets_go_deep(system, basis):
    check_a_start(at_rest(system, basis=basis))


def test_the_first_draw_is_the_same_for_the_same_seed():
    problem = paper_problem(initial=None)
    first, again, other = (seeded_start(problem, end_points(problem), seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.coefficients, again.coefficients)
    assert np.abs(first.coefficients - other.coefficients).max() > 0.1


def test_a_given_start_is_taken_as_it_is():
    problem = paper_problem()
    np.testing.assert_array_equal(initial_coefficients(problem, end_points(problem), 0), PAPER_START)


def test_what_has_no_rank_is_called_badly_conditioned_by_how_much():
    """Involutive fields: no control moves the end point in every direction, and no word says that the start is bad."""
    problem = at_rest(Leaves())
    with pytest.raises(
        NoStartError, match=r"σ_min/σ_max = \S+, lengths divided by 1, and below 1e-06"
    ) as caught:
        initial_coefficients(problem, end_points(problem), 0)
    assert "singular, or" not in str(caught.value)


def test_too_few_functions_are_counted():
    problem = paper_problem(initial=None, basis=Fourier(0))
    with pytest.raises(NoStartError, match="1 functions per input make 3 numbers, and 6 have to be met"):
        initial_coefficients(problem, end_points(problem), 0)


@pytest.mark.parametrize("system", [Leaves(), wheels.Cartan()], ids=lambda system: system.model)
def test_an_nlp_begins_without_full_rank(system):
    """The problem's basis is too small, or no basis is enough; intervals of the NLP's own are another matter."""
    problem = at_rest(system, basis=Fourier(0))
    guess = ProblemGuess().control(problem, 1.0, 0)
    assert np.isfinite(guess.coefficients).all()
    assert np.abs(guess.coefficients).max() > 0


def test_an_nlp_reaches_what_is_reachable_from_a_start_without_rank():
    """Leaves z - y²/2 = const of an involutive system: the goal lies on the start's."""
    start, goal = {"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 1.0}
    problem = PlanningProblem(system=Leaves(), start=start, goal=goal, basis=Fourier(0))
    solution = planning.solve(problem, MultipleShooting(intervals=8))
    assert solution.converged, solution.message
    assert solution.costs["effort"] == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(
    "basis",
    [PiecewiseConstant(30), PiecewiseConstant(100), BSpline(3, 8), Legendre(5)],
    ids=lambda basis: f"{basis.kind}-{basis.size}",
)
def test_a_sphere_is_turned_on_the_spot_over_every_basis(basis):
    problem = replace(REGISTERED["rolling_sphere"], basis=basis, initial=None)
    solution = planning.solve(problem, Continuation(step_rule=Adaptive()))
    assert solution.converged, solution.message
    assert solution.outcome is Outcome.CONVERGED
