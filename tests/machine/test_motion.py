"""Motions in a machine's time: where they are, how fast, and within which limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nhpocp.cli.exporting import export
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.motion import make_motion, quaternions
from nhpocp.machine.export.time_scaling import PROFILES
from nhpocp.verification.geometry import leg_frames
from tests.machine.conftest import plan, reference

CASES = ["paper", "orienting_platform", "rolling_sphere", "car"]
STENCIL = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0


def entries(motion):
    return {entry.name: entry.values for entry in motion.entries}


def differenced(values, step):
    """Five-point differences, two samples fewer at either end."""
    return sum(c * values[i : len(values) - 4 + i] for i, c in enumerate(STENCIL)) / step


def close(values, expected, tolerance):
    assert np.abs(values - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", CASES)
def test_a_motion_is_the_plan_in_another_time(name, profile):
    solution = plan(name)
    motion = make_motion(solution, rate=20, duration=2.03, profile=profile)
    assert motion.times[-2:] == pytest.approx([2.0, 2.03])
    states = reference(solution, motion.times, 2.03, profile == "quintic")
    got, space = entries(motion), solution.problem.system.state_space
    for block, values in space.split(states).items():
        close(got[block], values, 1e-8)
    system = solution.problem.system
    if hasattr(system, "legs"):
        pose = space.split(states)
        position = pose.get("position", np.zeros((len(states), 3)))
        legs = [leg for leg in system.legs if not leg.pinned]
        lengths = [leg_frames(leg, position, pose["orientation"])[0] for leg in legs]
        close(got["leg_lengths"], np.stack(lengths, axis=1), 1e-8)
        assert len(motion.joints) == system.input_space.size
    else:
        assert "leg_lengths" not in got


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", [*CASES, "double_integrator"])
def test_rates_are_those_of_differences(name, profile):
    solution = plan(name)
    if not solution.problem.system.driftless:
        motion = make_motion(solution, rate=2000)
        assert motion.scaling.profile.name == "linear"
    else:
        motion = make_motion(solution, rate=2000, duration=1.5, profile=profile)
    got, step = entries(motion), motion.times[1]
    for block in solution.problem.system.state_space.blocks:
        values, velocity = got[block.name], got[f"{block.name}_velocity"]
        rates = differenced(values, step)
        if block.kind == "rotation":
            turn = rates @ values[2:-2].transpose(0, 2, 1)
            rates = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
            signs = np.sum(got["orientation_quaternion"][1:] * got["orientation_quaternion"][:-1], axis=1)
            assert signs.min() > 0.9
        close(velocity[2:-2], rates, 1e-7)
        close(got[f"{block.name}_acceleration"][2:-2], differenced(velocity, step), 1e-7)
    for block in solution.problem.system.input_space.blocks:
        close(got[f"{block.name}_rate"][2:-2], differenced(got[block.name], step), 1e-7)
    for joint in motion.joints:
        close(joint.velocity[2:-2], differenced(joint.position, step), 1e-7)
        close(joint.acceleration[2:-2], differenced(joint.velocity, step), 1e-7)


def test_leg_speeds_are_the_inputs_of_the_legs():
    motion = make_motion(plan("orienting_platform"), rate=50)
    speeds = np.stack([joint.velocity for joint in motion.joints], axis=1)
    inputs = np.stack([entries(motion)[name] for name in ("l1_dot", "l2_dot")], axis=1)
    close(speeds, inputs, 1e-8)


def test_quaternions_go_on_through_half_turns():
    angles = np.linspace(0.0, 4 * np.pi, 41)
    w, x, y, z = quaternions(Rotation.from_rotvec(np.outer(angles, [0, 0, 1])).as_matrix()).T
    close(np.stack([w, z]), np.stack([np.cos(angles / 2), np.sin(angles / 2)]), 1e-12)
    assert not np.stack([x, y]).any()


def test_quintic_rests_at_both_ends_and_linear_is_the_plan():
    solution = plan("paper")
    motion = make_motion(solution, duration=3.0)
    for joint in motion.joints:
        ends = np.concatenate([joint.velocity[[0, -1]], joint.acceleration[[0, -1]]])
        assert np.abs(ends).max() <= 1e-12 * np.abs(joint.acceleration).max()
    own = make_motion(solution, rate=200, profile="linear")
    assert own.times == pytest.approx(solution.trajectory["t"])
    for name in ("position", "orientation", "v", "leg_lengths"):
        close(entries(own)[name], np.asarray(solution.trajectory[name]), 1e-6)
    close(entries(own)["leg_speeds"], np.asarray(solution.trajectory["u"]), 1e-6)


@pytest.mark.parametrize("name", ["paper", "car"])
@pytest.mark.parametrize("limits", [(30.0, None), (None, 200.0), (30.0, 20.0), (3.0, 2000.0)])
def test_the_least_duration_keeps_the_limits_and_no_less_does(name, limits):
    solution = plan(name)
    named = {"max_speed": limits[0], "max_acceleration": limits[1]}
    least = make_motion(solution, rate=1, **named).scaling.duration
    motion = make_motion(solution, rate=3000 / least, **named)
    got = entries(motion)
    if motion.system["model"] == "three_upu":
        greatest = got["leg_speeds"], got["leg_accelerations"]
    else:
        greatest = np.stack([got["v"], got["w"]]), np.stack([got["v_rate"], got["w_rate"]])
    shares = [
        np.abs(values).max() / limit
        for values, limit in zip(greatest, limits, strict=True)
        if limit is not None
    ]
    assert 0.999 < max(shares) <= 1.0
    with pytest.raises(InvalidProblemError, match="the least duration that keeps them is") as told:
        make_motion(solution, duration=0.999 * least, **named)
    said = float(str(told.value).rsplit(" ", 1)[1])
    assert said == pytest.approx(least, rel=2e-5)
    assert make_motion(solution, duration=said, rate=1, **named).scaling.duration == said


def constant(name, intervals=5):
    solution = plan(name)
    inputs = solution.problem.system.input_space.size
    values = np.sin(np.arange(inputs * intervals) + 1.0).reshape(inputs, intervals)
    return plan(name, control=Control(PiecewiseConstant(intervals), values, 1.0))


def test_speeds_that_jump_are_told():
    jumping = constant("car")
    with pytest.raises(InvalidProblemError, match=r"jump, first at its t = 0\.2, so no duration keeps it"):
        make_motion(jumping, max_acceleration=5.0)
    with pytest.raises(InvalidProblemError, match=r"starts in motion, .* try --profile quintic"):
        make_motion(plan("paper"), max_acceleration=5.0, profile="linear")
    motion = make_motion(jumping, rate=10, profile="linear")
    v = jumping.control.coefficients[0]
    # a sample at a jump is after it, the last one before the end
    assert entries(motion)["v"] == pytest.approx(np.append(np.repeat(v, 2), v[-1]))
    for profile, peak in (("linear", np.abs(v).max()), ("quintic", None)):
        motion = make_motion(jumping, rate=2000, profile=profile, max_speed=0.5)
        reached = max(np.abs(entries(motion)[name]).max() for name in ("v", "w"))
        assert 0.499 < reached <= 0.5
        if peak is not None:
            greatest = np.abs(jumping.control.coefficients).max()
            assert motion.scaling.duration == pytest.approx(greatest / 0.5)


def test_a_plan_with_drift_keeps_its_own_time():
    solution = plan("double_integrator")
    for named, words in (
        ({"duration": 2.0}, "plan with `horizon: 2`"),
        ({"profile": "quintic"}, "expected --profile linear"),
        ({"max_speed": 9.0}, "state limits as `constraints:`"),
        ({"max_acceleration": 9.0}, "state limits as `constraints:`"),
    ):
        with pytest.raises(InvalidProblemError, match=f"moves by itself .*{words}"):
            make_motion(solution, **named)
    motion = make_motion(solution, duration=1.0)
    states = reference(solution, motion.times, 1.0, quintic=False)
    close(np.stack([joint.position for joint in motion.joints], axis=1), states, 1e-9)


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"rate": 0}, "--rate: 0; expected a number > 0"),
        ({"rate": float("nan")}, "--rate: NaN"),
        ({"rate": 1e9}, "--rate: 1e.09 samples"),
        ({"duration": -1}, "--duration: -1; expected"),
        ({"max_speed": float("inf")}, "--max-speed: infinity"),
        ({"max_acceleration": 0}, "--max-acceleration: 0"),
        ({"profile": "quntic"}, "--profile: .*did you mean 'quintic'"),
    ],
)
def test_what_is_none_is_refused(named, words):
    with pytest.raises(InvalidProblemError, match=words):
        make_motion(plan("car"), **named)


def test_the_program_knows_every_profile():
    (option,) = (each for each in export.params if each.name == "profile")
    assert list(option.type.choices) == list(PROFILES)
