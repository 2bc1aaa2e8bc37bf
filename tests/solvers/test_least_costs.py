"""Least efforts known from theory: the NLP on 50 and 100 intervals, extrapolated, and the Jacobian method."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt, tan
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution

LIBRARY = Path(__file__).parents[2] / "problems"
DIDO = ["system.scale=0.5", "goal.x=1", "goal.z=0.5"]
# file, changes, least ∫|u|² (physics: isoperimetric inequality, maximum principle), digits of that number
CASES = {
    "heisenberg": ("heisenberg", [], 2 * pi, 1e-6),
    "heisenberg, half the area": ("heisenberg", ["system.scale=0.5"], 4 * pi, 1e-6),
    "heisenberg, sideways": ("heisenberg", DIDO, 3.1830168, 1e-6),
    "free (3, 6), oblique": ("free_nilpotent_36", ["goal.z=[0.3, -0.4, 1.2]"], 4 * pi * 1.3, 1e-6),
    "veselova, quarter turn": ("veselova_joint", [], pi / 2 * (4 * pi - pi / 2), 1e-6),
    "veselova, half turn": ("veselova_joint", ["goal.orientation.rpy=[0, 0, pi]"], 3 * pi**2, 1e-6),
    "suslov, quarter turn": ("suslov_joint", [], pi / 2 * (4 * pi - pi / 2), 1e-6),
    "unicycle, sideways": ("unicycle", [], 11.1581587, 1e-6),
    "unicycle, aslant": ("unicycle", ["goal.x=1"], 7.1915589, 1e-6),
    "rubber sphere in place": ("rolling_sphere", [], 30.6326882, 1e-5),
}


def by_nlp(problem: PlanningProblem, intervals: int) -> Solution:
    solution = nhpocp.solve(problem, replace(problem.solvers["nlp"], intervals=intervals))
    assert solution.converged, solution.message
    return solution


def problem_of(file: str, changes: list[str]) -> PlanningProblem:
    return nhpocp.load_problem(LIBRARY / f"{file}.yaml", changes)


@pytest.mark.parametrize("name", CASES)
def test_least_effort_is_the_one_of_theory(name):
    """Controls constant on N intervals cost O(1/N²) more than the best; two N give the limit."""
    file, changes, least, digits = CASES[name]
    coarse, fine = (by_nlp(problem_of(file, changes), n).costs["effort"] for n in (50, 100))
    assert coarse > fine > least
    assert (coarse - least) / (fine - least) == pytest.approx(4, rel=0.02)
    assert (4 * fine - coarse) / 3 == pytest.approx(least, rel=digits)


@pytest.mark.parametrize(("file", "circle"), [("heisenberg", 2 * pi), ("free_nilpotent_36", 4 * pi)])
def test_circles_and_polygons_are_exact(file, circle):
    """The circle lies in the Fourier basis of one harmonic; 20 constant values make a regular polygon."""
    problem = problem_of(file, [])
    solution = nhpocp.solve(problem)
    assert solution.converged
    assert solution.costs["effort"] == pytest.approx(circle, rel=1e-6)
    polygon = by_nlp(problem, 20).costs["effort"]
    assert polygon == pytest.approx(circle * 20 / pi * tan(pi / 20), rel=1e-8)


def test_several_starts_leave_a_local_minimum():
    """From this control alone the NLP ends at 37.011, a loop too many; the least of three starts is the least."""
    start = np.zeros((2, 5))
    start[0, 2] = start[1, 1] = 8.0
    problem = replace(problem_of("veselova_joint", []), initial=start)
    alone = by_nlp(problem, 100)
    assert alone.costs["effort"] == pytest.approx(37.011, rel=3e-4)
    nlp = replace(problem.solvers["nlp"], intervals=100, starts=3)
    best = nhpocp.solve(problem, nlp)
    assert best.converged
    assert best.costs["effort"] == pytest.approx(17.2718077, rel=3e-4)


def test_a_marble_spins_in_place_where_rubber_has_to_roll_around():
    """With the third input a quarter turn about the vertical costs (π/2)²."""
    problem = problem_of("rolling_sphere", ["system.contact=marble", "control.initial=auto"])
    assert by_nlp(problem, 50).costs["effort"] == pytest.approx((pi / 2) ** 2, rel=1e-6)


TURNS = {
    "a third about (1, 1, 1)": ({"rotvec": [2 * pi / 3 / sqrt(3)] * 3}, 8.0871754459),
    "a half about (1, 0, 1)": ({"rotvec": [pi / sqrt(2), 0, pi / sqrt(2)]}, 15.5071402938),
    "a half about x": ({"rpy": [pi, 0, 0]}, pi**2),
}


@pytest.mark.parametrize("joint", [nhpocp.VeselovaJoint, nhpocp.SuslovJoint], ids=lambda joint: joint.model)
@pytest.mark.parametrize("turn", TURNS)
def test_least_efforts_of_joints(turn, joint):
    """On SO(3) with ω_z = 0 in the socket or in the ball, by the maximum principle; 100 values cost O(1/N²) more."""
    goal, least = TURNS[turn]
    start = {"orientation": np.eye(3)}
    problem = PlanningProblem(system=joint(), start=start, goal={"orientation": goal})
    solution = nhpocp.solve(problem, nhpocp.MultipleShooting(intervals=100, starts=2))
    assert solution.converged, solution.message
    assert solution.costs["effort"] == pytest.approx(least, rel=1e-3)
    assert solution.costs["effort"] >= least * (1 - 1e-6)
