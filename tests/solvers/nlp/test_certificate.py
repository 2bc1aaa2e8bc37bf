"""First-order optimality computed again, and multipliers against the change of the optimum."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp.constraints.bound import Bound
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.solvers.nlp.guesses import ProblemGuess, make_guess
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.kkt_residuals import kkt_residuals
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from tests.conftest import paper_problem

INTERVALS = 8


class Shifted:
    """A programme whose equations stand at something else than zero."""

    def __init__(self, programme, shift):
        self.size, self.functions, self.structure = programme.size, programme.functions, None
        self.nlp = programme.nlp
        self.lower, self.upper = programme.lower + shift, programme.upper + shift


def transcribed(bounds=()):
    problem = paper_problem(bounds=bounds)
    guess = make_guess(ProblemGuess(), problem, None, INTERVALS, 0)
    programme = StagedTranscription(problem, guess, None, INTERVALS, 1, bounds, Interpreted())
    return programme, Ipopt(1e-9).solve(programme, programme.pack(guess))


class Known:
    """A guess that is at hand."""

    kind = "known"

    def __init__(self, control):
        self._control = control

    def control(self, problem, horizon, seed):
        return self._control


@pytest.fixture(scope="module")
def solved():
    return transcribed()


@pytest.fixture(scope="module")
def bounded():
    return transcribed([Bound("leg_speed", "u", -33.0, 33.0), Bound("control", "v", -1.5, 2.0)])


def test_residuals_vanish_at_an_optimum_and_nowhere_else(solved, bounded):
    for programme, optimum in (solved, bounded):
        there = kkt_residuals(programme, optimum.x, optimum.multipliers)
        assert there["stationarity"] < 1e-7
        assert there["feasibility"] < 1e-8
        assert there["complementarity"] < 1e-6
        noise = np.random.default_rng(0).normal(size=len(optimum.x))
        away = kkt_residuals(programme, optimum.x + 1e-3 * noise, optimum.multipliers)
        assert away["stationarity"] > 1e-4
        assert away["feasibility"] > 1e-4
        other = kkt_residuals(programme, optimum.x, optimum.multipliers + 1e-3)
        assert other["stationarity"] > 1e-4
    assert np.abs(bounded[1].multipliers[[row.stated for row in bounded[0].rows]]).max() > 1e-3


def test_a_multiplier_on_a_slack_constraint_is_noticed(bounded):
    programme, optimum = bounded
    slack = next(
        i
        for i, row in enumerate(programme.rows)
        if row.stated and optimum.constraints[i] < programme.upper[i] - 0.1
    )
    multipliers = optimum.multipliers.copy()
    multipliers[slack] = 1.0
    assert kkt_residuals(programme, optimum.x, multipliers)["complementarity"] > 0.09


def test_multipliers_are_the_change_of_the_optimum(solved):
    """An equation g = ε changes the least objective by -λ ε, to first order: continuity, start and goal alike."""
    programme, optimum = solved
    rows = {row.name: i for i, row in enumerate(programme.rows)}
    for name in (
        "continuity of position[1] at node 3",
        "continuity of orientation[2] at node 5",
        "start of position[2]",
        "goal of position[0]",
        "goal of orientation[1]",
    ):
        shift, ends = np.zeros(len(programme.rows)), []
        for sign in (1, -1):
            shift[rows[name]] = sign * 1e-5
            found = Ipopt(1e-9).solve(Shifted(programme, shift), optimum.x, optimum.multipliers)
            ends.append(found.objective)
        change = (ends[0] - ends[1]) / 2e-5
        assert change == pytest.approx(-optimum.multipliers[rows[name]], rel=1e-3, abs=1e-6), name


def test_the_last_costate_is_what_moving_the_goal_costs(problem):
    """dJ/d(goal) in the units of the state: costates count per length and per radian."""
    solver = MultipleShooting(intervals=INTERVALS, steps_per_interval=1, optimizer=Ipopt(1e-9))
    solution = solver.solve(problem)
    costates = np.array(solution.details["costates"])
    assert costates.shape == (INTERVALS, 6)
    solver = replace(solver, guess=Known(solution.control))
    for i in range(6):
        ends = []
        for sign in (1, -1):
            tangent = np.zeros(6)
            tangent[i] = sign * 1e-4
            space = problem.system.state_space
            goal = space.unpack(space.retract(problem.goal_point, tangent))
            ends.append(solver.solve(replace(problem, goal=goal)).details["objective_value"])
        assert (ends[0] - ends[1]) / 2e-4 == pytest.approx(costates[-1, i], rel=1e-3, abs=1e-6)


def test_costates_do_not_depend_on_the_charts():
    """The same optimum about other reference poses has other multipliers and the same costates."""
    problem = paper_problem()
    solver = MultipleShooting(intervals=INTERVALS, steps_per_interval=1, optimizer=Ipopt(1e-9))
    one = solver.solve(problem)
    other = replace(solver, guess=Known(one.control)).solve(problem)
    assert len(other.iterations) < len(one.iterations)
    np.testing.assert_allclose(other.details["costates"], one.details["costates"], rtol=1e-3, atol=1e-4)
