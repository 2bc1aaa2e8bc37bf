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


def corridor():
    """Posts that are thin beside the problem's scale, between walls that are nearer than they on most of the way."""
    rest = {"x": 0.0, "y": 0.0, "theta": 0.0}
    obstacles = [
        {"half_plane": {"point": [0, 0.35], "normal": [0, -1]}},
        {"half_plane": {"point": [0, -0.35], "normal": [0, 1]}},
        *({"disc": {"centre": [x, y], "radius": 0.05}} for x, y in ((-4, 0.2), (1.5, -0.1), (5, 0))),
    ]
    system = nhpocp.Unicycle()
    return nhpocp.PlanningProblem(
        system=system, start=rest, goal={**rest, "x": 20.0}, obstacles=obstacles, bounds={"distance": 0.02}
    )


MAKERS = {
    "robot": robot,
    "unicycle": lambda: vehicle(nhpocp.Unicycle()),
    "car": lambda: vehicle(nhpocp.Car()),
    "corridor": corridor,
}
# of the scales, how far poses lie from the start: most of a corridor is wall
BESIDE = {"corridor": np.array([0.3, 0.01, 0.1])}


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
    aside, along = (np.resize(part, half) * scales * BESIDE.get(name, 1.0) for part in np.split(numbers, 2))
    here = np.asarray(space.retract(problem.start_point, aside))
    return checks, here, along, float(np.linalg.norm(along / scales))


REACHES = st.sampled_from([1.0, 0.1, 0.02])  # the last of which are shorter than a step
NUMBERS = st.lists(st.floats(-1, 1), min_size=12, max_size=12).map(np.array)


@pytest.mark.parametrize("name", MAKERS)
@settings(max_examples=30, deadline=None)
@given(numbers=NUMBERS, reach=REACHES)
def test_an_edge_that_is_free_has_no_invalid_pose(name, numbers, reach):
    checks, here, tangent, size = edge(name, np.repeat([1.0, reach], 6) * numbers)
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


@pytest.mark.parametrize(
    ("first", "length"), [(0.0, 20.0), (4.0, 1.9)], ids=["in a corridor", "on a short edge"]
)
def test_a_post_is_seen_however_near_the_walls_and_short_the_edge(first, length):
    """Walls are as near at its either side as beside it, and the ends of a short edge are as far from it."""
    problem, checks = task("corridor")
    here, tangent = problem.start_point + np.array([first, 0, 0]), np.array([length, 0.0, 0.0])
    size = float(np.linalg.norm(tangent / problem.scales.states))
    assert (size < STEP) == (length < 2.0)
    assert not free(checks, here, tangent, size)
