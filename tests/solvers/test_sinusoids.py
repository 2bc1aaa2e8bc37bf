"""The closed-form solver: random goals are reached and verified, and what it cannot do is refused in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import nhpocp
from nhpocp.errors import InvalidProblemError
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import parse_problem
from nhpocp.problem_file.registry import system_class
from nhpocp.solvers import sinusoids
from nhpocp.solvers.sinusoids import Sinusoids, SinusoidsSettings


def car(random):
    return {
        "x": random.uniform(-2, 2),
        "y": random.uniform(-2, 2),
        "theta": random.uniform(-2, 2),
        "phi": 0.3,
    }


def train(random):
    theta = random.uniform(-1, 1) + np.cumsum(random.uniform(-0.5, 0.5, 3))
    return {"x": random.uniform(-2, 2), "y": random.uniform(-2, 2), "theta": theta}


def arm(random):
    return {"phi": random.uniform(-1, 1), "theta": random.uniform(-1, 1, 3)}


STATES = {
    "car": ({}, car),
    "car_with_trailers": ({"lengths": [1, 1]}, train),
    "nonholonomic_manipulator": ({}, arm),
}


def task(model, seed):
    parameters, state = STATES[model]
    random = np.random.default_rng(seed)
    return PlanningProblem(system=system_class(model)(**parameters), start=state(random), goal=state(random))


@pytest.mark.parametrize(
    ("model", "seed", "inputs"),
    [
        *((model, 4, "sinusoids") for model in STATES),  # the car's is too wild to be reached in one
        *((model, 3, "polynomials") for model in STATES),
    ],
)
def test_random_goals_are_reached(model, seed, inputs):
    solution = nhpocp.solve(task(model, seed), Sinusoids(SinusoidsSettings(inputs=inputs)))
    assert solution.converged, solution.message
    assert solution.verdict.error < 1e-8


def test_by_its_name_in_a_file_and_back_from_a_folder(tmp_path):
    text = """
nhpocp: 1
name: parking
system: {model: unicycle}
start: {x: 0, y: 0, theta: 0}
goal: {x: 0, y: 1, theta: 0}
via: [{at: 0.5, x: 1, y: 0.5, theta: 20 deg}]
solvers: {sinusoids: {inputs: sinusoids}}
output: {pictures: false}
"""
    problem = parse_problem(text)
    solution = nhpocp.solve(problem, "sinusoids")
    assert solution.converged, solution.message
    nhpocp.save_solution(solution, tmp_path / "plan")
    again = nhpocp.load_solution(tmp_path / "plan")
    np.testing.assert_array_equal(again.control.coefficients, solution.control.coefficients)


def test_what_it_cannot_do_is_said():
    at = {"position": [0, 0], "orientation": np.eye(3)}
    ball = PlanningProblem(system=nhpocp.RollingSphere(), start=at, goal={**at, "position": [1, 0]})
    with pytest.raises(InvalidProblemError, match="rolling_sphere has no chained form"):
        nhpocp.solve(ball, Sinusoids(SinusoidsSettings()))
    arm = nhpocp.MobileManipulator()
    at = {"x": 0, "y": 0, "theta": 0, "q": [0.5, -1]}
    with pytest.raises(InvalidProblemError, match="tip is an output"):
        nhpocp.solve(
            PlanningProblem(system=arm, start=at, goal={"tip": [1, 1]}), Sinusoids(SinusoidsSettings())
        )


def test_what_the_goal_leaves_free_stays():
    car = task("car", 1)
    part = replace(car, goal={name: value for name, value in car.goal.items() if name != "phi"})
    solution = nhpocp.solve(part, Sinusoids(SinusoidsSettings()))
    assert solution.converged
    assert solution.trajectory["phi"][-1] == pytest.approx(car.start["phi"], abs=1e-8)


def test_what_is_too_wild_is_no_plan(monkeypatch):
    monkeypatch.setattr(sinusoids, "CHARTS", 0)
    monkeypatch.setattr(sinusoids, "SHORTEST", 0.2)
    solution = nhpocp.solve(task("car", 4), Sinusoids(SinusoidsSettings()))
    assert solution.outcome is Outcome.STAGNATED
    assert "too wild to be followed; give nearer poses" in solution.message
    assert not solution.converged
