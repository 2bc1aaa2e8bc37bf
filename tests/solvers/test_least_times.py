"""Least times of bounded inputs, known in closed form or by the maximum principle; bounds hold between the nodes."""

from __future__ import annotations

from math import pi
from pathlib import Path

import pytest

import nhpocp
from nhpocp.problem_file import parse_problem

CAR = """
nhpocp: 1
name: {name}
system: {{model: unicycle}}
start: {{x: 0, y: 0, theta: 0}}
goal: {{x: {goal[0]}, y: {goal[1]}, theta: {goal[2]}}}
horizon: {{min: 0.5, max: 30, initial: {first}}}
objective: time
constraints: {{control: [[{slowest}, 1], [-1, 1]]}}
solvers: {{nlp: {{intervals: {intervals}}}}}
"""
TASKS = {  # goal, least speed, guess of the time, least time
    "dubins, far": ((5, 0, 3), 1, 9, 8.272519325),
    "dubins, turned round": ((0, 4, "pi"), 1, 6, pi + 2),
    "reeds-shepp, on the spot": ((0, 0, "pi"), -1, 3, pi),
    "reeds-shepp, sideways": ((0, 1, 0), -1, 3, 2.6362321433),
}
INTEGRATOR = """
nhpocp: 1
name: integrator
system: {{model: double_integrator}}
start: {{q: [-1], q_dot: [0]}}
goal: {{q: [0], q_dot: [0]}}
horizon: {{min: 0.5, max: 30, initial: 3}}
objective: time
constraints: {{control: [[-1, 1]]}}
solvers: {{nlp: {{intervals: {intervals}}}}}
"""
ACCURACY = {20: 5e-3, 80: 1e-3}


def least_time(text, intervals, least):
    problem = parse_problem(text)
    solution = nhpocp.solve(problem, "nlp")
    assert solution.converged, solution.message
    assert all(report.ok for report in solution.verdict.bounds)
    assert solution.control.horizon == pytest.approx(least, rel=ACCURACY[intervals])
    assert solution.control.horizon >= least * (1 - 1e-5)


@pytest.mark.parametrize("intervals", ACCURACY)
@pytest.mark.parametrize("task", TASKS)
def test_of_a_car(task, intervals):
    goal, slowest, first, least = TASKS[task]
    text = CAR.format(name=task, goal=goal, slowest=slowest, first=first, intervals=intervals)
    least_time(text, intervals, least)


@pytest.mark.parametrize("intervals", ACCURACY)
def test_of_a_mass(intervals):
    least_time(INTEGRATOR.format(intervals=intervals), intervals, 2.0)


def test_a_satellite_swings_out_of_its_plane():
    """About the first axis alone it takes 34.311: a fine mesh from the file's guess ended there or nowhere."""
    file = Path(__file__).parents[2] / "problems" / "satellite_slew.yaml"
    problem = nhpocp.load_problem(file, ["solvers.nlp.intervals=80", "solvers.nlp.starts=1"])
    solution = nhpocp.solve(problem, "nlp")
    assert solution.converged, solution.message
    assert solution.control.horizon == pytest.approx(28.6304077, rel=1e-3)


def test_singular_arcs_are_not_sold_as_unique():
    """A mass in two directions, one of which has time to spare."""
    text = INTEGRATOR.format(intervals=20).replace("double_integrator", "double_integrator, n: 2")
    text = (
        text.replace("[-1]", "[-1, -0.1]").replace("[0]", "[0, 0]").replace("[[-1, 1]]", "[[-1, 1], [-1, 1]]")
    )
    solution = nhpocp.solve(parse_problem(text), "nlp")
    assert solution.control.horizon == pytest.approx(2, rel=5e-3)
    (words,) = [each for each in solution.warnings if "singular arcs" in each]
    assert "u[1] for" in words
    assert "u[0]" not in words


def test_who_does_not_choose_the_duration_says_so():
    goal, slowest, first, _ = TASKS["reeds-shepp, on the spot"]
    text = CAR.format(name="turn", goal=goal, slowest=slowest, first=first, intervals=20)
    solution = nhpocp.solve(parse_problem(text).with_(bounds=[]), "jacobian")
    assert any("does not choose the duration, which stays 3" in words for words in solution.warnings)
