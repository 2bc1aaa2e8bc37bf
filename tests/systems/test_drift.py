"""Systems with drift, ẋ = f(x) + G(x) u, through every solver and the verification; outputs of the pose as goals."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp import so3
from nhpocp.constraints.bound import Bound
from nhpocp.flow.simulation import simulate
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.nlp.guesses import StraightGuess
from nhpocp.via import Via
from tests.conftest import Turntable
from tests.ferry import Ferry

ASHORE = {"position": [0.0, 0.0], "theta": 0.0}
SOLVERS = {
    "jacobian": build_solver("jacobian", {"step_rule": "adaptive", "objective": "effort"}),
    "auto": build_solver("jacobian", {"step_rule": "auto"}),
    "nlp": build_solver("nlp", {"intervals": 20}),
    "nlp over the basis": build_solver("nlp", {"intervals": 20, "control": "basis"}),
    "single shooting": build_solver("nlp", {"intervals": 20, "shooting": "single", "control": "basis"}),
}


def ferry(**changes) -> PlanningProblem:
    values = {"system": Ferry(), "start": ASHORE, "goal": {"bow": [0.0, 2.0]}, "pictures": False}
    return PlanningProblem(**{**values, **changes})


def test_the_readmes_example_runs():
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parents[1].joinpath("ferry.py"))],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("converged")


@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_brings_the_bow_across(name):
    problem = ferry(
        goal={"bow": [0.0, 2.0], "theta": pi / 2},
        via=[Via(0.4, {"position": [0.3, 0.2]})],
        bounds=[Bound("state.position", "position", [-1.0, -1.0], [1.0, 3.0])],
    )
    solution = nhpocp.solve(problem, SOLVERS[name])
    assert solution.converged, solution.message
    bow = np.asarray(solution.trajectory["bow"])
    np.testing.assert_allclose(bow[-1], [0.0, 2.0], atol=2e-3)
    np.testing.assert_allclose(np.asarray(solution.trajectory["position"])[-1], [0.0, 1.0], atol=3e-3)
    assert solution.verdict.trajectory_deviation < 1e-4


@pytest.mark.parametrize("name", ["jacobian", "nlp", "single shooting"])
def test_where_the_water_goes_by_itself_costs_nothing(name):
    """The goal is where the drift leads: least effort is none at all."""
    problem = ferry(goal={"position": [1.0, 0.0], "theta": 0.0}, horizon=Horizon(2.0))
    solution = nhpocp.solve(problem, SOLVERS[name])
    assert solution.converged, solution.message
    assert solution.costs["effort"] < 1e-4
    assert solution.costs["path_length"] == pytest.approx(1.0, rel=1e-2)


def test_a_free_horizon_waits_for_the_water():
    problem = ferry(goal={"position": [1.0, 0.0], "theta": 0.0}, horizon=Horizon(1.0, 0.5, 4.0))
    solution = nhpocp.solve(problem, SOLVERS["nlp"])
    assert solution.converged, solution.message
    assert solution.control.horizon == pytest.approx(2.0, rel=1e-3)
    assert solution.costs["effort"] < 1e-6


def test_rotations_may_drift():
    """Half of the wanted turn comes from the table, which cannot be left out: its angle is no goal."""
    goal = {"orientation": so3.exp(np.array([0.4, 0.2, 0.9]))}
    problem = PlanningProblem(system=Turntable(), start={"angle": 0.0, "orientation": np.eye(3)}, goal=goal)
    for name in ("jacobian", "nlp"):
        solution = nhpocp.solve(problem, SOLVERS[name])
        assert solution.converged, solution.message
        assert solution.trajectory["angle"][-1] == pytest.approx(0.7)


def test_manoeuvres_in_sequence_are_no_way_for_a_drift():
    """The table's angle at T is given: nothing reaches another, and no piece may take another time."""
    goal = {"angle": 0.9, "orientation": so3.exp(np.array([0.1, 0.2, 0.8]))}
    problem = PlanningProblem(system=Turntable(), start={"angle": 0.0, "orientation": np.eye(3)}, goal=goal)
    solution = nhpocp.solve(problem, build_solver("jacobian", {"step_rule": "auto", "max_iterations": 6}))
    assert solution.outcome is Outcome.NOT_REACHED
    assert not any("manoeuvre" in way["way"] for way in solution.details["tried"])


def test_the_straight_guess_steers_against_the_water():
    problem = ferry(goal={"position": [3.0, 0.0], "theta": 0.0})
    control = StraightGuess().control(problem, 1.5, 0)
    np.testing.assert_allclose(control(np.array([0.2, 1.1])), [[1.5, 0.0]] * 2, atol=1e-12)  # 3/1.5 less 0.5
    motion = simulate(replace(problem, horizon=Horizon(1.5)), control)
    np.testing.assert_allclose(motion.trajectory["position"][-1], [3.0, 0.0], atol=1e-9)


def test_what_is_not_solved_drifts_from_the_start():
    """Refused before the solve: the path without control is the drift's, and so is its error."""
    bounds = [Bound("state.position", "position", -1.0, 1.0)]
    problem = ferry(goal={"position": [2.0, 0.0], "theta": 0.0}, bounds=bounds)
    solution = nhpocp.solve(problem)
    assert solution.outcome is Outcome.INFEASIBLE
    np.testing.assert_allclose(solution.trajectory["position"][-1], [0.5, 0.0], atol=1e-9)
    assert solution.final_error == pytest.approx(1.5)


def test_goals_of_too_many_numbers_are_refused():
    with pytest.raises(nhpocp.InvalidProblemError, match="fixes 5 numbers of a state that has 3"):
        ferry(goal={"bow": [0, 2], "position": [0, 1], "theta": 0})
