"""Laws of R^n × SO(3)^k: packing, moving, comparing."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.errors import InvalidProblemError, OrientationAtPiError
from nhpocp.state_space import StateSpace, rotation, scalar, vector

LAW = settings(max_examples=40, deadline=None, derandomize=True)
SPACES = {
    "pose": StateSpace([vector("position", 3, "length"), rotation("orientation")]),
    "rotation_first": StateSpace([rotation("orientation"), scalar("steer", "angle"), vector("q", 2)]),
    "flat": StateSpace([vector("q", 4)]),
    "two_rotations": StateSpace([rotation("first"), scalar("s", "length"), rotation("second")]),
}

spaces = st.sampled_from(list(SPACES.values()))
seeds = st.integers(0, 2**32 - 1)


def random_values(space, generator):
    def value(block):
        if block.kind == "rotation":
            return so3.exp(generator.normal(size=3))
        return generator.normal(size=block.shape)

    return {block.name: value(block) for block in space.blocks}


def random_point(space, generator):
    return space.pack(random_values(space, generator))


def small_tangent(space, generator):
    """Rotation parts stay below a half turn."""
    return generator.uniform(-1.7, 1.7, size=space.dimension)


@LAW
@given(spaces, seeds)
def test_unpack_and_split_undo_pack(space, seed):
    values = random_values(space, np.random.default_rng(seed))
    point = space.pack(values)
    assert point.shape == (space.size,)
    assert len(space.labels) == len(set(space.labels)) == space.size
    for found in (
        space.unpack(point),
        {k: v[1] for k, v in space.split(np.stack([0 * point, point])).items()},
    ):
        assert list(found) == list(space.names)
        for block in space.blocks:
            assert np.shape(found[block.name]) == block.shape
            assert np.array_equal(found[block.name], values[block.name])


def test_pack_takes_plain_lists():
    space = SPACES["pose"]
    point = space.pack({"position": [1, 2, 3], "orientation": np.eye(3).tolist()})
    assert point.tolist() == [1, 2, 3, 1, 0, 0, 0, 1, 0, 0, 0, 1]


def test_labels_name_every_number_row_by_row():
    assert SPACES["rotation_first"].labels == [
        *(f"orientation[{i}][{j}]" for i in range(3) for j in range(3)),
        "steer",
        "q[0]",
        "q[1]",
    ]


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_slices_tile_points_and_tangents(space):
    points = np.concatenate([np.arange(space.size)[space.point_slice(name)] for name in space.names])
    tangents = np.concatenate([np.arange(space.dimension)[space.tangent_slice(name)] for name in space.names])
    assert points.tolist() == list(range(space.size))
    assert tangents.tolist() == list(range(space.dimension))


@LAW
@given(spaces, seeds)
def test_lower_undoes_lift(space, seed):
    generator = np.random.default_rng(seed)
    point, velocity = random_point(space, generator), generator.normal(size=space.dimension)
    rate = space.lift(point, velocity)
    assert rate.shape == (space.size,)
    assert np.allclose(space.lower(point, rate), velocity, rtol=0, atol=1e-13)


@LAW
@given(spaces, seeds)
def test_lift_is_the_rate_of_retract(space, seed):
    generator = np.random.default_rng(seed)
    point, velocity, step = random_point(space, generator), generator.normal(size=space.dimension), 1e-5
    ahead, behind = space.retract(point, step * velocity), space.retract(point, -step * velocity)
    assert np.allclose((ahead - behind) / (2 * step), space.lift(point, velocity), rtol=0, atol=1e-8)


@LAW
@given(spaces, seeds)
def test_retract_and_difference_undo_each_other(space, seed):
    generator = np.random.default_rng(seed)
    origin, tangent = random_point(space, generator), small_tangent(space, generator)
    point = space.retract(origin, tangent)
    assert np.allclose(space.difference(point, origin), tangent, rtol=0, atol=1e-11)
    assert np.allclose(space.retract(origin, space.difference(point, origin)), point, rtol=0, atol=1e-12)
    assert np.array_equal(space.retract(origin, np.zeros(space.dimension)), origin)


@LAW
@given(spaces, seeds, st.floats(0.1, 50))
def test_distance_is_symmetric_zero_at_home_and_weighs_lengths(space, seed, error_length):
    generator = np.random.default_rng(seed)
    origin, tangent = random_point(space, generator), small_tangent(space, generator)
    point = space.retract(origin, tangent)
    weights = np.array(space.weights(error_length))
    assert weights.shape == (space.dimension,)
    assert space.distance(point, origin, error_length) == pytest.approx(np.linalg.norm(weights * tangent))
    assert space.distance(origin, point, error_length) == pytest.approx(
        space.distance(point, origin, error_length)
    )
    assert space.distance(point, point, error_length) < 1e-13


def test_only_lengths_are_divided_by_the_error_length():
    assert SPACES["two_rotations"].weights(4.0) == [1, 1, 1, 0.25, 1, 1, 1]
    assert SPACES["flat"].weights(4.0) == [1, 1, 1, 1]


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_numbers_and_symbols_agree(space, kind):
    generator = np.random.default_rng(4)
    origin, tangent = random_point(space, generator), small_tangent(space, generator)
    point = space.retract(origin, tangent)
    x, y, d = kind.sym("x", space.size), kind.sym("y", space.size), kind.sym("d", space.dimension)
    expressions = [
        space.pack(space.unpack(x)),
        space.lift(x, d),
        space.lower(x, y),
        space.retract(x, d),
        space.difference(y, x),
        space.distance(y, x, 3.0),
    ]
    found = ca.Function("f", [x, y, d], expressions)(origin, point, tangent)
    expected = [
        origin,
        space.lift(origin, tangent),
        space.lower(origin, point),
        space.retract(origin, tangent),
        space.difference(point, origin),
        space.distance(point, origin, 3.0),
    ]
    for value, number in zip(found, expected, strict=True):
        assert np.allclose(np.array(value).ravel(), number, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"position": np.zeros(3)}, "missing: orientation"),
        ({"position": np.zeros(3), "orientation": np.eye(3), "speed": 1.0}, "unknown: speed"),
        ({}, "missing: position, orientation"),
    ],
)
def test_missing_and_unknown_names_are_named(values, words):
    with pytest.raises(InvalidProblemError, match=words):
        SPACES["pose"].pack(values)


def test_difference_of_a_half_turn_is_an_error():
    space, eye = SPACES["pose"], np.eye(3)
    here = space.pack({"position": np.zeros(3), "orientation": np.diag([1.0, -1, -1])})
    with pytest.raises(OrientationAtPiError):
        space.difference(here, space.pack({"position": np.zeros(3), "orientation": eye}))


def test_spaces_are_equal_by_their_blocks():
    again = StateSpace([vector("position", 3, "length"), rotation("orientation")])
    assert again == SPACES["pose"]
    assert hash(again) == hash(SPACES["pose"])
    assert again != SPACES["flat"]
    assert "orientation: rotation[3, 3]" in repr(again)
