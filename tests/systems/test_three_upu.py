"""The 3-ŬPU robot: the paper's equations by an independent hand, geometry alone, symmetries, known end points."""

import subprocess
import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from nhpocp import so3
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.systems.joints import LegPose
from nhpocp.systems.legs import Leg
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.three_upu import ThreeUPU

LAW = settings(max_examples=40, deadline=None, derandomize=True)
SPACE = ThreeUPU.state_space
START = SPACE.pack({"position": [0, 0, 25], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 6]))})
GOAL = SPACE.pack({"position": [-0.4, -0.2, 35], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 2]))})
LAMBDA_0 = np.array([[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])
SHAPES = [
    {"platform_axis": axis, "joint": joint}
    for axis in ("radial", "tangential", "normal")
    for joint in ("veselova", "suslov")
]


def random_leg(generator, azimuth):
    def direction():
        return tuple(generator.normal(size=3))

    c, s = np.cos(azimuth), np.sin(azimuth)
    spread = generator.uniform(-2, 2, size=(2, 3))
    base = np.array([c, s, 0]) * generator.uniform(15, 40) + spread[0]
    platform = np.array([c, s, 0]) * generator.uniform(5, 20) + spread[1]
    joint = generator.choice(["veselova", "suslov"])
    return Leg(tuple(base), tuple(platform), direction(), direction(), str(joint))


def random_robot(generator):
    return ThreeUPU(legs=[random_leg(generator, 2 * np.pi * k / 3) for k in range(3)])


def random_pose(generator):
    position = [*generator.uniform(-5, 5, size=2), generator.uniform(18, 45)]
    return SPACE.pack({"position": position, "orientation": so3.exp(0.5 * generator.normal(size=3))})


@st.composite
def robots_at_poses(draw, shapes=True):
    """A robot and a pose a fair way from det S = 0, det G = 0 and det W = 0."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    robot, pose = random_robot(generator), random_pose(generator)
    if shapes and draw(st.booleans()):
        robot = ThreeUPU(
            base_radius=generator.uniform(15, 40),
            platform_radius=generator.uniform(5, 20),
            roller_tilt=generator.uniform(0.3, 1.5),
            **draw(st.sampled_from(SHAPES)),
        )
    assume(all(np.linalg.norm(np.cross(leg.g, leg.w4)) > 0.2 for leg in robot.leg_poses(pose)))
    blocks = robot.kinematics(pose)
    scaled = blocks.W / robot.column_scales("w", robot.default_length_scale())
    assume(max(np.linalg.cond(m) for m in (blocks.G, blocks.S, scaled)) < 100)
    return robot, pose, generator


def rows_by_hand(robot, pose, sign_r=1, sign_w3=1, sign_h=1):
    """[Paper] eq. (2), written from the paper in plain NumPy."""
    p, rotation = pose[:3], pose[3:].reshape(3, 3)
    blocks = {name: [] for name in "GKSJ"}
    for leg in robot.legs:
        a, b = np.array(leg.base), p + rotation @ np.array(leg.platform)
        l = np.linalg.norm(b - a)  # noqa: E741 - the paper's letter
        g = (b - a) / l
        w4 = rotation @ np.array(leg.w4)
        w3 = np.cross(g, w4) / np.linalg.norm(np.cross(g, w4))
        r = np.array(leg.r)
        if leg.joint == "suslov":
            r = np.column_stack([g, w3, np.cross(g, w3)]) @ r
        r, w3 = sign_r * r, sign_w3 * w3
        h = sign_h * np.cross(w3, w4)
        s = np.cross(h, r) - np.dot(g, np.cross(h, r)) * g
        blocks["G"].append(g)
        blocks["K"].append(np.cross(b - p, g))
        blocks["S"].append(s)
        blocks["J"].append(np.cross(b - p, s) - l * np.dot(r, g) * h)
    return tuple(np.array(blocks[name]) for name in "GKSJ")


def turn_about(axis, angle):
    return so3.exp(angle * np.asarray(axis))


def first_derivative(curve, step):
    """Eighth-order central difference at 0."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (curve(k * step) - curve(-k * step)) for k, w in weights.items()) / step


def close(found, expected, relative):
    found, expected = np.asarray(found), np.asarray(expected)
    return np.abs(found - expected).max() <= relative * (1 + np.abs(expected).max())


def flow(system, start, control):
    """End point of the system under a Control, by SciPy."""
    rate = NumericSystem(system).rate_function
    found = solve_ivp(
        lambda t, x: np.array(rate(x, control(t)[0])).ravel(),
        (0, control.horizon),
        start,
        method="DOP853",
        rtol=1e-11,
        atol=1e-12,
    )
    assert found.success
    return found.y[:, -1]


# --- the paper's equations


@LAW
@given(robots_at_poses())
def test_rows_are_the_papers_eq_2(case):
    robot, pose, _ = case
    blocks = robot.kinematics(pose)
    for found, expected in zip(
        (blocks.G, blocks.K, blocks.S, blocks.J), rows_by_hand(robot, pose), strict=True
    ):
        assert close(found, expected, 1e-13)
    assert np.array_equal(blocks.W, np.block([[blocks.G, blocks.K], [blocks.S, blocks.J]]))


@LAW
@given(robots_at_poses())
def test_eq_5_is_eq_4(case):
    robot, pose, _ = case
    b, inverse = robot.kinematics(pose), np.linalg.inv
    core = inverse(b.J - b.S @ inverse(b.G) @ b.K) @ b.S @ inverse(b.G)
    eq_5 = np.vstack([inverse(b.G) + inverse(b.G) @ b.K @ core, -core])
    assert close(eq_5, inverse(b.W)[:, :3], 1e-9)


@LAW
@given(robots_at_poses())
def test_feedback_is_the_papers_eq_6_and_its_inverse_undoes_it(case):
    robot, pose, generator = case
    v, b = generator.normal(size=3), robot.kinematics(pose)
    u = robot.feedback(pose, v)
    inverse = np.linalg.inv
    assert close(u, b.G @ inverse(b.S) @ (b.J - b.S @ inverse(b.G) @ b.K) @ v, 1e-10)
    assert close(robot.inverse_feedback(pose, u), v, 1e-10)


@LAW
@given(robots_at_poses())
def test_both_forms_move_alike_under_the_feedback(case):
    robot, pose, generator = case
    v = generator.normal(size=3)
    original = robot.with_(form="original")
    assert close(original.rate(pose, robot.feedback(pose, v)), robot.rate(pose, v), 1e-10)
    assert close(original.outputs(pose, robot.feedback(pose, v))["v"], v, 1e-10)
    for form in (robot, original):
        assert close(form.vector_fields(pose) @ v, form.velocity(pose, v), 1e-10)


@LAW
@given(robots_at_poses())
def test_eq_7_obeys_the_original_equations(case):
    robot, pose, generator = case
    v, b = generator.normal(size=3), robot.kinematics(pose)
    velocity = robot.velocity(pose, v)
    assert np.array_equal(velocity[3:], -v)
    assert close(b.W @ velocity, np.r_[robot.feedback(pose, v), np.zeros(3)], 1e-11)


@LAW
@given(robots_at_poses(), st.sampled_from([-1, 1]), st.sampled_from([-1, 1]), st.sampled_from([-1, 1]))
def test_the_signs_of_r_w3_and_h_change_nothing(case, sign_r, sign_w3, sign_h):
    robot, pose, generator = case
    v = generator.normal(size=3)
    _, _, s, j = rows_by_hand(robot, pose, sign_r, sign_w3, sign_h)
    assert close(np.linalg.solve(s, j @ v), robot.velocity(pose, v)[:3], 1e-10)
    legs = [replace(leg, r=tuple(sign_r * x for x in leg.r)) for leg in robot.legs]
    assert close(ThreeUPU(legs=legs).velocity(pose, v), robot.velocity(pose, v), 1e-10)


# --- geometry alone


@settings(LAW, max_examples=60)
@given(robots_at_poses())
def test_no_leg_turns_about_its_roller_normal_and_legs_grow_as_told(case):
    robot, pose, generator = case
    v = generator.normal(size=3)
    velocity, u = robot.velocity(pose, v), robot.feedback(pose, v)
    step = 0.02 / (np.linalg.norm(v) + np.linalg.norm(velocity[:3]) / 20)
    assume(np.linalg.norm(u) > 0.1)

    def along(amount):
        return robot.leg_poses(SPACE.retract(pose, amount * velocity))

    def frames(amount):
        return np.array([np.column_stack([leg.g, leg.w3, np.cross(leg.g, leg.w3)]) for leg in along(amount)])

    lengths = first_derivative(lambda e: np.array([leg.length for leg in along(e)]), step)
    assert np.linalg.norm(lengths - u) / np.linalg.norm(u) < 1e-8
    for leg, frame, rate in zip(along(0.0), frames(0.0), first_derivative(frames, step), strict=True):
        omega = so3.vee(rate @ frame.T)
        assume(np.linalg.norm(omega) > 1e-2)
        assert abs(leg.r @ omega) / np.linalg.norm(omega) < 1e-8


@LAW
@given(robots_at_poses())
def test_both_joint_frames_are_right_handed_and_orthonormal(case):
    robot, pose, _ = case
    for leg in robot.leg_poses(pose):
        for frame in ((*leg.base_axes(), leg.r), (leg.w3, leg.w4, leg.h)):
            matrix = np.column_stack(frame)
            assert np.abs(matrix.T @ matrix - np.eye(3)).max() < 1e-9
            assert np.linalg.det(matrix) > 0
        assert leg.w3 @ leg.g == pytest.approx(0, abs=1e-14)


@LAW
@given(robots_at_poses())
def test_w1_leans_towards_the_sphere_centre(case):
    robot, pose, _ = case
    for leg in robot.leg_poses(pose):
        w1, w2 = leg.base_axes()
        assert w1 @ leg.a > 0
        assert w2 @ leg.a == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    "r", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.8, 0), (-1, 0, 0), (1, 1e-3, 0), (1, -1e-3, 0)]
)
def test_base_axes_exist_where_r_points_at_the_sphere_centre(r):
    r = np.array(r) / np.linalg.norm(r)
    for a in (30 * r, np.zeros(3)):
        leg = LegPose(a, a + 9.0, r, 1.0, r, r, r, r, r)
        matrix = np.column_stack([*leg.base_axes(), r])
        assert np.abs(matrix.T @ matrix - np.eye(3)).max() < 1e-9
        assert np.linalg.det(matrix) == pytest.approx(1)


@LAW
@given(robots_at_poses())
def test_joint_angles_rebuild_the_leg(case):
    robot, pose, _ = case
    orientation = SPACE.unpack(pose)["orientation"]
    angles = robot.outputs(pose, np.zeros(3))["joint_angles"]
    assert angles.shape == (3, 4)
    for leg, built, (t1, t2, t3, t4) in zip(robot.leg_poses(pose), robot.legs, angles, strict=True):
        w1, w2 = leg.base_axes()
        assert close(turn_about(w1, t1) @ turn_about(w2, t2) @ leg.r, leg.g, 1e-9)
        assert close(turn_about(leg.w3, t3) @ leg.g, leg.w4, 1e-12)
        # θ4 counts from a platform-fixed vector ⟂ w4: turning it back gives that vector, the same at every pose
        reference = orientation.T @ turn_about(leg.w4, -t4) @ leg.w3
        axis = np.array([0, 0, 1.0] if abs(built.w4[2]) < 0.9 else [1.0, 0, 0])
        expected = axis - (axis @ built.w4) * np.array(built.w4)
        assert close(reference, expected / np.linalg.norm(expected), 1e-9)


def test_drawing_is_finite_and_its_legs_join_the_centres():
    for robot in (ThreeUPU(), ThreeUPU(joint="suslov"), random_robot(np.random.default_rng(1))):
        picture = robot.drawing(START)
        for group in ("lines", "points"):
            for points in picture[group].values():
                assert points.ndim == 2
                assert points.shape[1] == 3
                assert np.isfinite(points).all()
        p, rotation = START[:3], START[3:].reshape(3, 3)
        for i, leg in enumerate(robot.legs):
            a, b = np.array(leg.base), p + rotation @ leg.platform
            assert np.allclose(picture["lines"][f"leg {i + 1}"], [a, b], rtol=0, atol=1e-13)
            assert np.allclose(picture["points"]["spheres"][i], a)
            assert np.allclose(picture["points"]["universal joints"][i], b)


# --- numbers and symbols


@pytest.mark.parametrize("form", ["feedback", "original"])
@pytest.mark.parametrize("seed", range(4))
def test_numbers_and_symbols_agree(seed, form):
    generator = np.random.default_rng(seed)
    robot = (random_robot(generator) if seed else ThreeUPU()).with_(form=form)
    poses = np.array([random_pose(generator) for _ in range(3)])
    controls = generator.normal(size=(3, 3))
    numeric = NumericSystem(robot)
    outputs, matrices = numeric.outputs(poses, controls), numeric.regularity(poses)
    margins = numeric.margins(poses, 15.0)
    for k, (pose, control) in enumerate(zip(poses, controls, strict=True)):
        assert close(np.array(numeric.rate_function(pose, control)).ravel(), robot.rate(pose, control), 1e-9)
        expected = robot.outputs(pose, control)
        assert (
            set(outputs)
            == set(expected)
            == {"u" if form == "feedback" else "v", "leg_lengths", "joint_angles", "platform_normal"}
        )
        for name, value in expected.items():
            assert outputs[name][k].shape == value.shape
            assert close(outputs[name][k], value, 1e-9), name
        for name, value in robot.regularity(pose).items():
            assert close(matrices[name][k], value, 1e-11), name
            scaled = value / robot.column_scales(name, 15.0)
            assert margins[f"sigma_{name}"][k] == pytest.approx(np.linalg.svd(scaled)[1][-1], rel=1e-8)
            assert margins[f"det_{name}"][k] == pytest.approx(np.linalg.det(value), rel=1e-8)


@pytest.mark.parametrize("form", ["feedback", "original"])
def test_matrix_symbols_work_too(form):
    robot = ThreeUPU(form=form)
    x, u = ca.MX.sym("x", SPACE.size), ca.MX.sym("u", 3)
    rate = ca.Function("f", [x, u], [robot.rate(x, u)])
    assert close(
        np.array(rate(START, [0.1, 0.2, 0.3])).ravel(), robot.rate(START, np.array([0.1, 0.2, 0.3])), 1e-12
    )


@pytest.mark.parametrize("form", ["feedback", "original"])
def test_casadi_jacobian_of_the_rate_agrees_with_differences(form):
    robot, control = ThreeUPU(form=form), np.array([0.3, -0.5, 0.8])
    x = ca.SX.sym("x", SPACE.size)
    jacobian = np.array(ca.Function("j", [x], [ca.jacobian(robot.rate(x, control), x)])(START))
    for direction in np.eye(SPACE.dimension):
        tangent = SPACE.lift(START, direction)
        expected = first_derivative(
            lambda e, direction=direction: robot.rate(SPACE.retract(START, e * direction), control), 5e-3
        )
        assert close(jacobian @ tangent, expected, 1e-9)


# --- known motions


@pytest.mark.parametrize(
    ("preset", "position", "digits", "error"),
    [
        ("default", (0.712869, 0.535277, 34.976485), 6e-7, 1.3376783),
        ("normal75", (-0.71, 0.26, 33.80), 6e-3, 1.3292),
        ("paper_conjecture", (-0.3, -1.4, 34.6), 6e-2, 1.2846),
    ],
)
def test_presets_end_where_they_are_known_to_end(preset, position, digits, error):
    end = flow(ThreeUPU.preset(preset), START, Control(Fourier(2), LAMBDA_0))
    assert np.abs(end[:3] - position).max() < digits
    assert SPACE.distance(end, GOAL) == pytest.approx(error, abs=6e-5 if digits > 1e-3 else 6e-8)


def test_pure_yaw_on_the_axis_climbs_in_proportion_to_the_leg_offset():
    robot = ThreeUPU.preset("paper_conjecture")
    for yaw_end in (-np.pi / 4, -np.pi / 2):
        control = Control(Fourier(0), [[0], [0], [-np.pi / 6 - yaw_end]])
        end = flow(robot, START, control)
        offset = [np.sqrt(15**2 + 5**2 - 2 * 15 * 5 * np.cos(yaw)) for yaw in (-np.pi / 6, yaw_end)]
        assert end[2] / offset[1] == pytest.approx(25 / offset[0], rel=1e-10)
        assert np.abs(end[:2]).max() < 1e-10
        assert np.abs(so3.to_rpy(end[3:].reshape(3, 3)) - [0, 0, yaw_end]).max() < 1e-10
    assert end[2] == pytest.approx(36.06993827482299, abs=1e-8)


def turned(pose, turn):
    """The pose after turning the whole machine; the platform's legs are renumbered, not moved in the platform."""
    values = SPACE.unpack(pose)
    return SPACE.pack(
        {"position": turn @ values["position"], "orientation": turn @ values["orientation"] @ turn.T}
    )


@LAW
@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1))
def test_a_third_of_a_turn_commutes_with_the_field(shape, seed):
    generator = np.random.default_rng(seed)
    robot, pose, v = ThreeUPU(**shape), random_pose(generator), generator.normal(size=3)
    assume(np.linalg.cond(robot.kinematics(pose).S) < 100)
    turn = turn_about([0, 0, 1], 2 * np.pi / 3)
    expected = np.kron(np.eye(2), turn) @ robot.velocity(pose, v)
    assert close(robot.velocity(turned(pose, turn), turn @ v), expected, 1e-10)


def test_a_third_of_a_turn_commutes_with_the_flow():
    robot, turn = ThreeUPU(), turn_about([0, 0, 1], 2 * np.pi / 3)
    end = flow(robot, START, Control(Fourier(2), LAMBDA_0))
    other = flow(robot, turned(START, turn), Control(Fourier(2), turn @ LAMBDA_0))
    assert close(other, turned(end, turn), 1e-9)


@pytest.mark.parametrize("preset", ["default", "paper_conjecture"])
def test_scaling_all_lengths_scales_the_path(preset):
    robot, scale, control = ThreeUPU.preset(preset), 0.01, Control(Fourier(2), LAMBDA_0)
    sizes = {name: scale * robot.parameters()[name] for name in ("base_radius", "platform_radius")}
    lengths = np.r_[np.full(3, scale), np.ones(9)]
    end = flow(ThreeUPU(**{**robot.parameters(), **sizes}), lengths * START, control)
    assert close(end, lengths * flow(robot, START, control), 1e-9)


def test_slower_controls_take_the_same_way_in_more_time():
    robot = ThreeUPU.preset("normal75")
    quick = flow(robot, START, Control(Fourier(2), LAMBDA_0))
    slow = flow(robot, START, Control(Fourier(2), LAMBDA_0 / 5, horizon=5.0))
    assert close(slow, quick, 1e-9)


@pytest.mark.parametrize("preset", ["default", "normal75"])
def test_the_reversed_control_leads_back(preset):
    robot = ThreeUPU.preset(preset)
    end = flow(robot, START, Control(Fourier(2), LAMBDA_0))
    reversal = np.array([1, -1, 1, -1, 1])  # sin(2πk(T-t)/T) = -sin(2πkt/T)
    assert close(flow(robot, end, Control(Fourier(2), -LAMBDA_0 * reversal)), START, 1e-8)


# --- parameters


@pytest.mark.parametrize(
    "robot",
    [
        ThreeUPU(),
        *(ThreeUPU.preset(name, form="original") for name in ThreeUPU.presets),
        random_robot(np.random.default_rng(7)),
    ],
)
def test_parameters_rebuild_the_robot(robot):
    again = ThreeUPU(**robot.parameters())
    assert again.legs == robot.legs
    assert again.form == robot.form
    assert again.parameters() == robot.parameters()
    assert robot.with_(form="original").legs == robot.legs


def test_declared_parameters_are_the_constructors():
    assert set(ThreeUPU.declared) == {*ThreeUPU(leg_radius=1, thickness=2).parameters(), "legs"}
    for name, value in ThreeUPU().parameters().items():
        assert ThreeUPU.declared[name].default == value


LEG = {"base": (30, 0, 0), "platform": (15, 0, 0), "r": (0, 0, 1), "w4": (1, 0, 0), "joint": "veselova"}


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"base_radius": 0}, "base_radius.*> 0"),
        ({"platform_radius": -3}, "platform_radius.*> 0"),
        ({"base_radius": np.nan}, "base_radius.*finite"),
        ({"platform_radius": np.inf}, "platform_radius.*finite"),
        ({"roller_tilt": np.nan}, "roller_tilt.*finite"),
        ({"platform_axis": "up"}, "platform_axis.*radial, tangential, normal"),
        ({"joint": "ball"}, "joint.*veselova, suslov"),
        ({"form": "dual"}, "form.*feedback, original"),
        ({"legs": [LEG, LEG]}, "legs.*2 legs.*has 3"),
        ({"legs": [{**LEG, "r": (0, 0, 0)}] * 3}, "r of a leg is the zero vector"),
        ({"legs": [{**LEG, "w4": (1, 0)}] * 3}, "w4 of a leg has 2 numbers"),
        ({"legs": [{**LEG, "base": (1, np.nan, 0)}] * 3}, "base of a leg.*finite"),
        ({"legs": [{**LEG, "joint": "ball"}] * 3}, "ball.*veselova, suslov"),
        ({"legs": [{**LEG, "weight": 3}] * 3}, "legs.*base, platform, r, w4, joint"),
        ({"legs": [{"base": (1, 0, 0)}] * 3}, "legs.*base, platform, r, w4, joint"),
    ],
)
def test_bad_parameters_are_named(parameters, words):
    with pytest.raises(InvalidProblemError, match=words):
        ThreeUPU(**parameters)


def test_declaring_the_robot_needs_neither_numpy_nor_casadi():
    code = (
        "import sys\n"
        "from nhpocp.systems.three_upu import ThreeUPU\n"
        "assert ThreeUPU.preset('default').parameters()['base_radius'] == 30\n"
        "assert not {'numpy', 'casadi', 'scipy'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
