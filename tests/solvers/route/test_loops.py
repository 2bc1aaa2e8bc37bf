"""What a small displacement takes of fields and brackets, and the loops that make it."""

from dataclasses import replace

import goals
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import nhpocp
from nhpocp.controls.control import Control
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.horizon import Horizon
from nhpocp.solvers.continuation.bracket_loops import BracketLoops
from nhpocp.solvers.route.loops import Loops, known_loops
from nhpocp.systems.brackets import LieAlgebra
from tests.conftest import paper_problem

BASES = [nhpocp.Fourier(2), nhpocp.Fourier(4), nhpocp.Legendre(9)]


@pytest.fixture(scope="module")
def problem():
    return replace(goals.random_robot_task(4), horizon=Horizon(1.0))


@pytest.fixture(scope="module")
def algebra(problem):
    algebra = LieAlgebra(problem.system)
    algebra.deepen()
    return algebra


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=12, max_size=12))
def test_fields_and_brackets_make_up_a_displacement(problem, algebra, numbers):
    aside, tangent = np.split(np.array(numbers), 2)
    scales = problem.scales.states
    pose = np.asarray(problem.system.state_space.retract(problem.start_point, aside * scales))
    (straight,), (areas,) = Loops(problem).parts(pose[None], tangent * scales)
    fields, brackets = (layer.at(pose[None])[0] for layer in algebra.layers)
    np.testing.assert_allclose(fields @ straight + brackets @ areas, tangent * scales, atol=1e-9)


@pytest.mark.parametrize("basis", BASES, ids=str)
def test_loops_move_the_system_by_a_displacement_but_for_the_third_order(problem, basis):
    problem = replace(problem, basis=basis, initial=None)
    space, direction = problem.system.state_space, np.random.default_rng(0).normal(size=6)
    seeds = BracketLoops(problem, Loops(problem))
    flow = flow_through(problem.system, basis, 1.0, RungeKutta4(400), ())
    missed = []
    for size in (1e-4, 1e-5):
        tangent = size * direction * problem.scales.states
        controls = seeds.seeds(problem.start_point, tangent)
        ends = [flow.end(problem.start_point, control) for control in controls]
        errors = [np.asarray(space.difference(end, problem.start_point)) - tangent for end in ends]
        missed.append([np.linalg.norm(error / problem.scales.states) for error in errors])
    order = np.log10(np.divide(*missed))
    assert len(order) == 16
    if basis != BASES[2]:  # whose functions make circles only nearly
        assert order.min() > 1.35  # a loop of size √δ leaves δ^1.5


def test_a_loop_of_one_plane_has_the_least_effort_for_its_area(problem):
    seeds = BracketLoops(problem, Loops(problem))
    brackets = LieAlgebra(problem.system)
    brackets.deepen()
    area = 1e-3
    tangent = area * brackets.layers[1].at(problem.start_point[None])[0][:, 0]
    efforts = [
        Control(problem.basis, control, 1.0).effort for control in seeds.seeds(problem.start_point, tangent)
    ]
    np.testing.assert_allclose(efforts[:8], 4 * np.pi * area, rtol=1e-9)
    np.testing.assert_allclose(efforts[8:], 8 * np.pi * area, rtol=1e-9)  # two turns


def test_brackets_of_the_second_degree_are_not_enough_for_a_car():
    ends = {"x": 0, "y": 0, "theta": 0, "phi": 0}, {"x": 1, "y": 1, "theta": 0, "phi": 0}
    assert known_loops(nhpocp.PlanningProblem(system=nhpocp.Car(), start=ends[0], goal=ends[1])) is None
    assert known_loops(paper_problem()) is not None
