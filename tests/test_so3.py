"""Laws of SO(3): exp and log, their Jacobians, the other ways to write a rotation."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nhpocp import so3
from nhpocp.errors import InvalidProblemError, OrientationAtPiError

LAW = settings(max_examples=60, deadline=None, derandomize=True)
ANGLES = [0.0, 1e-9, 1e-4, 0.0316, 0.0317, 0.3, 0.4999999, 0.5000001, 1.0, 2.0, np.pi / 2, 3.0]
NEAR_HALF_TURN = [np.pi - 1e-3, np.pi - 1e-7]
AXIS = np.array([2.0, -3.0, 6.0]) / 7

entries = st.floats(-3, 3, allow_subnormal=False)
vectors = st.tuples(entries, entries, entries).map(np.array)
axes = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
angles = st.one_of(st.sampled_from([*ANGLES, *NEAR_HALF_TURN]), st.floats(0, 3.1))
small_rotation_vectors = st.builds(lambda axis, angle: angle * axis, axes, st.floats(0, 3.0))


def derivative(curve, step=1e-2):
    """First derivative at 0 of a smooth curve, sixth-order central difference."""
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    return sum(w * (curve(k * step) - curve(-k * step)) for k, w in weights.items()) / step


def casadi_log_jacobian(rotation, symbol=ca.SX):
    """d log(exp(δ) R)/dδ at δ = 0, by CasADi through R's nine entries."""
    delta = symbol.sym("delta", 3)
    value = so3.log((ca.DM.eye(3) + so3.hat(delta)) @ ca.DM(rotation))
    return np.array(ca.Function("j", [delta], [ca.jacobian(value, delta)])(0))


@LAW
@given(axes, angles)
def test_log_undoes_exp(axis, angle):
    w = angle * axis
    assert np.abs(so3.log(so3.exp(w)) - w).max() < 5e-15
    assert so3.angle(so3.exp(w)) == pytest.approx(angle, abs=1e-14)


@LAW
@given(axes, st.floats(0, 6))
def test_exp_is_a_rotation_and_agrees_with_scipy(axis, angle):
    rotation = so3.exp(angle * axis)
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-14
    assert np.abs(rotation - Rotation.from_rotvec(angle * axis).as_matrix()).max() < 1e-14


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-5])
def test_small_rotations_keep_their_relative_accuracy(angle):
    assert np.abs(so3.log(so3.exp(angle * AXIS)) - angle * AXIS).max() <= 4e-16 * angle


def inverse_left_jacobian(w):
    """J_l(w)⁻¹, with d exp(w) = [J_l(w) dw] exp(w), in closed form; its series to w⁴ where that loses digits."""
    angle, skew = np.linalg.norm(w), so3.hat(w)
    half = 0.5 * angle
    quotient = (1 - half / np.tan(half)) / angle**2 if angle > 1e-2 else 1 / 12 + angle**2 / 720
    return np.eye(3) - 0.5 * skew + quotient * (skew @ skew)


@pytest.mark.parametrize("symbol", [ca.SX, ca.MX])
@pytest.mark.parametrize("angle", [*ANGLES, *NEAR_HALF_TURN])
def test_the_jacobian_of_log_is_the_inverse_left_jacobian(angle, symbol):
    w = angle * AXIS
    found = casadi_log_jacobian(so3.exp(w), symbol)
    assert np.isfinite(found).all()
    expected = inverse_left_jacobian(w)
    tolerance = 1e-7 if np.pi - angle < 1e-5 else 1e-11 if np.pi - angle < 0.01 else 1e-13
    assert np.abs(found - expected).max() < tolerance


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0316, 0.0317, 0.5, 1.0, 3.0, np.pi - 1e-3])
def test_the_jacobian_of_log_agrees_with_differences(angle):
    rotation, step = so3.exp(angle * AXIS), 1e-4 if angle > 3.1 else 1e-2
    found = casadi_log_jacobian(rotation)
    for column, axis in zip(found.T, np.eye(3), strict=True):
        expected = derivative(lambda s, axis=axis: so3.log(so3.exp(s * axis) @ rotation), step)
        assert np.abs(column - expected).max() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.4999, 0.5001, 3.0])
def test_casadi_differentiates_exp_on_both_sides_of_the_series(angle):
    w, point = ca.SX.sym("w", 3), angle * AXIS
    columns = np.array(ca.Function("j", [w], [ca.jacobian(ca.vec(so3.exp(w)), w)])(point)).T
    for column, axis in zip(columns, np.eye(3), strict=True):
        expected = derivative(lambda s, axis=axis: so3.exp(point + s * axis).T.ravel(), 2e-3)
        assert np.abs(column - expected).max() < 1e-10


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], AXIS])
@pytest.mark.parametrize("missing", [0.0, 1e-9])
def test_log_of_a_half_turn_is_an_error_that_says_so(axis, missing):
    with pytest.raises(OrientationAtPiError, match="half turn"):
        so3.log(so3.exp((np.pi - missing) * np.array(axis, dtype=float)))


@pytest.mark.parametrize("threshold", [0.5, np.arcsin(np.sqrt(1e-3)), np.pi / 2])
def test_nothing_jumps_at_the_series_thresholds(threshold):
    below, above = (1 - 1e-15) * threshold * AXIS, (1 + 1e-15) * threshold * AXIS
    for function in (
        so3.exp,
        lambda w: so3.log(so3.exp(w)),
    ):
        assert np.abs(function(above) - function(below)).max() < 5e-15


@pytest.mark.parametrize("angle", [*ANGLES, np.pi - 1e-3])
def test_numbers_and_symbols_agree(angle):
    w = angle * AXIS
    rotation, quaternion = so3.exp(w), np.r_[np.cos(angle / 2), np.sin(angle / 2) * AXIS]
    cases = {
        w.tobytes(): (so3.hat, so3.exp, so3.from_rpy),
        rotation.tobytes(): (so3.vee, so3.log, so3.to_rpy, so3.angle),
        quaternion.tobytes(): (so3.from_quaternion,),
    }
    for argument, functions in zip((w, rotation, quaternion), cases.values(), strict=True):
        for function in functions:
            expected = np.atleast_1d(function(argument))
            found = [function(ca.DM(argument))]
            for kind in (ca.SX, ca.MX):
                symbol = kind.sym("x", *ca.DM(argument).shape)
                found.append(ca.Function("f", [symbol], [function(symbol)])(argument))
            for value in found:
                value = np.array(ca.densify(value)).reshape(expected.shape)
                assert np.abs(value - expected).max() < 1e-13, function.__name__


@LAW
@given(vectors, vectors)
def test_hat_is_the_cross_product_and_vee_undoes_it(a, b):
    assert np.abs(so3.hat(a) @ b - np.cross(a, b)).max() < 1e-14
    assert np.array_equal(so3.vee(so3.hat(a)), a)
    assert np.array_equal(so3.vee(so3.hat(a) + np.outer(b, b)), so3.vee(so3.hat(a) + np.outer(b, b).T))


@LAW
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_rpy_is_yaw_pitch_roll_about_z_y_x(roll, pitch, yaw):
    rotation = so3.from_rpy(np.array([roll, pitch, yaw]))
    assert np.abs(rotation - Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()).max() < 1e-15
    z, y, x = (so3.exp(a * e) for a, e in zip((yaw, pitch, roll), np.eye(3)[::-1], strict=True))
    assert np.abs(rotation - z @ y @ x).max() < 1e-14
    assert np.abs(so3.to_rpy(rotation) - [roll, pitch, yaw]).max() < 1e-12


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_to_rpy_gives_the_same_rotation_back_in_gimbal_lock(pitch):
    rotation = so3.from_rpy(np.array([0.3, pitch, -0.8]))
    assert np.abs(so3.from_rpy(so3.to_rpy(rotation)) - rotation).max() < 1e-7


@LAW
@given(axes, angles)
def test_from_quaternion_agrees_with_scipy(axis, angle):
    quaternion = np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis]
    expected = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    assert np.abs(so3.from_quaternion(quaternion) - expected).max() < 1e-14
    assert np.abs(so3.from_quaternion(-quaternion) - expected).max() < 1e-14


@LAW
@given(axes, st.one_of(angles, st.just(np.pi)))
def test_to_quaternion_agrees_with_scipy_up_to_half_turns(axis, angle):
    rotation = so3.exp(angle * axis)
    quaternion = so3.to_quaternion(rotation)
    expected = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    assert quaternion[0] >= 0
    assert min(np.abs(quaternion - sign * expected).max() for sign in (1, -1)) < 1e-14
    assert np.abs(so3.from_quaternion(quaternion) - rotation).max() < 1e-14


@LAW
@given(st.lists(entries, min_size=9, max_size=9).map(lambda x: np.reshape(x, (3, 3))))
def test_nearest_is_a_rotation_idempotent_and_nearest(matrix):
    rotation = so3.nearest(matrix)
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-13
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.abs(so3.nearest(rotation) - rotation).max() < 1e-13
    gap = np.linalg.norm(rotation - matrix)
    for axis in np.eye(3):
        for turn in (-0.3, 1e-3, 0.3):
            assert np.linalg.norm(so3.exp(turn * axis) @ rotation - matrix) >= gap - 1e-12


def test_every_way_to_write_a_rotation_means_the_same():
    w = 0.7 * AXIS
    rotation, near = so3.exp(w), 1 + 5e-7
    written = {
        "rpy": so3.to_rpy(rotation).tolist(),
        "quaternion": [near * np.cos(0.35), *(near * np.sin(0.35) * AXIS)],
        "rotvec": w.tolist(),
        "matrix": (near * rotation).tolist(),
    }
    for kind, value in written.items():
        assert np.abs(so3.from_mapping({kind: value}) - rotation).max() < 1e-14, kind


@pytest.mark.parametrize(
    ("value", "path", "words"),
    [
        ({}, None, "no rotation; expected exactly one of rpy"),
        ({"rpy": [0, 0, 0], "rotvec": [0, 0, 0]}, "rotvec", "both rpy and rotvec"),
        ({"euler": [0, 0, 0]}, None, "euler; expected exactly one of rpy"),
        ({"rpy": [0, 0]}, "rpy", "expected finite numbers \\[roll, pitch, yaw\\], got a list of 2"),
        ({"rotvec": [0, 0, 1e200]}, "rotvec", "too large"),
        ({"quaternion": [1, 1, 0, 0]}, "quaternion", "write \\[0.707106781, 0.707106781"),
        ({"matrix": (1.01 * np.eye(3)).tolist()}, "matrix", "no rotation matrix"),
        ({"matrix": (-np.eye(3)).tolist()}, "matrix", "a reflection"),
    ],
)
def test_what_is_no_rotation_is_refused(value, path, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        so3.from_mapping(value)
    assert caught.value.path == path
