"""Manoeuvres merged: what is cut and joined stays the same motion, and none costs more than it did."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import FOLLOWED, path_error, settled_path
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation import auto, joined_plans
from nhpocp.solvers.continuation.along_routes import AlongRoutes
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.direct_controls import DirectControls
from nhpocp.solvers.continuation.merging import Merging, together
from nhpocp.solvers.continuation.pieces import between, concatenated, middle, pieces_of
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.least_cost.stretch import graded
from nhpocp.solvers.least_cost.walls import walls
from nhpocp.systems.unicycle import Unicycle
from tests.conftest import PAPER_START, paper_problem

PIECES, TOLERANCE = 4, 1e-3
SOLVER = Continuation(step_rule=Adaptive())
LEAST = 11.1581587  # effort of the unicycle's unit step aside, by the maximum principle


def aside(distance=1.0, **changes):
    values = {
        "system": Unicycle(),
        "start": {"x": 0.0, "y": 0.0, "theta": 0.0},
        "goal": {"x": 0.0, "y": distance, "theta": 0.0},
        "basis": Fourier(2),
        "initial": [[0.5, 0, -2, 0, 0], [0, 3, 0, 0, 0]],
        "pictures": False,
    }
    return PlanningProblem(**{**values, **changes})


@pytest.fixture(scope="module")
def steps_aside():
    """Four short steps, each a manoeuvre of unit time."""
    found = Continuation(step_rule=Adaptive()).find(aside(1.0 / PIECES))
    assert found.outcome is Outcome.CONVERGED
    return [found.control] * PIECES


def whole(merging):
    return together(merging.stretches).control


def end(problem, control):
    return settled_path(problem, control, 800)[1][-1]


@given(st.lists(st.floats(0.1, 3.0), min_size=1, max_size=5), st.integers(0, 99))
@settings(deadline=None, max_examples=20)
def test_what_is_put_together_leads_where_its_pieces_do(sizes, seed):
    random, problem = np.random.default_rng(seed), aside()
    controls = [Control(Fourier(1), size * random.normal(size=(2, 3))) for size in sizes]
    whole, here = concatenated(controls), problem.start_point
    for control in controls:
        here = settled_path(problem, control, 400, here)[1][-1]
    np.testing.assert_allclose(end(problem, whole), here, atol=1e-6)
    assert whole.horizon == 1.0
    assert len(pieces_of(concatenated([whole, whole]))) == 2 * len(controls)
    lengths = [np.sqrt(control.effort) for control in controls]
    assert whole.effort >= (1.0 - 1e-9) * sum(lengths) ** 2  # the least of all divisions


@given(st.floats(0.1, 0.9), st.integers(0, 99))
@settings(deadline=None, max_examples=20)
def test_a_control_cut_in_two_leads_where_the_whole_does(time, seed):
    problem, whole = aside(), Control(Fourier(1), np.random.default_rng(seed).normal(size=(2, 3)))
    parts = [between(whole, *times, BSpline(3, 9)) for times in ((0.0, time), (time, 1.0))]
    here = problem.start_point
    for part in parts:
        here = settled_path(problem, part, 400, here)[1][-1]
    np.testing.assert_allclose(end(problem, whole), here, atol=1e-3)
    half = middle(whole, 2000)
    times = np.linspace(0.0, 1.0, 20001)
    speeds = np.linalg.norm(whole(times), axis=1)
    done = np.cumsum(speeds)
    assert np.interp(half, times, done) == pytest.approx(0.5 * done[-1], rel=2e-3)


@given(st.integers(20, 300), st.lists(st.floats(0.05, 0.95), max_size=3, unique=True))
@settings(deadline=None, max_examples=20)
def test_graded_steps_end_at_every_breakpoint_and_come_in_equal_pairs(steps, breakpoints):
    times = np.linspace(0.0, 1.0, 101)
    path = np.tanh(20.0 * (times - 0.5))[:, None]
    grid = graded(times, path, np.exp(path), np.ones(1), np.sort(breakpoints), steps)
    widths = np.diff(grid)
    assert (widths > 0).all()
    np.testing.assert_allclose(widths[::2], widths[1::2], atol=1e-12)
    assert all(np.abs(grid[::2] - t).min() < 1e-12 for t in (0.0, *breakpoints, 1.0))
    assert len(grid) - 1 <= steps + 4 * (2 + len(breakpoints))
    if not breakpoints and steps > 50:
        assert widths[np.abs(grid[:-1] - 0.5).argmin()] < 0.7 * widths[0]  # where it moves fast


def test_the_walls_have_the_gradient_of_their_differences():
    problem = paper_problem(bounds=[Bound("leg_length", "leg_lengths", 15.0, 60.0)])
    about = walls(problem)
    assert about.names == ("det S = 0", "det W = 0")
    flow = RungeKutta4(50).flow(about.dynamics, problem.basis, 1.0)
    start = np.append(problem.start_point, 0.0)
    _, derivatives, slacks = flow.sensitivity(start, PAPER_START)
    np.testing.assert_allclose(slacks[0, :2], 1.0)  # of the start's own determinants
    assert slacks.shape[1] == 2 + 3 + 6
    assert derivatives.shape[1] == 1
    steps = 1e-5 * np.eye(15).reshape(15, 3, 5)
    differences = [(flow.end(start, PAPER_START + d) - flow.end(start, PAPER_START - d))[-1] for d in steps]
    np.testing.assert_allclose(derivatives[-1, -1], np.array(differences) / 2e-5, rtol=1e-4, atol=1e-6)


def test_direct_controls_lead_to_the_pose_and_touch_no_wall():
    """Beyond x = 0.02 is a wall; those that begin by backing away are left."""
    free, wall = aside(), Bound("state.x", "x", -2.0, 0.02)
    counts = []
    with Interruption() as interruption:
        for problem in (free, aside(bounds=[wall])):
            direct = DirectControls(problem, SOLVER, walls(problem), interruption)
            found = direct.between(problem.start_point, problem.goal)
            counts.append(len(found))
            efforts = [control.effort for control in found]
            assert efforts == sorted(efforts)
            for control in found:
                path = settled_path(free, control, 400)[1]
                np.testing.assert_allclose(path[-1], problem.goal_point, atol=1e-2)
                assert problem is free or path[:, 0].max() < 0.03
        beyond = np.array([0.5, 0.0, 0.0])  # where the start itself is beyond the wall nothing is clear
        assert direct.between(beyond, problem.goal) == []
    assert counts[0] > counts[1] > 0


def test_merging_never_costs_more_and_ends_near_the_least(steps_aside):
    problem = aside()
    merging = Merging(problem, steps_aside, SOLVER)
    first = merging.effort
    efforts = [first, *merging.run()]
    assert all(later <= (1.0 + 1e-6) * earlier for earlier, later in pairwise(efforts))
    assert len(merging.stretches) == 1
    assert whole(merging).effort < 0.4 * first
    assert whole(merging).effort == pytest.approx(LEAST, rel=0.03)
    assert merging.stationary
    np.testing.assert_allclose(end(problem, whole(merging)), problem.goal_point, atol=TOLERANCE)


def test_a_merged_plan_is_verified_and_says_what_it_was(steps_aside):
    search = auto._Search(Auto(Continuation(step_rule=Adaptive(), objective="effort")), aside(), None)
    result = search.joined.plan(steps_aside, 0)
    assert result.outcome is Outcome.CONVERGED
    assert "effort 11." in result.message
    assert result.details["stationary"]
    assert result.details["objective_value"] == pytest.approx(result.control.effort)
    solution = result.solution(Auto(Continuation(step_rule=Adaptive(), objective="effort")), aside())
    assert planning.verify(solution).ok


@pytest.mark.parametrize("bounds", [[], [Bound("state.x", "x", -0.3, 0.3)]])
def test_a_merge_far_behind_another_is_given_up(steps_aside, bounds):
    """It is no plan then: nobody has looked at its bounds, nor for less."""
    search = auto._Search(Auto(replace(SOLVER, objective="effort")), aside(bounds=bounds), None)
    search.joined._merged = [1e-3]
    result = search.joined.plan(steps_aside, 0)
    assert result.outcome is Outcome.STAGNATED
    assert "given up" in result.message
    assert search.joined._merged == [1e-3]
    search.joined._merged = [1e6]
    plan = search.joined.plan(steps_aside, 0)
    assert plan.outcome is Outcome.CONVERGED
    assert search.joined._merged[0] == 1e6
    assert len(search.joined._merged) == 2


def test_a_merge_whose_plan_does_not_count_puts_none_behind(steps_aside, monkeypatch):
    search = auto._Search(Auto(replace(SOLVER, objective="effort")), aside(), None)

    def refuted(merging, first, solver):
        return replace(first, outcome=Outcome.NOT_VERIFIED)

    monkeypatch.setattr(search.joined, "_of_merged", refuted)
    assert search.joined.plan(steps_aside, 0).outcome is Outcome.NOT_VERIFIED
    assert search.joined._merged == []


def test_a_bound_on_the_pose_is_kept(steps_aside):
    """The free motion swings to |x| = 0.5 and more."""
    box = Bound("state.x", "x", -0.3, 0.3)
    merging = Merging(aside(bounds=[box]), steps_aside, SOLVER)
    before = merging.effort
    for _ in merging.run():
        pass
    path = settled_path(aside(), whole(merging), 800)[1]
    assert np.abs(path[:, 0]).max() < 0.3005
    assert whole(merging).effort < 0.6 * before


def test_few_evaluations_end_it_early(steps_aside):
    merging = Merging(aside(), steps_aside, replace(SOLVER, max_iterations=3))
    for _ in merging.run():
        pass
    assert merging.evaluations <= 3 * 60  # so many searches at most
    assert not merging.stationary


def test_merging_goes_back_level_by_level_to_what_finer_steps_confirm(steps_aside, monkeypatch):
    merging = Merging(aside(), steps_aside, SOLVER)
    for _ in merging.run():
        pass
    efforts = [merging.effort]
    while merging.back():
        efforts.append(merging.effort)
    assert efforts == sorted(efforts)
    assert not merging.back()
    effort = replace(SOLVER, objective="effort")
    search = auto._Search(Auto(effort), aside(), None)
    monkeypatch.setattr(joined_plans, "path_error", lambda *_: 1.0)  # none is resolved
    result = search.joined.plan(steps_aside, 0)
    assert result.outcome is Outcome.NOT_VERIFIED
    assert "may be wrong by 1 " in result.message


def test_too_few_steps_for_joined_manoeuvres_are_made_more(steps_aside):
    search = auto._Search(Auto(SOLVER), aside(), None)
    coarse = search.joined._as_one(steps_aside, 0)
    few = replace(coarse, integrator=RungeKutta4(40), outcome=Outcome.CONVERGED)
    plan = search.joined._resolved(few)
    assert plan.outcome is Outcome.CONVERGED
    assert plan.integrator.steps > 40
    assert path_error(aside(), plan.control, plan.integrator) <= FOLLOWED


def test_other_routes_are_followed_for_less(steps_aside, monkeypatch):
    def two(self):
        self.followed = True
        for number in (1, 2):
            yield f"4 manoeuvres in sequence, {number}, along a route", steps_aside, 0, {}

    monkeypatch.setattr(AlongRoutes, "ways", two)
    solution = planning.solve(aside(), Auto(replace(SOLVER, objective="effort"), route="always"))
    assert solution.converged
    ways = [entry["way"] for entry in solution.details["tried"]]
    assert ways[:2] == [f"4 manoeuvres in sequence, {number}, along a route" for number in (1, 2)]
    assert len(solution.details["costs_of_starts"]) >= 2
    assert solution.costs["effort"] < 1.05 * LEAST


def test_a_path_that_steps_do_not_resolve_is_told_from_one_that_they_do(steps_aside):
    wild = replace(steps_aside[0], coefficients=4.0 * steps_aside[0].coefficients)
    few, many = (path_error(aside(), wild, RungeKutta4(steps)) for steps in (16, 160))
    exact = settled_path(aside(), wild, 6400)[1][::40]
    coarse = RungeKutta4(160).flow(dynamics(aside().system), wild.basis, 1.0)
    off = np.abs(coarse.states(aside().start_point, wild.coefficients) - exact[:161]).max()
    assert few > 100 * many
    assert many == pytest.approx(off / aside().scales.points.min(), rel=1.0)


def test_an_interruption_hands_back_the_joined_plan(steps_aside, monkeypatch):
    def interrupted(self):
        yield self.effort
        raise KeyboardInterrupt

    monkeypatch.setattr(Merging, "run", interrupted)
    search = auto._Search(Auto(Continuation(step_rule=Adaptive(), objective="effort")), aside(), None)
    result = search.joined.plan(steps_aside, 0)
    assert (result.outcome, result.message) == (Outcome.INTERRUPTED, STOPPED)
    np.testing.assert_allclose(end(aside(), result.control), aside().goal_point, atol=TOLERANCE)
    assert replace(result, outcome=Outcome.CONVERGED).control.effort > 2 * LEAST
