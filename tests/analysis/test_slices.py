"""Maps of singularities: coordinates, values, and a singular surface that is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.analysis.slices import (
    RESOLUTION,
    Span,
    chosen,
    coordinates,
    livelier,
    placed,
    singularity_map,
)
from nhpocp.errors import InvalidProblemError
from nhpocp.state_space import StateSpace, rotation, scalar, vector
from nhpocp.systems.numeric import numeric_system
from tests.conftest import paper_problem

SPACE = StateSpace([vector("position", 3, "length"), rotation("orientation")])
MIXED = StateSpace(
    [scalar("x", "length"), vector("p", 2, "length"), vector("q", 4), rotation("A"), rotation("B")]
)


def the_map(problem, names, limits=((None, None), (None, None)), base=None):
    space = problem.system.state_space
    spans = [Span(c, *ends) for c, ends in zip(chosen(space, names), limits, strict=True)]
    base = problem.start_point if base is None else base
    shown = np.array([problem.start_point, problem.goal_point])
    return singularity_map(problem.system, spans, base, "start", shown, problem.scale)


def test_names_long_and_short():
    known = coordinates(SPACE)
    assert {"x", "y", "z", "position[0]", "roll", "pitch", "yaw", "orientation.yaw"} <= set(known)
    assert known["x"] == known["position[0]"]
    assert known["yaw"] == known["orientation.yaw"]


def test_short_names_that_two_would_share_are_nobodys():
    known = coordinates(MIXED)
    assert "yaw" not in known
    assert {"A.yaw", "B.yaw", "p[0]", "y", "q[3]"} <= set(known)
    assert known["x"].block.name == "x"  # the scalar's own name
    assert known["p[0]"].name == "p[0]"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.permutations(["x", "y", "z", "roll", "pitch", "yaw"]))
def test_placing_changes_what_is_named_and_nothing_else(seed, order):
    random, known = np.random.default_rng(seed), coordinates(SPACE)
    pair, kept = [known[name] for name in order[:2]], [known[name] for name in order[2:]]
    rotated = so3.from_rpy(random.uniform(-1.4, 1.4, 3))
    base = SPACE.pack({"position": random.standard_normal(3), "orientation": rotated})
    values = random.uniform(-1.4, 1.4, (5, 2))
    states = placed(SPACE, base, pair, values)
    for state, row in zip(states, values, strict=True):
        np.testing.assert_allclose([c.of(SPACE, state[None])[0] for c in pair], row, atol=1e-12)
        before = [c.of(SPACE, base[None])[0] for c in kept]
        np.testing.assert_allclose([c.of(SPACE, state[None])[0] for c in kept], before, atol=1e-12)
        turned = state[3:].reshape(3, 3)
        np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)


def test_angles_go_on_past_a_half_turn():
    turns, yaw = np.linspace(0, 3 * np.pi, 40), coordinates(SPACE)["yaw"]
    upright = SPACE.pack({"position": np.zeros(3), "orientation": np.eye(3)})
    states = placed(SPACE, upright, [yaw], turns[:, None])
    np.testing.assert_allclose(yaw.of(SPACE, states), turns, atol=1e-12)


def test_the_liveliest_coordinates_of_the_papers_task():
    problem = paper_problem()
    states = np.array([problem.start_point, problem.goal_point])
    assert [c.name for c in livelier(SPACE, states, problem.scale)] == ["z", "yaw"]


def test_values_are_those_of_the_poses():
    problem = paper_problem("normal75")
    found = the_map(problem, ["x", "yaw"])
    row, column = 40, 117
    values = np.array([[found.first_values[column], found.second_values[row]]])
    state = placed(SPACE, problem.start_point, (found.first, found.second), values)
    margins = numeric_system(problem.system).margins(state, problem.scale)
    for name in ("s", "w"):
        assert found.determinants[name].shape == (RESOLUTION, RESOLUTION)
        assert found.determinants[name][row, column] == pytest.approx(margins[f"det_{name}"][0], rel=1e-9)
        assert abs(found.signed[name][row, column]) == pytest.approx(margins[f"sigma_{name}"][0], rel=1e-9)
        assert np.sign(found.signed[name][row, column]) == np.sign(margins[f"det_{name}"][0])


def test_singular_yaw_angles_of_the_symmetric_robot():
    """Vertical rollers, w4 normal, on the axis: det W = 0 where sin ψ = 0, and twice over where cos ψ = B/A.

    There the three legs touch the circle of the platform's joints, seen from above. The double zero keeps its sign, so
    no sampling of signs finds it.
    """
    problem = paper_problem("paper_conjecture")
    found = the_map(problem, ["z", "yaw"])
    touching = found.touching["w"]
    assert len(touching) >= RESOLUTION
    np.testing.assert_allclose(touching[:, 1], -np.arccos(5 / 15), atol=1e-6)
    signed, yaws = found.signed["w"], found.second_values
    assert (signed[yaws < -1e-9] > 0).all()
    assert (signed[yaws > 1e-9] < 0).all()
    data = found.to_json()["matrices"]
    assert data["w"]["changes_sign"]
    assert data["w"]["touches_zero"]
    assert not data["s"]["changes_sign"]
    assert not data["s"]["touches_zero"]


def test_default_keeps_clear_of_both_singularities_on_its_slice():
    found = the_map(paper_problem(), ["z", "yaw"])
    for surface in found.to_json()["matrices"].values():
        assert not surface["changes_sign"]
        assert not surface["touches_zero"]
        assert surface["least_sigma"] > 0.2


def test_limits_are_kept_or_chosen_around_what_is_shown():
    problem = paper_problem()
    found = the_map(problem, ["yaw", "z"], ((-1.0, 0.5), (None, None)))
    assert (found.first_values[0], found.first_values[-1]) == (-1.0, 0.5)
    assert found.second_values[0] < 25
    assert found.second_values[-1] > 35
    assert set(found.fixed()) == {"x", "y", "roll", "pitch"}


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["z", "tilt"], "no coordinate 'tilt'; there are x, y, z, roll, pitch, yaw"),
        (["z"], "takes two coordinates"),
        (["z", "position[2]"], "takes two coordinates"),
        (["x", "y", "z"], "takes two coordinates"),
    ],
)
def test_slices_are_checked(names, words):
    with pytest.raises(InvalidProblemError) as caught:
        chosen(SPACE, names)
    assert words in str(caught.value)


def test_limits_in_the_wrong_order_are_refused():
    with pytest.raises(InvalidProblemError, match="expected low < high"):
        the_map(paper_problem(), ["x", "y"], ((1.0, 1.0), (None, None)))
