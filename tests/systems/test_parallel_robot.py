"""Robots of any legs: known robots as cases, geometry alone, what holonomic joints hold, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import nhpocp
from nhpocp import so3
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import parse_problem
from nhpocp.problem_file.dumping import dump_problem
from nhpocp.systems.legs import Leg
from nhpocp.systems.mobility import mobility
from nhpocp.systems.numeric import NumericSystem, numeric_system
from nhpocp.systems.orienting_platform import OrientingPlatform
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.veselova_joint import VeselovaJoint
from nhpocp.verification import geometry
from tests.systems.test_three_upu import LAW, flow, robots_at_poses, rows_by_hand

SPACE = ParallelRobot.state_space
START = {"position": [0, 0, 25], "orientation": np.eye(3)}
POINT = SPACE.pack(
    {"position": np.array([1.0, -2.0, 26.0]), "orientation": so3.exp(np.array([0.2, -0.1, 0.3]))}
)
FLAT = SPACE.pack({"position": np.array([1.0, -2.0, 26.0]), "orientation": np.eye(3)})

# what each kind of leg gives: rows of motors and constraints together
KINDS = {
    "rolling": ({"joint": "veselova", "r": 0, "w4": 0}, 2),
    "rolling in the leg": ({"joint": "suslov", "r": 0, "w4": 0}, 2),
    "rolling, no motor": ({"joint": "veselova", "r": 0, "w4": 0, "actuated": False}, 1),
    "rolling bar": ({"joint": "suslov", "r": 0, "w4": 0, "length": "fixed"}, 2),
    "universal": ({"joint": "universal", "w1": 0, "w2": 0, "w4": 0}, 2),
    "universal bar": ({"joint": "universal", "w1": 0, "w4": 0, "length": 20.0}, 2),
    "free": ({"joint": "spherical"}, 1),
    "free at the platform": ({"joint": "universal"}, 1),
    "bar": ({"joint": "spherical", "w4": 0, "length": "fixed"}, 1),
}


def random_leg(generator: np.random.Generator, kind: str, azimuth: float) -> Leg:
    c, s = np.cos(azimuth), np.sin(azimuth)
    spread = generator.uniform(-4, 4, size=(2, 3))
    values = {
        key: tuple(generator.normal(size=3)) if key in ("r", "w1", "w2", "w4") else value
        for key, value in KINDS[kind][0].items()
    }
    base, platform = np.array([c, s, 0]) * 30 + spread[0], np.array([c, s, 0]) * 14 + spread[1]
    return Leg(tuple(base), tuple(platform), **values)


@st.composite
def robots(draw: st.DrawFn) -> tuple[ParallelRobot, np.random.Generator]:
    """Six rows of legs in any mixture, at least one of them a motor's."""
    kinds: list[str] = []
    while (rows := sum(KINDS[kind][1] for kind in kinds)) < 6:
        kinds.append(draw(st.sampled_from([kind for kind in KINDS if KINDS[kind][1] <= 6 - rows])))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    legs = [
        random_leg(generator, kind, 2 * np.pi * k / len(kinds) + 0.3 * (k % 2))
        for k, kind in enumerate(kinds)
    ]
    assume(any(leg.actuated for leg in legs))
    return ParallelRobot(legs=legs), generator


# --- known robots as cases --------------------------------------------------------------------------------------------


@LAW
@given(robots_at_poses())
def test_the_3_upu_robot_is_one_of_them(case):
    upu, pose, generator = case
    robot, u = ParallelRobot(legs=list(upu.legs)), generator.normal(size=3)
    blocks = robot.kinematics(pose)
    for found, by_hand in zip((blocks.G, blocks.K, blocks.S, blocks.J), rows_by_hand(upu, pose), strict=True):
        assert np.abs(found - by_hand).max() <= 1e-12 * (1 + np.abs(by_hand).max())
    original = upu.with_(form="original").velocity(pose, u)
    assert np.abs(robot.velocity(pose, u) - original).max() <= 1e-12 * (1 + np.abs(original).max())


@LAW
@given(robots_at_poses())
def test_sines_are_those_of_each_leg_and_its_own_axis(case):
    upu, pose, _ = case
    at = upu.state_space.unpack(pose)
    sines = [float(sine) for sine in upu.joint_sines(pose)]
    for sine, leg in zip(sines, upu.legs, strict=True):
        span = at["position"] + at["orientation"] @ np.array(leg.platform) - np.array(leg.base)
        axis = at["orientation"] @ np.array(leg.w4)
        cosine = span @ axis / np.linalg.norm(span) / np.linalg.norm(axis)
        assert sine == pytest.approx(np.sqrt(1.0 - cosine**2), abs=1e-7)
    spheres = ParallelRobot(legs=[replace(leg, joint="spherical", r=None, w4=None) for leg in upu.legs] * 2)
    assert spheres.joint_sines(pose) == []


@pytest.mark.parametrize("joint", ["veselova", "suslov"])
def test_the_wrist_is_one_with_its_platform_pinned(joint):
    wrist = OrientingPlatform(joint=joint, r=(0.2, -0.3, 1.0))
    robot = ParallelRobot(legs=list(wrist.legs))
    turn, u = so3.exp(np.array([0.3, -0.2, 0.5])), np.array([0.7, -1.1])
    pinned = robot.velocity(SPACE.pack({"position": np.zeros(3), "orientation": turn}), u)
    omega = wrist.velocity(wrist.state_space.pack({"orientation": turn}), u)
    assert np.abs(pinned - np.r_[0, 0, 0, omega]).max() < 1e-13
    # the display equation of the class, by hand
    rows = []
    for leg in wrist.legs[:2]:
        a, b = np.array(leg.base), turn @ leg.platform
        rows.append(-np.cross(b, a) / np.linalg.norm(b - a))
    r = np.array([0.2, -0.3, 1.0]) / np.linalg.norm([0.2, -0.3, 1.0])
    rows.append(turn @ r if joint == "suslov" else r)
    assert np.abs(np.linalg.solve(np.array(rows), [*u, 0]) - omega).max() < 1e-13


def test_the_wrist_moves_as_its_ball_joint_alone():
    """Leg speeds that belong to a motion of the Veselova joint give that motion."""
    joint, wrist = VeselovaJoint(), OrientingPlatform()
    control = Control(Fourier(1), [[0.3, 0, 1.5], [-0.2, 1.5, 0]])
    start = joint.state_space.pack({"orientation": np.eye(3)})
    rate, other = numeric_system(joint).rate_function, numeric_system(wrist).rate_function
    for time in np.linspace(0, 1, 4):
        here = flow(joint, start, Control(Fourier(1), np.array(control.coefficients) * time))
        omega = np.r_[control(np.array([time]))[0], 0.0]
        u = wrist.kinematics(here).K @ omega
        assert np.abs(np.array(other(here, u)) - np.array(rate(here, omega[:2]))).max() < 1e-12


def test_ordinary_universal_joints_leave_translations():
    """[Tsai]'s 3-UPU robot: parallel axes at base and platform, and the platform does not turn, wherever it is."""
    robot = ParallelRobot.preset("translational")
    velocity = robot.velocity(FLAT, np.array([1.0, -0.4, 0.7]))
    assert np.abs(velocity[3:]).max() < 1e-14
    assert np.abs(robot.kinematics(FLAT).S).max() < 1e-14
    left = mobility(robot, FLAT)
    assert (left.freedom, left.reachable, left.holonomic, left.non_holonomic) == (3, 3, 3, 0)
    assert np.abs(left.twists[3:]).max() < 1e-13
    problem = PlanningProblem(
        system=robot, start=START, goal={"position": [3.0, -2.0, 30.0]}, basis=Fourier(1)
    )
    solution = nhpocp.solve(problem, nhpocp.Continuation(step_rule=nhpocp.Adaptive()))
    assert solution.converged, solution.message
    assert np.abs(solution.trajectory["orientation"] - np.eye(3)).max() < 1e-9
    lengths = [
        np.linalg.norm(np.array([3, -2, 30]) + leg.platform - np.array(leg.base)) for leg in robot.legs
    ]
    assert solution.trajectory["leg_lengths"][-1] == pytest.approx(lengths, abs=1e-3)


# --- geometry alone ---------------------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None, derandomize=True)
@given(robots())
def test_every_joint_is_obeyed_for_any_mixture(case):
    robot, generator = case
    numeric, u = NumericSystem(robot), generator.normal(size=(1, robot.motors))
    assume(numeric.margins(POINT[None], 15.0)["sigma_w"][0] > 1e-2)
    rolling, leg_rate = geometry.residuals(numeric, POINT[None], u)
    assert rolling[0] < 1e-8
    assert leg_rate[0] < 1e-8
    left, blocks = mobility(robot, POINT), robot.kinematics(POINT)
    assert left.freedom == robot.motors == 6 - robot.holonomic - robot.non_holonomic
    scaled = np.hstack([blocks.S * robot.default_length_scale(), blocks.J])
    assert np.abs(scaled @ left.twists).max() < 1e-9 * np.abs(scaled).max()
    assert left.reachable == 6 - robot.holonomic


class StretchingBar(ParallelRobot):
    """The row of a bar with its arm forgotten."""

    def constraint_rows(self, leg, pose, arm):
        return super().constraint_rows(leg, pose, 0 * arm if leg.length is not None else arm)


class SlidingPin(ParallelRobot):
    """The rows of a pin that holds another point."""

    def constraint_rows(self, leg, pose, arm):
        return super().constraint_rows(leg, pose, arm + 0.1 if leg.pinned else arm)


class RollingInstead(ParallelRobot):
    """Rows of legs that do not turn about w1, where the joints have them not turn about w1 × w2."""

    def constraint_rows(self, leg, pose, arm):
        return super().constraint_rows(leg, replace(pose, r=np.array(leg.w1)), arm)


@pytest.mark.parametrize(("flawed", "legs"), [(StretchingBar, "braced"), (SlidingPin, "wrist")])
def test_planted_errors_are_seen(flawed, legs):
    known = list(OrientingPlatform().legs) if legs == "wrist" else ParallelRobot.presets[legs]["legs"]
    for cls, fine in ((ParallelRobot, True), (flawed, False)):
        robot = cls(legs=known)
        u = np.ones((1, robot.motors))
        point = SPACE.pack({"position": np.zeros(3), "orientation": np.eye(3)}) if legs == "wrist" else POINT
        _, leg_rate = geometry.residuals(NumericSystem(robot), point[None], u)
        assert (leg_rate[0] < 1e-8) == fine


def test_a_universal_joint_turned_about_its_normal_is_seen():
    """A leg that rolls as if r were fixed in the base is no ordinary universal joint."""

    class Rolling(ParallelRobot):
        def constraint_rows(self, leg, pose, arm):
            rolling = replace(leg, joint="veselova", w1=None, w2=None, r=leg.w1)
            return rolling.constraints(replace(pose, r=np.array(leg.w1)), arm)

    found, rolls = (NumericSystem(robot.preset("translational")) for robot in (ParallelRobot, Rolling))
    assert geometry.residuals(found, POINT[None], np.ones((1, 3)))[0][0] < 1e-8
    assert geometry.residuals(rolls, POINT[None], np.ones((1, 3)))[0][0] > 1e-3


# --- what holonomic joints hold ---------------------------------------------------------------------------------------


def test_a_bar_keeps_its_length_and_five_numbers_of_a_goal_can_be_chosen():
    robot = ParallelRobot.preset("braced")
    goal = {"position": [1.0, 0.5, 26.0], "platform_normal": [0.05, 0.1, 1.0]}
    initial = 5 * np.eye(5)[1:4]
    problem = PlanningProblem(system=robot, start=START, goal=goal, initial=initial)
    solution = nhpocp.solve(problem, nhpocp.Continuation(step_rule=nhpocp.Adaptive()))
    assert solution.converged, solution.message
    assert solution.verdict.rolling < 1e-8
    assert solution.verdict.leg_rate < 1e-8
    bar = solution.trajectory["leg_lengths"][:, 3]
    assert np.abs(bar - bar[0]).max() < 1e-6 * bar[0]


def test_goals_may_not_fix_what_never_changes():
    with pytest.raises(
        InvalidProblemError, match=r"fixes 6 numbers.*hold 1 of this machine's 6.*leaves 5"
    ) as caught:
        PlanningProblem(system=ParallelRobot.preset("braced"), start=START, goal=START)
    assert caught.value.path == "goal"
    via = [nhpocp.Via(0.5, START)]
    with pytest.raises(InvalidProblemError, match="fixes 6 numbers") as caught:
        PlanningProblem(
            system=ParallelRobot.preset("braced"), start=START, goal={"position": [0, 0, 26]}, via=via
        )
    assert caught.value.path == "via[0]"


def test_a_start_that_the_joints_do_not_allow_is_named():
    robot = ParallelRobot.preset("translational")
    tilted = {**START, "orientation": so3.exp(np.array([0.1, 0, 0]))}
    with pytest.raises(InvalidProblemError, match=r"leg \d: w1·w2 is .*hold it at 0") as caught:
        PlanningProblem(system=robot, start=tilted, goal={"position": [0, 0, 26]})
    assert caught.value.path == "start"
    legs = [*ParallelRobot.presets["braced"]["legs"]]
    for length, fits in ((np.sqrt(30**2 + 30**2 + 25**2), True), (40.0, False)):
        bar = ParallelRobot(legs=[*legs[:3], {**legs[3], "length": float(length)}])
        if fits:
            PlanningProblem(system=bar, start=START, goal={"position": [0, 0, 26]})
            continue
        with pytest.raises(InvalidProblemError, match=r"leg 4: length is 49\.2.*hold it at 40"):
            PlanningProblem(system=bar, start=START, goal={"position": [0, 0, 26]})


def test_constraints_that_say_the_same_are_counted_once():
    bar = {"base": [20, 30, 0], "platform": [-10, 0, 0], "base_joint": "spherical", "length": "fixed"}
    free = [
        {
            "base": [30 * np.cos(k), 30 * np.sin(k), 0],
            "platform": [15 * np.cos(k), 0, k],
            "base_joint": "spherical",
        }
        for k in range(4)
    ]
    left = mobility(ParallelRobot(legs=[bar, bar, *free]), POINT)
    assert (left.holonomic, left.independent, left.freedom, left.reachable) == (2, 1, 5, 5)
    assert left.describe()[-1] == "only 1 of the 2 constraints are independent here"


def test_mobility_of_known_robots():
    wrist = OrientingPlatform()
    left = mobility(wrist, wrist.state_space.pack({"orientation": np.eye(3)}))
    assert (left.motors, left.freedom, left.reachable) == (2, 2, 3)
    assert np.abs(left.twists[[0, 1, 2, 5]]).max() < 1e-15  # turns about x and y alone
    left = mobility(ParallelRobot(), POINT)
    assert (left.freedom, left.reachable, left.holonomic, left.non_holonomic) == (3, 6, 0, 3)
    assert "leg 2: suslov, prismatic, universal at the platform: 1 motor + 1 non-holonomic" in left.describe()


# --- what is refused --------------------------------------------------------------------------------------------------

ROLLING = {
    "base": (30, 0, 0),
    "platform": (15, 0, 0),
    "base_joint": "veselova",
    "r": (0, 1, 1),
    "w4": (1, 0, 0),
}
FREE = {"base": (0, 30, 0), "platform": (0, 15, 0), "base_joint": "spherical"}


@pytest.mark.parametrize(
    ("legs", "words"),
    [
        (
            [ROLLING] * 2,
            r"give 4 rows.*needs 6, 2 missing: actuate.*leg 1 \(veselova.*1 motor \+ 1 non-holonomic\)",
        ),
        ([ROLLING] * 3 + [FREE], r"give 7 rows.*1 too many.*leg 4 \(spherical, prismatic.*: 1 motor\)"),
        ([{**FREE, "actuated": False}], "give 0 rows.*leg 1.*no row"),
        ([{**FREE, "length": "fixed"}] * 6, "give 6 rows.*none of them a motor"),
        ([], "give 0 rows.*no leg"),
        ([{**ROLLING, "w4": None}] * 3, "leg 1: .*has no w4"),
        ([ROLLING, {**ROLLING, "r": None}], "leg 2: .*needs r"),
        ([{**FREE, "r": (0, 0, 1)}], "leg 1: r of a leg with a spherical base joint has no meaning"),
        ([{**ROLLING, "base_joint": "universal"}], "r of a leg with a universal base joint has no meaning"),
        ([{**FREE, "base_joint": "universal", "w4": (1, 0, 0)}], "universal base joint needs w1"),
        ([{**FREE, "base_joint": "glue"}], "'glue' is none of veselova, suslov, universal, spherical"),
        ([{**FREE, "length": "fixed", "actuated": True}], "actuated and of fixed length"),
        ([{**FREE, "length": -1}], "length -1 of a leg"),
        ([{**FREE, "length": "long"}], "length 'long' of a leg"),
        ([{**FREE, "length": float("nan")}], "length nan of a leg"),
        ([{**ROLLING, "length": 0}], "remove its w4"),
        ([{**FREE, "joint": "veselova"}], "leg 1: a leg with .*joint; expected base, platform, base_joint"),
        ([{"base": (0, 0, 0)}], "expected base, platform"),
    ],
)
def test_legs_that_make_no_robot_are_named(legs, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        ParallelRobot(legs=legs)
    assert caught.value.path == "system.legs"


@pytest.mark.parametrize(
    ("parameters", "path", "words"),
    [
        ({"r": (0, 0, 0)}, "system.r", "zero vector"),
        ({"r": (0, 1)}, "system.r", "2 numbers; expected 3"),
        ({"height": -1}, "system.height", "> 0"),
        ({"joint": "spherical"}, "system.joint", "none of veselova, suslov"),
    ],
)
def test_a_wrist_checks_its_parameters(parameters, path, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        OrientingPlatform(**parameters)
    assert caught.value.path == path


# --- problem files ----------------------------------------------------------------------------------------------------

FILE = """nhpocp: 1
system:
  model: parallel_robot
  legs:
    - {base: [30, 0, 0], platform: [15, 0, 0], base_joint: veselova, r: [0, 1, 0.3], w4: [1, 0, 0]}
    - {base: [-15, 26, 0], platform: [-7.5, 13, 0], base_joint: suslov, r: [0.3, 1, 0], w4: [-0.5, 0.9, 0]}
    - {base: [-15, -26, 0], platform: [-7.5, -13, 0], base_joint: spherical}
    - {base: [20, 30, 0], platform: [-10, 0, 0], base_joint: spherical, length: fixed}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}
goal: {position: [0, 0, 26]}
constraints: {leg_length: [10, 90], leg_speed: 300, clearance: 0.01}
objective: leg_effort
"""


def test_a_file_says_every_leg_and_survives():
    problem = parse_problem(FILE)
    robot = problem.system
    assert [leg.joint for leg in robot.legs] == ["veselova", "suslov", "spherical", "spherical"]
    assert [leg.actuated for leg in robot.legs] == [True, True, True, False]
    assert [bound.quantity for bound in problem.bounds] == ["leg_lengths", "u", "sigma_w"]
    again = parse_problem(dump_problem(replace(problem)))
    assert again.system.parameters() == robot.parameters()
    assert robot.parameters()["legs"][3]["length"] == "fixed"


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("length: fixed", "length: short", "system.legs[3].length", "expected fixed or a length >= 0"),
        ("length: fixed", "length: -3", "system.legs[3].length", "-3 is negative"),
        ("length: fixed", "length: fixed, actuated: 1", "system.legs[3].actuated", "true or false"),
        ("base_joint: suslov", "base_joint: suslow", "system.legs[1].base_joint", "did you mean 'suslov'"),
        ("base_joint: suslov", "joint: suslov", "system.legs[1].joint", "did you mean 'base_joint'"),
        (", length: fixed", "", "system.legs", "give 6 rows|too many|missing"),
        ("goal: {", "goal: {orientation: {rpy: [0, 0, 0]}, ", "goal", "leaves 5 to choose"),
    ],
)
def test_a_file_with_a_fault_is_answered_at_its_place(old, new, place, words):
    text = FILE.replace(old, new, 1)
    if place == "system.legs":  # a fourth motor instead of the bar counts six: take the third leg's away
        text = text.replace("base_joint: spherical}", "base_joint: spherical, actuated: false}", 1)
    with pytest.raises(InvalidProblemError, match=words) as caught:
        parse_problem(text)
    assert caught.value.path == place


@pytest.mark.parametrize("name", ["paper", "parallel_robot", "orienting_platform"])
def test_what_brackets_reach_is_within_what_the_legs_leave(name):
    problem = nhpocp.load_problem(Path(__file__).parents[2] / "problems" / f"{name}.yaml")
    found = nhpocp.analyze(problem)
    assert found.filtration.generic.vector[0] == found.mobility.freedom == found.mobility.motors
    assert found.filtration.generic.rank == found.mobility.reachable
    assert found.to_json()["mobility"]["freedom"] == found.mobility.freedom
