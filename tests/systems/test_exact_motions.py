"""Motions of the systems that are known in closed form."""

from __future__ import annotations

from math import acos, pi, sqrt

import numpy as np
import pytest

from nhpocp import so3
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.systems.free_nilpotent_36 import FreeNilpotent36
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.rolling_sphere import RollingSphere
from nhpocp.systems.sphere_on_sphere import SphereOnSphere
from nhpocp.systems.suslov_joint import SuslovJoint
from nhpocp.systems.system import System
from nhpocp.systems.unicycle import Unicycle
from nhpocp.systems.veselova_joint import VeselovaJoint
from nhpocp.verification.replay import Path, replay
from tests.conftest import Turntable


def run(system: System, start: dict, control: Control) -> Path:
    point = np.asarray(system.state_space.pack({k: np.asarray(v, dtype=float) for k, v in start.items()}))
    return replay(numeric_system(system), control, point)


def end(system: System, start: dict, control: Control) -> dict:
    return system.state_space.unpack(run(system, start, control)(np.array([control.horizon]))[0])


def constants(*values: list[float], horizon: float) -> Control:
    """One value after another, each for the same time."""
    return Control(PiecewiseConstant(len(values)), np.array(values).T, horizon)


def test_a_loop_lifts_by_twice_its_area():
    square = constants([1, 0], [0, 1], [-1, 0], [0, -1], horizon=8)  # side 2, turned about anticlockwise
    found = end(Heisenberg(scale=0.7), {"x": 0.3, "y": -0.2, "z": 1}, square)
    assert [found["x"], found["y"]] == pytest.approx([0.3, -0.2])
    assert found["z"] == pytest.approx(1 + 0.7 * 2 * 4)


def test_the_free_system_sums_up_the_vector_of_its_area():
    triangle = constants([1, 0, 0], [-1, 1, 0], [0, -1, 1], [0, 0, -1], horizon=4)
    found = end(FreeNilpotent36(), {"x": [0, 0, 0], "z": [0, 0, 0]}, triangle)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])
    area = 0.5 * np.cross(corners[:-1], corners[1:]).sum(axis=0)
    np.testing.assert_allclose(found["x"], 0, atol=1e-11)
    np.testing.assert_allclose(found["z"], area, atol=1e-11)


def test_a_unicycle_drives_circles():
    found = end(Unicycle(), {"x": 1, "y": 2, "theta": 0.5}, constants([3, 2], horizon=pi / 2))
    assert found["theta"] == pytest.approx(0.5 + pi)
    centre = np.array([1 - 1.5 * np.sin(0.5), 2 + 1.5 * np.cos(0.5)])
    np.testing.assert_allclose([found["x"], found["y"]], 2 * centre - [1, 2], atol=1e-11)


@pytest.mark.parametrize("joint", [VeselovaJoint(), SuslovJoint()], ids=lambda joint: joint.model)
def test_two_quarter_turns_about_two_axes(joint):
    """Veselova: the second about the socket's y; Suslov: about the ball's, which the first has turned."""
    turned = end(joint, {"orientation": np.eye(3)}, constants([pi / 2, 0], [0, pi / 2], horizon=2))
    x, y = so3.exp(np.array([pi / 2, 0, 0])), so3.exp(np.array([0, pi / 2, 0]))
    expected = y @ x if isinstance(joint, VeselovaJoint) else x @ y
    # both halves last for one, so each turns by π/2
    np.testing.assert_allclose(turned["orientation"], expected, atol=1e-11)


def test_the_joints_are_each_others_transpose():
    control = Control(Fourier(2), np.random.default_rng(3).standard_normal((2, 5)))
    back = Control(Fourier(2), -np.asarray(control.coefficients))
    start = so3.exp(np.array([0.3, -0.7, 0.4]))
    veselova = end(VeselovaJoint(), {"orientation": start}, control)["orientation"]
    suslov = end(SuslovJoint(), {"orientation": start.T}, back)["orientation"]
    np.testing.assert_allclose(suslov, veselova.T, atol=1e-11)


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_rolling_around_a_square_turns_by_a_third(radius):
    """Sides of a quarter of the circumference: four quarter turns about x and y in turn make exactly 120°."""
    square = constants([radius, 0], [0, radius], [-radius, 0], [0, -radius], horizon=2 * pi)
    found = end(RollingSphere(radius=radius), {"position": [0, 0], "orientation": np.eye(3)}, square)
    np.testing.assert_allclose(found["position"], 0, atol=1e-10)
    cosine = (np.trace(found["orientation"]) - 1) / 2
    assert acos(cosine) == pytest.approx(2 * pi / 3, abs=1e-9)


@pytest.mark.parametrize("contact", ["rubber", "marble"])
def test_what_touches_stands_still(contact):
    """The material point that touches, followed through its cusp: it leaves straight up, as the square of time."""
    system = RollingSphere(contact=contact, radius=1.3)
    inputs = system.input_space.size
    control = Control(Fourier(2), np.random.default_rng(5).standard_normal((inputs, 5)))
    path = run(system, {"position": [0.2, 0.1], "orientation": so3.exp(np.array([0.2, 0.5, -0.3]))}, control)
    now, step = 0.4, 1e-3

    def centre_and_turn(time: float) -> tuple[np.ndarray, np.ndarray]:
        values = system.state_space.unpack(path(np.array([time]))[0])
        return np.array([*values["position"], 1.3]), values["orientation"]

    centre, turn = centre_and_turn(now)
    mark = turn.T @ (np.array([centre[0], centre[1], 0.0]) - centre)  # body coordinates
    places = {}
    for k in (-2, -1, 1, 2):
        there, turned = centre_and_turn(now + k * step)
        places[k] = there + turned @ mark
    velocity = (8 * (places[1] - places[-1]) - (places[2] - places[-2])) / (12 * step)
    speed = np.linalg.norm(control(np.array([now]))[0][:2])
    assert np.linalg.norm(velocity) < 1e-8 * speed


def test_on_a_ball_of_its_size_the_orientation_follows_from_the_place():
    """R = (2γγᵀ - 1)(2γ_0γ_0ᵀ - 1) R_0, [Koiller & Ehlers], whatever the way."""
    ball = SphereOnSphere(ratio=1)
    control = Control(Fourier(2), np.random.default_rng(7).standard_normal((2, 5)))
    first, turned = np.array([0.3, -0.2]), so3.exp(np.array([0.2, 0.5, -0.3]))
    start = {"contact_point": first, "orientation": turned}
    last = end(ball, start, control)

    def mirror(place: np.ndarray) -> np.ndarray:
        gamma = np.asarray(ball.line_of_centres(np.array([*place, *np.eye(3).ravel()]))[0])
        return 2 * np.outer(gamma, gamma) - np.eye(3)

    expected = mirror(last["contact_point"]) @ mirror(first) @ turned
    np.testing.assert_allclose(last["orientation"], expected, atol=1e-10)


def test_a_ball_at_rest_on_a_turntable_turns_with_it():
    found = end(
        Turntable(speed=0.6), {"angle": 0, "orientation": np.eye(3)}, constants([0, 0], horizon=sqrt(2))
    )
    np.testing.assert_allclose(found["orientation"], so3.exp(np.array([0, 0, 0.6 * sqrt(2)])), atol=1e-11)
