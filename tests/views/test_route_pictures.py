"""Routes in pictures, reports and animations, and the trees of a search that found none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba

import nhpocp
from nhpocp.comparison import Entry
from nhpocp.flow.simulation import simulate
from nhpocp.outcome import Outcome
from nhpocp.views import figures, routes
from nhpocp.views.animation import legend
from nhpocp.views.overlays import overlays
from nhpocp.views.scene import scene
from tests.views.test_figures import good, spinner, toy, words_of


def along_a_route() -> nhpocp.Solution:
    """A plan whose route turns between two poses beside start and goal."""
    problem = good().problem
    space = problem.system.state_space
    middle = space.retract(problem.start_point, np.array([3.0, 0.0, 2.0, 0.0, 0.4, 0.0]))
    route = [[float(x) for x in pose] for pose in (problem.start_point, middle, problem.goal_point)]
    return replace(good(), details={"route": route})


def tree(poses: Any) -> dict[str, Any]:
    return {"poses": np.asarray(poses).tolist(), "parents": [0, *range(len(poses) - 1)], "grown": 777}


def searched(solution: nhpocp.Solution, scale: float = 0.2) -> nhpocp.Solution:
    """A failure of a search whose trees have five poses each."""
    problem, random = solution.problem, np.random.default_rng(0)
    space = problem.system.state_space
    trees = {}
    for name, root in (("start", problem.start_point), ("goal", problem.goal_point)):
        steps = scale * random.normal(size=(4, space.dimension))
        trees[name] = tree([root, *(space.retract(root, step) for step in steps)])
    return replace(solution, details={"trees": trees}, outcome=Outcome.NOT_REACHED)


def test_the_route_is_a_pale_line_over_the_path():
    figure = figures.robot(along_a_route())
    pale = to_rgba(routes.ROUTE["color"])[:3]
    for axes in figure.axes:
        (line,) = [line for line in axes.lines if to_rgba(line.get_color())[:3] == pale]
        x, y, z = line.get_data_3d()
        assert len(x) == 2 * routes.PARTS + 1
        np.testing.assert_allclose([x[routes.PARTS], y[routes.PARTS], z[routes.PARTS]], [3, 0, 27])
        assert line.get_zorder() > max(other.get_zorder() for other in axes.lines if other is not line)
    words = [[text.get_text() for text in f.legends[0].get_texts()] for f in (figure, figures.robot(good()))]
    assert "route" in words[0]
    assert "route" not in words[1]


def test_its_poses_turn_on_the_way():
    states = routes.route_states(along_a_route())
    turned = along_a_route().problem.system.state_space.split(states)["orientation"]
    np.testing.assert_allclose(
        turned.transpose(0, 2, 1) @ turned, np.tile(np.eye(3), (len(turned), 1, 1)), atol=1e-9
    )
    assert np.ptp(turned[: routes.PARTS, 0, 2]) > 0.3


def test_animation_and_report_show_it():
    solution = along_a_route()
    (part,) = [part for part in scene(solution, 11)["parts"] if part["name"] == "route"]
    assert np.shape(part["values"]) == (1, 2 * routes.PARTS + 1, 3)
    assert not [part for part in scene(good(), 11)["parts"] if part["name"] == "route"]
    assert ("route", routes.ROUTE["color"]) in legend(solution)
    (overlay,) = overlays(entries(solution), ["one"], {"path"})
    assert "route of poses" in overlay.caption


def entries(*solutions: nhpocp.Solution) -> list[Any]:
    return [Entry.of(solution) for solution in solutions]


@pytest.mark.parametrize("case", [good, toy, spinner], ids=lambda case: case.__name__)
def test_trees_are_drawn_with_roots_and_edges(case):
    solution = searched(case())
    assert "trees" in figures.names_of(solution)
    assert "trees" not in figures.names_of(case())
    figure = figures.trees(solution)
    assert "777 from the start and 777 from the goal" in words_of(figure)
    for axes in figure.axes:
        assert [len(c.get_segments()) for c in axes.collections if isinstance(c, LineCollection)] == [5, 5]
        assert {"start", "goal"} <= {text.get_text() for text in axes.get_legend().get_texts()}


def test_a_report_shows_them_once():
    solution = searched(good())
    (overlay,) = overlays(entries(solution, good()), ["first", "second"], {"trees"})
    assert "of first" in overlay.caption
    assert overlays(entries(good()), ["second"], {"trees"}) == []


@pytest.mark.parametrize(
    "details",
    [
        {"trees": 3},
        {"trees": {"start": {"poses": [[1, 2]], "parents": [0]}}},
        {"trees": {"start": {"poses": [], "parents": []}}},
        {"trees": {"start": {"poses": [[0.0] * 12], "parents": [5]}}},
        {"route": "none"},
        {"route": [[float("nan")] * 12] * 2},
        {"route": [[0.0] * 12]},
    ],
)
def test_what_is_stored_otherwise_draws_nothing(details):
    solution = replace(good(), details=details)
    assert not routes.has_trees(solution)
    assert routes.route_places(solution) is None


def test_trees_half_a_turn_from_the_goal_are_drawn_without_their_roots():
    problem = good().problem
    space = problem.system.state_space
    turned = np.asarray(space.retract(problem.goal_point, np.array([0, 0, 0, 0, 0, np.pi])))
    start = dict(zip(space.names, space.unpack(turned).values(), strict=True))
    figure = figures.trees(searched(replace(good(), problem=replace(problem, start=start))))
    places = [line.get_xydata() for axes in figure.axes for line in axes.lines if len(line.get_xdata()) == 5]
    assert any(np.isnan(shown[0]).any() and np.isfinite(shown[1:]).all() for shown in places)


def test_a_distance_bound_is_drawn_however_far_off_it_is():
    obstacles = [{"rectangle": {"centre": [20, 0], "size": [1, 1]}}]
    problem = nhpocp.PlanningProblem(
        system=nhpocp.Unicycle(),
        start={"x": 0, "y": 0, "theta": 0},
        goal={"x": 1, "y": 0, "theta": 0},
        obstacles=obstacles,
        bounds={"distance": 0.05},
        initial=[[1, 0, 0, 0, 0], [0, 0, 0, 0, 0]],
    )
    motion = simulate(problem, problem.control(problem.initial))
    (axes,) = figures.distances(replace(toy(), problem=problem, trajectory=motion.trajectory)).axes
    low, high = axes.get_ylim()
    assert low < 0.05 < 18 < high
    assert any(np.allclose(line.get_ydata(), 0.05) for line in axes.lines)
