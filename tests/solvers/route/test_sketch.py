"""What is kept of routes and of trees that did not meet, and that solutions carry it."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import nhpocp
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.route.find_route import find_route
from nhpocp.solvers.route.rrt_connect import Trees
from nhpocp.solvers.route.sketch import MOST, sketched_trees

REST = {"x": 0.0, "y": 0.0, "theta": 0.0}
HEDGE = {"half_plane": {"point": [0, 0.9], "normal": [0, -1]}}
OTHER_HEDGE = {"half_plane": {"point": [0, -0.9], "normal": [0, 1]}}


def corridor(*walls):
    """A unicycle that has to get from one end to the other."""
    return nhpocp.PlanningProblem(
        system=nhpocp.Unicycle(),
        start=REST,
        goal={**REST, "x": 3.0},
        obstacles=[HEDGE, OTHER_HEDGE, *walls],
        bounds={"distance": 0.05},
        pictures=False,
    )


@pytest.fixture(scope="module")
def closed():
    """Trees on either side of a wall."""
    problem = corridor({"rectangle": {"centre": [1.5, 0], "size": [0.3, 2.5]}})
    return problem, find_route(problem, 1.0, 0)


def test_trees_that_do_not_meet_are_kept_with_where_each_pose_grew_from(closed):
    problem, search = closed
    assert search.route is None
    for root, poses, parents in zip(
        (problem.start_point, problem.goal_point),
        (search.trees.start, search.trees.goal),
        search.trees.parents,
        strict=True,
    ):
        np.testing.assert_allclose(poses[0], root, atol=1e-12)
        assert parents[0] == 0
        assert len(poses) == len(parents) > 5
        assert (np.flatnonzero(parents == np.arange(len(parents))) == [0]).all()  # every other grew from one
    sides = search.trees.start[:, 0], search.trees.goal[:, 0]
    assert sides[0].max() < 1.5 < sides[1].min()


def test_of_large_trees_some_poses_are_kept_and_hang_together():
    grown = 1000
    poses = np.column_stack([np.arange(grown), np.zeros(grown)])
    trees = Trees(None, poses, poses[:1], (np.maximum(np.arange(grown) - 1, 0), np.zeros(1, dtype=int)))
    kept = sketched_trees(trees)["start"]
    assert len(kept["poses"]) == MOST == len(kept["parents"])
    assert kept["grown"] == grown
    assert kept["parents"][1:] == list(range(MOST - 1))  # a path remains one
    orphan = Trees(None, poses, poses[:1], (np.arange(grown), np.zeros(1, dtype=int)))
    assert sketched_trees(orphan)["start"]["parents"] == list(range(MOST))  # which have no edge


def test_a_plan_along_a_route_keeps_its_waypoints_and_another_does_not(tmp_path):
    problem = corridor()
    solver = Auto(Continuation(step_rule=Adaptive()), restarts=0, route="always")
    plan = nhpocp.solve(problem, solver)
    assert plan.converged, plan.message
    waypoints = np.array(plan.details["route"])
    np.testing.assert_array_equal(waypoints[[0, -1]], [problem.start_point, problem.goal_point])
    nhpocp.save_solution(plan, tmp_path / "plan")
    stored = json.loads((tmp_path / "plan" / "solution.json").read_text())
    assert stored["details"]["route"] == waypoints.tolist()
    assert "route" not in nhpocp.solve(problem, Auto(solver.continuation, route="never")).details


def test_a_failure_keeps_the_trees_and_says_what_they_saw(closed, monkeypatch):
    problem, search = closed
    monkeypatch.setattr("nhpocp.solvers.continuation.along_routes.find_route", lambda *_: search)
    lame = Continuation(step_rule=Adaptive(), max_iterations=2)
    ended = nhpocp.solve(problem, Auto(lame, restarts=0, route="always"))
    assert not ended.converged
    assert ended.details["trees"] == sketched_trees(search.trees)
    assert "o route was found in" in ended.message
    assert re.search(r"in x and \S+ in y and \S+ deg in theta", ended.message)
    assert re.search(r"most refused by distance \(\d+ of \d+\)", ended.message)
