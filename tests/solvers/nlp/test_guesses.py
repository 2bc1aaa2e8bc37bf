"""What an NLP starts from."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation, Euler
from nhpocp.solvers.nlp.guesses import (
    NoGuessError,
    ProblemGuess,
    SolverGuess,
    StraightGuess,
    follow,
    make_guess,
)
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import PAPER_START, Integrators, Runaway, paper_problem, yaw

QUICK = SolverGuess(Continuation(step_rule=Euler(1.0)))


@pytest.mark.parametrize("maker", [ProblemGuess(), QUICK, StraightGuess()], ids=lambda maker: maker.kind)
@pytest.mark.parametrize("basis", [None, Fourier(3)])
def test_every_guess_is_a_path_of_the_system_over_the_wanted_basis(maker, basis, problem):
    guess = make_guess(maker, problem, basis, 10, 0)
    assert guess.states.shape == (11, 12)
    assert guess.control.basis == (basis or PiecewiseConstant(10))
    np.testing.assert_allclose(guess.states[0], problem.start_point)
    np.testing.assert_allclose(guess.states, follow(problem, guess.control, 10, 40), atol=1e-4)


def test_the_problems_guess_is_the_problems_control(problem):
    guess = make_guess(ProblemGuess(), problem, problem.basis, 10, 0)
    np.testing.assert_array_equal(guess.control.coefficients, PAPER_START)
    on_a_grid = make_guess(ProblemGuess(), problem, None, 200, 0).control
    middles = (np.arange(200) + 0.5) / 200
    np.testing.assert_allclose(on_a_grid(middles), guess.control(middles), atol=1e-3)
    np.testing.assert_allclose(
        on_a_grid.coefficients, project(guess.control, PiecewiseConstant(200)).coefficients, atol=1e-12
    )


def test_seeds_give_other_guesses_and_always_the_same_ones(problem):
    maker = ProblemGuess()
    first, again, other = (make_guess(maker, problem, None, 10, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.control.coefficients, again.control.coefficients)
    assert np.abs(first.control.coefficients - other.control.coefficients).max() > 0.1


def test_the_other_solvers_guess_ends_at_the_goal(problem):
    guess = make_guess(QUICK, problem, problem.basis, 50, 0)
    assert problem.goal_error(guess.states[-1]) < 1e-3


def test_a_straight_guess_follows_the_geodesic_as_well_as_the_system_can(problem):
    """Exactly where every direction is an input; else at each point the nearest velocity."""
    linear = PlanningProblem(system=Integrators(), start={"x": 0.0, "y": 0.0}, goal={"x": 1.0, "y": 2.0})
    guess = make_guess(StraightGuess(), linear, None, 4, 0)
    np.testing.assert_allclose(guess.states, np.linspace([0, 0], [1, 2], 5), atol=1e-12)
    control = StraightGuess(pieces=20).control(problem, 2.0, 0)
    space = problem.system.state_space
    tangent = space.difference(problem.goal_point, problem.start_point)
    for share in (0.025, 0.525):  # middles of pieces
        fields = problem.system.vector_fields(space.retract(problem.start_point, share * tangent))
        missed = fields @ control(2.0 * share)[0] - tangent / 2.0
        np.testing.assert_allclose(fields.T @ missed, 0, atol=1e-10)


@pytest.mark.parametrize(
    ("horizon", "expected"),
    [
        (Horizon(2.0), 2.0),
        (Horizon(None, 1.0, 3.0), 2.0),
        (Horizon(1.5, 1.0, 3.0), 1.5),
        (Horizon(None, 0.5, None), 0.5),
        (Horizon(None, None, 4.0), 4.0),
    ],
)
def test_a_free_horizon_starts_inside_its_range(horizon, expected):
    problem = paper_problem(horizon=horizon)
    assert problem.horizon.first == expected
    assert make_guess(ProblemGuess(), problem, None, 4, 0).control.horizon == expected
    assert make_guess(ProblemGuess(), problem, None, 4, 1).control.horizon == expected


def test_another_solver_is_given_the_horizon_to_hold():
    problem = paper_problem(horizon=Horizon(None, 0.5, 2.5))
    assert make_guess(QUICK, problem, None, 4, 0).control.horizon == 1.5


def singular_start():
    """Equal triangles, w4 normal, no yaw: every leg stands along its own w4, so det S = 0."""
    robot = ThreeUPU(10.0, 10.0, np.pi / 2, "normal")
    return paper_problem(system=robot, start={"position": [0, 0, 25], "orientation": yaw(0.0)})


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("maker", "problem", "outcome", "words"),
    [
        (ProblemGuess(), singular_start(), Outcome.NOT_FINITE, "not finite"),
        (StraightGuess(), singular_start(), Outcome.NOT_FINITE, "not finite|undefined"),
        (
            ProblemGuess(),
            PlanningProblem(system=Runaway(), start={"x": 1.0}, goal={"x": 2.0}, initial=[[5.0, 0, 0, 0, 0]]),
            Outcome.NOT_FINITE,
            "initial: straight",
        ),
        (
            StraightGuess(),
            paper_problem(goal={"position": [0, 0, 30], "orientation": yaw(np.pi * 5 / 6)}),
            Outcome.ORIENTATION_AT_PI,
            "half a turn",
        ),
        (
            ProblemGuess(),
            replace(singular_start(), initial=None),
            Outcome.NOT_FINITE,
            "one side of every singular surface",
        ),
    ],
    ids=["singular", "singular straight", "runaway", "half a turn", "no start"],
)
def test_a_guess_that_cannot_be_made_says_how_the_solve_ends(maker, problem, outcome, words):
    with pytest.raises(NoGuessError, match=words) as caught:
        make_guess(maker, problem, None, 10, 0)
    assert caught.value.outcome is outcome
    assert caught.value.path in ("control.initial", "solvers.nlp.initial")
