"""An edge that is declared free has no invalid pose, robots and vehicles among obstacles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import nhpocp
from nhpocp.solvers.route.edges import STEP, free
from nhpocp.solvers.route.pose_checks import pose_checks
from tests.conftest import paper_problem

FINER = 100  # times as many samples as the edge begins with
PLATFORM = {"leg_radius": 1.0, "thickness": 1.0}


def robot():
    """The paper's, a ball beside its platform, a thin bar between two legs, and its own legs."""
    obstacles = [
        {"sphere": {"centre": [0, 0, 38], "radius": 2}},
        {"capsule": {"from": [14, 14, 0], "to": [14, 14, 60], "radius": 0.2}},
    ]
    bounds = {"distance": 0.3, "leg_length": [15, 70]}
    return paper_problem(**PLATFORM, obstacles=obstacles, bounds=bounds)


def vehicle(system):
    """Among walls, one of which is thinner than a step of the samples is long."""
    rest = dict.fromkeys(system.state_space.names, 0.0)
    obstacles = [
        {"rectangle": {"centre": [1.0, 0.9], "size": [0.02, 1.6]}},
        {"rectangle": {"centre": [2.0, -0.9], "size": [0.4, 1.6], "angle": 0.4}},
        {"polygon": {"corners": [[-1.5, -1.0], [-1.0, -1.0], [-1.0, 1.0]]}},
        {"half_plane": {"point": [0, 2.5], "normal": [0, -1]}},
    ]
    return nhpocp.PlanningProblem(
        system=system, start=rest, goal={**rest, "x": 3.0}, obstacles=obstacles, bounds={"distance": 0.03}
    )


MAKERS = {
    "robot": robot,
    "unicycle": lambda: vehicle(nhpocp.Unicycle()),
    "car": lambda: vehicle(nhpocp.Car()),
}


@cache
def task(name):
    """A problem and its checks."""
    problem = MAKERS[name]()
    return problem, pose_checks(problem, 0.05)


def edge(name, numbers):
    """(checks, a pose, a tangent from it, its size) near the start; numbers: of pose and tangent, between -1 and 1."""
    problem, checks = task(name)
    space, scales = problem.system.state_space, problem.scales.states
    half = space.dimension
    aside, along = np.resize(numbers[:6], half) * scales, np.resize(numbers[6:], half) * scales
    here = np.asarray(space.retract(problem.start_point, aside))
    return checks, here, along, float(np.linalg.norm(along / scales))


NUMBERS = st.lists(st.floats(-1, 1), min_size=12, max_size=12).map(np.array)


@pytest.mark.parametrize("name", MAKERS)
@settings(max_examples=30, deadline=None)
@given(numbers=NUMBERS)
def test_an_edge_that_is_free_has_no_invalid_pose(name, numbers):
    checks, here, tangent, size = edge(name, numbers)
    if not free(checks, here, tangent, size):
        event("refused")
        return
    event("free")
    fractions = np.linspace(0.0, 1.0, FINER * (2 + int(size / STEP)))
    assert checks.slacks(checks.between(here, tangent, fractions)).min() > 0


@pytest.mark.parametrize("name", MAKERS)
def test_some_edges_are_free_and_obstacles_refuse_others(name):
    """Else the law says nothing."""
    random = np.random.default_rng(0)
    _, checks = task(name)
    before = checks.refusals["distance"]
    answers = [free(*edge(name, 0.5 * random.uniform(-1, 1, 12))) for _ in range(60)]
    assert 5 <= sum(answers) <= 55
    assert checks.refusals["distance"] > before


def test_a_wall_thinner_than_a_step_is_seen():
    """From one side of it to the other, no sample of the first ones in it."""
    problem, checks = task("unicycle")
    here = problem.start_point.copy()
    here[:2] = [0.0, 1.2]
    tangent = np.array([2.1, 0.0, 0.0])
    assert not free(checks, here, tangent, float(np.linalg.norm(tangent / problem.scales.states)))
