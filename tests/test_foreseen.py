"""Bounds that exclude each other and costs without a least, said before any solver starts."""

from __future__ import annotations

import re

import goals
import numpy as np
import pytest

import nhpocp
from nhpocp import so3
from nhpocp.constraints.bound import Bound
from nhpocp.doubts import doubts
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.foreseen import contradiction, endless, singular_goal
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.pace import too_far
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.nlp.guesses import Guess, ProblemGuess, make_guess
from nhpocp.solvers.nlp.single_shooting import SingleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from tests.conftest import Integrators, paper_problem, yaw

NLP = build_solver("nlp", {"intervals": 6})
SOLVERS = [NLP, build_solver("jacobian", {"step_rule": "auto"})]


def plane(**changes) -> PlanningProblem:
    values = {"start": {"x": 0, "y": 0}, "goal": {"x": 1, "y": 2}, "pictures": False}
    return PlanningProblem(system=Integrators(), **{**values, **changes})


EXCLUSIVE = {  # problem, words
    "one quantity": (
        plane(bounds=[Bound("low", "x", upper=1.5), Bound("high", "x", lower=2.0)]),
        "low and high leave nothing: x is to be at least 2",
    ),
    "start, the goal free": (
        plane(goal={"y": 2}, bounds=[Bound("state.x", "x", 0.5, 2.0)]),
        "the start itself breaks state.x",
    ),
    "control and leg speed": (
        paper_problem(bounds=[Bound("control", "v", 5.0, 10.0), Bound("leg_speed", "u", -1e-3, 1e-3)]),
        "no control at the start keeps control and leg_speed",
    ),
}


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize("name", EXCLUSIVE)
def test_bounds_that_exclude_each_other_are_named_before_the_solve(name, solver):
    problem, words = EXCLUSIVE[name]
    solution = nhpocp.solve(problem, solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.INFEASIBLE, 0)
    assert words in solution.message


def test_bounds_that_fit_are_not_refused():
    for bounds in (
        [Bound("control", "v", -10.0, 10.0), Bound("leg_speed", "u", -1e-3, 1e-3)],
        [Bound("control", "v", 5.0, 10.0)],
        [Bound("leg_length", "leg_lengths", 20.0, 60.0), Bound("clearance", "sigma_s", lower=1e-3)],
    ):
        assert contradiction(paper_problem(bounds=bounds)) == ""


@pytest.mark.parametrize("objective", ["effort", "leg_effort"])
@pytest.mark.parametrize("horizon", [Horizon(1.0, 0.5, None), Horizon(None, 0.5, None)])
def test_an_effort_that_vanishes_with_time_asks_for_a_longest_horizon(objective, horizon):
    solution = nhpocp.solve(paper_problem(objective=objective, horizon=horizon), NLP)
    assert (solution.outcome, solution.evaluations) == (Outcome.DIVERGED, 0)
    assert "Give it a max" in solution.message
    assert "min: 0.5, max: " in solution.message


def test_what_has_a_least_cost_is_no_endless_wait():
    free = Horizon(1.0, 0.5, None)
    assert endless(plane(horizon=free))
    assert not endless(plane(horizon=Horizon(1.0, 0.5, 2.0)))
    assert not endless(plane(horizon=free, objective="time"))
    assert not endless(plane(horizon=free, goal={"x": 0}))  # to stay costs nothing
    assert not endless(plane(horizon=free, bounds=[Bound("control", "u", 1.0, 2.0)]))  # it may not be slow


@pytest.mark.parametrize("kind", [StagedTranscription, SingleShooting])
@pytest.mark.parametrize("found", [-9e-10, 4.6e-12, 3.0 + 1e-8])
def test_a_horizon_keeps_its_bounds_exactly_and_the_path_its_end(kind, found):
    """Optimizers keep bounds up to their tolerance."""
    problem = plane(horizon=Horizon(1.0, 1e-9, 3.0), initial=np.ones((2, 5)))
    guess = make_guess(ProblemGuess(), problem, None, 4, 0)
    programme = kind(problem, guess, None, 4, 1, [], Interpreted())
    x = programme.pack(guess)
    if kind is StagedTranscription:
        x[programme.interval.nodes - 1 :: programme.stage] = found
    else:
        x[programme.statics - 1] = found
    kept: Guess = programme.unpack(x)
    assert 1e-9 <= kept.control.horizon <= 3.0
    middle = kept.control(0.5 * kept.control.horizon)[0]
    np.testing.assert_allclose(middle * kept.control.horizon, guess.control(0.5)[0] * found, rtol=1e-9)


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_a_free_horizon_ends_within_its_bounds(solver):
    for objective in ("time", "effort"):
        problem = plane(horizon=Horizon(1.0, 1e-9, 3.0), goal={"x": 0, "y": 0}, objective=objective)
        solution = nhpocp.solve(problem, build_solver("nlp", {"intervals": 4, "plugin": solver}))
        assert solution.converged, solution.message
        assert 1e-9 <= solution.control.horizon <= 3.0


# --- legs that are too far apart for their speeds ---------------------------------------------------------------------


def hurried(limit, horizon=1.0, **changes):
    bounds = [Bound("leg_speed", "u", -limit, limit)]
    return paper_problem(bounds=bounds, horizon=Horizon.of(horizon), **changes)


@pytest.fixture(scope="module")
def unhurried():
    return nhpocp.solve(paper_problem(), nhpocp.Continuation(step_rule=nhpocp.Adaptive()))


def test_no_motion_that_exists_is_called_too_far(unhurried):
    """A limit that a verified motion keeps is never refused, at whatever pace and with via poses on the way."""
    fastest = float(np.abs(unhurried.trajectory["u"]).max())
    place, k = unhurried.trajectory["position"], 100
    turn = unhurried.trajectory["orientation"]
    via = {"at": 0.5, "position": place[k].tolist(), "orientation": {"matrix": turn[k].tolist()}}
    for pace in (0.01, 0.5, 1.0, 7.0, 1e4):
        for given in ([], [via]):
            problem = hurried(fastest / pace, pace, via=given)
            assert too_far(problem, pace, 1e-3) == ""


def test_inputs_called_u_of_a_system_without_legs_are_no_legs():
    assert too_far(plane(bounds=[Bound("control", "u", -1e-9, 1e-9)]), 1.0, 1e-3) == ""


@pytest.mark.parametrize("horizon", [0.02, 1.0, 300.0])
def test_what_the_legs_cannot_travel_in_time_is_proved(horizon, unhurried):
    lengths = unhurried.trajectory["leg_lengths"]
    travel = float(np.abs(lengths[-1] - lengths[0]).max())
    least = travel / horizon
    assert too_far(hurried(1.01 * least, horizon), horizon, 1e-3) == ""
    words = too_far(hurried(0.98 * least, horizon), horizon, 1e-3)
    assert words.startswith(
        "leg_speed and horizon exclude each other, whatever the motion: leg_lengths[0] becomes"
    )
    assert float(re.search(r"horizon: ([\d.e+-]+)", words)[1]) == pytest.approx(horizon / 0.98, rel=0.01)
    assert too_far(hurried(0.98 * least, horizon), None, 1e-3) == ""  # with no limit on the horizon


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_the_horizon_that_a_hopeless_speed_is_answered_with_is_enough(solver):
    with pytest.warns(nhpocp.NhpocpWarning, match="exclude each other"):
        solution = nhpocp.solve(hurried(5.0), solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.INFEASIBLE, 0)
    horizon = float(
        re.search(r"A motion that keeps leg_speed was found for horizon: (\S+)\.", solution.message)[1]
    )
    assert nhpocp.solve(hurried(5.0, horizon), SOLVERS[1]).converged


def test_a_goal_on_a_singular_surface_is_refused_by_name_and_doubted():
    """On the axis of `paper_conjecture`, det W has a zero where cos ψ = B/A."""
    goal = {"position": [0, 0, 35], "orientation": yaw(-np.arccos(5 / 15))}
    problem = goals.paper_task("paper_conjecture", goal=goal)
    solution = nhpocp.solve(problem)
    assert solution.outcome is Outcome.SINGULAR_W
    assert solution.evaluations == 0
    assert "The goal itself lies on det W = 0, where σ_min(W) is" in solution.message
    (doubt,) = [doubt for doubt in doubts(problem, 1e-3) if doubt.path == "goal"]
    assert "lies on det W = 0" in doubt.message
    beside = goals.paper_task("paper_conjecture", goal={**goal, "orientation": yaw(-1.2)})
    assert singular_goal(beside) == ("", "")


def test_a_goal_beyond_a_singular_surface_is_doubted_and_so_is_a_start_on_one():
    beyond = paper_problem(goal={"position": [0, 0, 30], "orientation": so3.from_rpy([0, 2.1, 0])})
    said = {str(doubt.path): doubt.message for doubt in doubts(beyond, 1e-3)}
    assert re.fullmatch(r"det W is \S+ at the start and -\S+ at the goal; no path leads there", said["goal"])
    flat = paper_problem(start={"position": [0, 0, 0], "orientation": yaw(-np.pi / 6)})
    said = {str(doubt.path): doubt.message for doubt in doubts(flat, 1e-3)}
    assert "the machine is singular where it begins" in said["start"]
    assert "goal" not in said  # of which signs say nothing
    assert not list(doubts(paper_problem(), 1e-3))
