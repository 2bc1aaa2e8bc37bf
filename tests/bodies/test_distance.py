"""The distance of two bodies against the Flexible Collision Library, least squares, differences and its own laws."""

import tracemalloc
from dataclasses import replace
from itertools import product

import casadi as ca
import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nhpocp.bodies import hull
from nhpocp.bodies.distance import distance
from nhpocp.bodies.hull import HalfSpace, Hull
from nhpocp.verification.distances import by_fcl, by_least_squares, way_out

PAIRS = 10_000
TRIANGLE = np.array([[1.0, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0]])
CLOUD = np.random.default_rng(5).normal(size=(6, 3))


def placed(shape, rng):
    """A hull somewhere, turned."""
    reach = rng.uniform(-2.5, 2.5, shape.dimension)
    if shape.dimension == 2:
        angle = rng.uniform(0, 7)
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    else:
        turned = Rotation.random(random_state=rng).as_matrix()
    return shape.moved(reach, turned)


SPACE = {
    "ball": hull.ball(np.zeros(3), 0.3),
    "capsule": hull.capsule(np.array([0, 0, -1.0]), np.array([0, 0, 1.2]), 0.2),
    "plate": hull.polygon(list(TRIANGLE), 0.1),
    "box": hull.box(np.zeros(3), np.eye(3), [0.5, 0.7, 0.3]),
    "prism": hull.prism(list(TRIANGLE), np.array([0, 0, 0.4])),
    "polyhedron": hull.polyhedron(0.6 * CLOUD),
}
PLANE = {
    "disc": hull.ball(np.zeros(2), 0.3),
    "bar": hull.capsule(np.array([-1.0, 0]), np.array([1.2, 0]), 0.2),
    "rectangle": hull.box(np.zeros(2), np.eye(2), [0.5, 0.7]),
    "polygon": hull.polygon(list(TRIANGLE[:, :2])),
}
COMBINED = [
    (one, other)
    for shapes in (SPACE, PLANE)
    for i, one in enumerate(shapes.values())
    for other in list(shapes.values())[i:]
]


def functions(first, second):
    """(corners of both, a motion of the first) ↦ distance, and its gradient by the motion; as solvers have them."""
    numbers = first.dimension
    a = [ca.SX.sym("a", numbers) for _ in first.corners]
    b = [ca.SX.sym("b", numbers) for _ in second.corners]
    x, motion = ca.vertcat(*a, *b), ca.SX.sym("motion", 6 if numbers == 3 else 3)
    turn = motion[numbers:]
    turned = ca.skew(turn) if numbers == 3 else ca.vertcat(ca.horzcat(0, -turn), ca.horzcat(turn, 0))
    moved = tuple(corner + motion[:numbers] + turned @ corner for corner in a)
    value = distance(replace(first, corners=moved), replace(second, corners=tuple(b)))
    return ca.Function("d", [x, motion], [value]), ca.Function("g", [x, motion], [ca.gradient(value, motion)])


def corners(*hulls):
    return np.concatenate([np.ravel(each.corners) for each in hulls])


@pytest.mark.parametrize(("first", "second"), COMBINED)
def test_it_is_that_of_an_independent_library_and_its_derivative_that_of_differences(first, second):
    value, gradient = functions(first, second)
    rng, between = np.random.default_rng(3), by_fcl(fcl)
    count = PAIRS // len(COMBINED) + 1
    hulls = [(placed(first, rng), placed(second, rng)) for _ in range(count)]
    points = np.array([corners(one, other) for one, other in hulls]).T
    still = np.zeros((6 if first.dimension == 3 else 3, count))
    found = value.map(count)(points, still).full().ravel()
    expected = [between(np.array(one.corners), np.array(other.corners)) for one, other in hulls]
    radii = first.radius + second.radius
    apart = np.array(expected) > 1e-6
    assert apart.sum() > 0.5 * count
    np.testing.assert_allclose(found[apart], np.array(expected)[apart] - radii, atol=1e-9)
    deep = np.array([way_out(np.array(one.corners), np.array(other.corners)) for one, other in hulls])
    np.testing.assert_allclose(found[~apart], -deep[~apart] - radii, atol=1e-6)
    slopes = gradient.map(count)(points, still).full()
    assert np.isfinite(slopes).all()
    step, direction = 1e-6, rng.normal(size=still.shape)
    sides = [value.map(count)(points, sign * step * direction).full().ravel() for sign in (-1, 1)]
    smooth = np.abs(sides[0] + sides[1] - 2 * found) < 1e-8  # else a kink lies between
    assert smooth.mean() > 0.9
    differences = (sides[1] - sides[0]) / (2 * step)
    np.testing.assert_allclose((slopes * direction).sum(axis=0)[smooth], differences[smooth], atol=1e-2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_bodies_that_stand_square_to_each_other_are_no_exception(dimension):
    """The library's own answer is too large for one pair of five, of rectangles, by up to their size."""
    rng, between = np.random.default_rng(5), by_fcl(fcl)
    signs = np.array(list(product((-1.0, 1.0), repeat=dimension)))
    order = [0, 1, 3, 2] if dimension == 2 else slice(None)
    told = 0
    for _ in range(150):
        first, second = (signs[order] * rng.uniform(0.05, 2, dimension) for _ in range(2))
        away = np.round(rng.normal(size=dimension) * 3) * [1, *([0] if dimension == 2 else [1, 1])]
        gaps = np.abs(away) - first.max(axis=0) - second.max(axis=0)
        if (gaps > 0).any():
            told += 1
            assert between(first, second + away) == pytest.approx(
                np.linalg.norm(np.maximum(gaps, 0)), abs=1e-12
            )
    assert told > 50


@given(seed=st.integers(0, 10**6), tilt=st.floats(-17, -1))
@settings(max_examples=60, deadline=None)
def test_plates_and_bars_in_nearly_one_plane_are_told_apart(seed, tilt):
    rng = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(10**tilt * rng.normal(size=3)).as_matrix()
    reach = rng.uniform(-2, 2, 3) * [1, 1, rng.choice([0, 10**tilt])]
    other = TRIANGLE @ turned.T + reach
    for second in (hull.polygon(list(other)), hull.capsule(other[0], other[1], 0.0)):
        least = by_least_squares(TRIANGLE, np.array(second.corners))
        found = float(distance(hull.polygon(list(TRIANGLE)), second))
        assert found == pytest.approx(least, abs=1e-9) if least > 1e-7 else found < 1e-6


def test_the_way_out_is_the_shortest():
    """An overlapping body moved by less than its depth, whichever way, still overlaps; by its depth some way is out."""
    rng = np.random.default_rng(8)
    value, _ = functions(SPACE["box"], SPACE["prism"])
    deep = 0
    for _ in range(30):
        first, second = placed(SPACE["box"], rng), placed(SPACE["prism"], rng)
        middle = np.mean(first.corners, axis=0) - np.mean(second.corners, axis=0)
        x = corners(first, second.moved(middle + rng.uniform(-0.2, 0.2, 3), np.eye(3)))
        depth = -float(value(x, np.zeros(6)))
        deep += depth > 0.3
        directions = rng.normal(size=(3, 200))
        ways = np.vstack([directions / np.linalg.norm(directions, axis=0), np.zeros((3, 200))])
        assert depth > 0
        assert (value.map(200)(x, 0.98 * depth * ways).full().ravel() < 0).all()
        assert value.map(200)(x, 1.3 * depth * ways).full().ravel().max() > 0
    assert deep


@pytest.mark.parametrize(
    ("one", "other"), [(one, "box") for one in SPACE] + [(one, "rectangle") for one in PLANE]
)
def test_a_box_is_as_far_as_the_hull_of_its_corners(one, other):
    """Inside and outside; along its axes, where several features are equally near, too."""
    first, second = ({**SPACE, **PLANE}[name] for name in (one, other))
    rng = np.random.default_rng(4)
    for k in range(12):
        here, there = placed(first, rng), placed(second, rng)
        if k % 3 == 0:  # side by side
            here = first.moved(
                np.eye(first.dimension)[k // 3 % first.dimension] * rng.uniform(0, 2), np.eye(first.dimension)
            )
            there = second
        plain = replace(there, half=())
        assert float(distance(here, there)) == pytest.approx(float(distance(here, plain)), abs=1e-9)
        assert float(distance(there, here)) == pytest.approx(float(distance(here, there)), abs=1e-9)


def test_a_half_space_is_left_along_its_normal():
    wall = HalfSpace(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]))
    bar = hull.capsule(np.array([0, 0, 3.0]), np.array([5, 0, 2.5]), 0.5)
    assert float(distance(bar, wall)) == pytest.approx(1.0)
    assert float(distance(bar.moved(np.array([0, 0, -3.0]), np.eye(3)), wall)) == pytest.approx(-2.0)


def test_touching_bodies_leave_no_number_that_is_none():
    """Where cores meet, distance and two derivatives are finite: optimizers pass such points."""
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 3)
    value = distance(hull.capsule(a, b, 0.1), hull.capsule(ca.DM([-1, 0, 0]), ca.DM([1, 0, 0]), 0.1))
    x = ca.vertcat(a, b)
    hessian = ca.Function("h", [x], [value, ca.gradient(value, x), ca.hessian(value, x)[0]])
    for numbers in hessian(np.array([0, -1.0, 0, 0, 1, 0])):
        assert np.isfinite(numbers.full()).all()


def test_a_hull_of_points_has_the_rank_of_its_points():
    box = np.array(SPACE["box"].corners)
    made = [hull.hull_of(points) for points in (box[:1], box[:2], box[:4], box)]
    assert [each.rank for each in made] == [0, 1, 2, 3]
    solid: Hull = made[-1]
    assert (len(solid.corners), len(solid.edges), len(solid.faces)) == (8, 12, 6)
    assert (len(solid.directions), len(solid.sides)) == (3, 3)


def test_the_hull_of_a_large_cloud_takes_little_memory():
    cloud = np.vstack([SPACE["box"].corners, np.random.default_rng(6).uniform(-0.3, 0.3, (3000, 3))])
    tracemalloc.start()
    made = hull.hull_of(cloud)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(made.corners) == 8
    assert most < 10e6  # bytes; a square matrix of points would take 75e6


@pytest.mark.parametrize("noise", [0, 1e-16, 1e-12, 1e-10, 1e-9])
def test_corners_along_an_edge_are_none(noise):
    """As meshes have them that are finer than their shape, and rounding lifts them."""
    rng, grid = (
        np.random.default_rng(7),
        np.array([place for place in product((-1, 0, 1), repeat=3) if any(place)]),
    )
    for points, count in ((grid, 8), (grid[grid[:, 2] == 1], 4)):
        for _ in range(4):
            turned = points @ Rotation.random(random_state=rng).as_matrix().T
            body = hull.hull_of(turned + noise * rng.normal(size=points.shape))
            assert len(body.corners) == count
            for _ in range(8):
                bar = hull.capsule(2 * rng.normal(size=3), 2 * rng.normal(size=3), 0.0)
                least, found = by_least_squares(np.array(bar.corners), turned), float(distance(bar, body))
                assert found == pytest.approx(least, abs=1e-8) if least > 1e-6 else found < 1e-8
