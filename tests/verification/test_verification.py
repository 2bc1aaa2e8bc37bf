"""The second opinion: what it confirms, and that planted faults make it disagree."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from nhpocp import so3
from nhpocp.arrays import cross
from nhpocp.constraints.bound import Bound
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.joints import Row
from nhpocp.systems.legs import Leg
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.verification import verify
from nhpocp.verification.replay import Watch
from nhpocp.via import Via

START = {"position": [0, 0, 25], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 6]))}
GOAL = {"position": [-0.4, -0.2, 35], "orientation": so3.from_rpy(np.array([0, 0, -np.pi / 2]))}
PAPER_INITIAL = [[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]]
# where (17) ends at γ = .1, for the default robot and for paper_conjecture (five digits)
SOLVED = [
    [0.03936, 0.62835, 0.79417, -0.56243, -0.29366],
    [-0.01976, 0.4729, -0.90043, -0.81548, 0.09843],
    [0.97118, -0.12044, 1.01225, 0.00946, -0.21296],
]
SOLVED_CONJECTURE = [
    [0.00236, 0.67117, -0.00675, 0.15806, 0.12828],
    [0.10348, 0.20066, 0.12809, -0.32762, -0.04634],
    [1.05126, 0.03525, 0.48477, 0.01532, -0.00035],
]


def stored(problem: PlanningProblem, control: Control, tolerance: float) -> Solution:
    """A claim as a solver makes it, its trajectory from another integrator than verification's."""
    numeric = NumericSystem(problem.system)
    rate, times = numeric.rate_function, np.linspace(0, control.horizon, 41)
    knots = np.union1d(np.linspace(0, control.horizon, 801), control.breakpoints)
    middles = 0.5 * (knots[:-1] + knots[1:])
    inputs = control(knots[:-1]), control(middles), control(knots[1:], "left")
    state, states = problem.start_point, [problem.start_point]
    for h, first, middle, last in zip(
        np.diff(knots), *inputs, strict=True
    ):  # the classical Runge-Kutta method
        k1 = _flat(rate(state, first))
        k2 = _flat(rate(state + h / 2 * k1, middle))
        k3 = _flat(rate(state + h / 2 * k2, middle))
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + _flat(rate(state + h * k3, last)))
        states.append(state)
    states = np.array(states)[np.searchsorted(knots, times - 1e-9 * control.horizon)]
    trajectory = {"t": times, **numeric.trajectory(states, control(times), problem.scale)}
    return Solution(
        problem=problem,
        solver="test",
        settings={},
        tolerance=tolerance,
        outcome=Outcome.CONVERGED,
        message="",
        final_error=0.0,
        control=control,
        trajectory=trajectory,
    )


def _flat(column: ca.DM) -> np.ndarray:
    return np.array(column).ravel()


def paper(system: System, coefficients: Any, tolerance: float = 1e-2, **more: Any) -> Solution:
    """A claim to have solved the paper's task."""
    problem = PlanningProblem(system=system, start=START, goal=GOAL, **more)
    return stored(problem, problem.control(np.asarray(coefficients, dtype=float)), tolerance)


def honest(system: System, coefficients: Any = PAPER_INITIAL, **more: Any) -> Solution:
    """A claim that is true whatever the system: its goal is where the control leads."""
    claim = paper(system, coefficients, tolerance=1e-6, **more)
    end = {name: claim.trajectory[name][-1] for name in system.state_space.names}
    return replace(claim, problem=replace(claim.problem, goal=end))


def test_honest_solution_of_the_paper_passes():
    verdict = verify(paper(ThreeUPU(), SOLVED))
    assert verdict.ok, verdict.reasons
    assert not verdict.reasons
    assert not verdict.warnings
    assert not verdict.crossings
    assert verdict.error == pytest.approx(9.1e-4, rel=0.02)
    assert verdict.rolling < 1e-8
    assert verdict.leg_rate < 1e-8
    assert verdict.orthogonality < 1e-10
    assert verdict.trajectory_deviation < 1e-6
    assert "DOP853" in verdict.method


@pytest.mark.parametrize("preset", ["default", "normal75"])
def test_both_forms_of_the_equations_agree(preset):
    verdict = verify(honest(ThreeUPU.preset(preset)))
    assert verdict.ok, verdict.reasons
    assert verdict.original.ok
    assert verdict.original.reached == 1.0
    assert verdict.original.agreement < 1e-8


def test_original_form_is_replayed_as_it_stands():
    verdict = verify(honest(ThreeUPU(form="original"), [[8, 1, 0], [9, 0, 2], [10, 0, 0]], basis=Fourier(1)))
    assert verdict.ok, verdict.reasons
    assert verdict.original is None
    assert max(verdict.rolling, verdict.leg_rate) < 1e-8


def steps(intervals: int) -> np.ndarray:
    """The paper's Λ₀ held at its value in the middle of every interval."""
    return Control(Fourier(2), PAPER_INITIAL)((np.arange(intervals) + 0.5) / intervals).T


@pytest.mark.parametrize("intervals", [1, 7, 100])
def test_honest_piecewise_constant_control_passes(intervals):
    verdict = verify(honest(ThreeUPU(), steps(intervals), basis=PiecewiseConstant(intervals)))
    assert verdict.ok, verdict.reasons
    assert verdict.error < 1e-9
    assert max(verdict.rolling, verdict.leg_rate) < 1e-8
    assert verdict.original.ok
    assert verdict.original.agreement < 1e-8


@pytest.mark.parametrize(
    ("basis", "coefficients"),
    [(Fourier(2), SOLVED), (PiecewiseConstant(10), Control(Fourier(2), SOLVED)(np.arange(10) / 10 + 0.05).T)],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_perturbed_coefficient_fails(basis, coefficients):
    claim = honest(ThreeUPU(), coefficients, basis=basis)
    coefficients = claim.control.coefficients.copy()
    coefficients[0, 1] += 0.05
    verdict = verify(replace(claim, control=replace(claim.control, coefficients=coefficients)))
    assert not verdict.ok
    assert "misses the goal" in verdict.reasons[0]


def _shift(trajectory):
    position = trajectory["position"].copy()
    position[20, 2] += 0.02
    return {**trajectory, "position": position}


def _turn(trajectory):
    orientation = trajectory["orientation"].copy()
    orientation[7] = so3.exp(np.array([0.02, 0, 0])) @ orientation[7]
    return {**trajectory, "orientation": orientation}


@pytest.mark.parametrize(
    ("tamper", "said"),
    [
        (_shift, "off the replay by 0.02 at t=0.5"),
        (_turn, "off the replay by 0.02 at t=0.175"),
        (lambda trajectory: {name: values[:-1] for name, values in trajectory.items()}, "stored times"),
        (lambda trajectory: {**trajectory, "position": trajectory["position"] * np.nan}, "not finite"),
        (lambda trajectory: {**trajectory, "t": trajectory["t"][:-1]}, "different lengths"),
        (lambda trajectory: {**trajectory, "u": 1.01 * trajectory["u"]}, "stored u is off"),
        (lambda trajectory: {**trajectory, "u": trajectory["u"][:, :2]}, "stored u is of shape"),
        (lambda trajectory: {**trajectory, "u": trajectory["u"][:-1]}, "stored u is of shape"),
        (
            lambda trajectory: {**trajectory, "position": trajectory["position"][:, :2]},
            "stored position is of",
        ),
        (
            lambda trajectory: {**trajectory, "joint_angles": trajectory["joint_angles"] + 3e-4},
            "joint_angles is off",
        ),
        (lambda trajectory: {"t": trajectory["t"]}, "no stored trajectory"),
    ],
)
def test_tampered_trajectory_fails(tamper, said):
    claim = paper(ThreeUPU(), SOLVED)
    verdict = verify(replace(claim, trajectory=tamper(claim.trajectory)))
    assert not verdict.ok
    assert any(said in reason for reason in verdict.reasons), verdict.reasons


def test_angles_are_compared_the_shorter_way_round():
    claim = paper(ThreeUPU(), SOLVED)
    angles = claim.trajectory["joint_angles"].copy()
    angles[::2] += 2 * np.pi
    angles[1::4] -= 2 * np.pi
    verdict = verify(replace(claim, trajectory={**claim.trajectory, "joint_angles": angles}))
    assert verdict.ok, verdict.reasons


def in_metres(share: float) -> Solution:
    """An honest run of the default robot with every length, and the one worth a radian, multiplied by ``share``."""
    robot = ThreeUPU(base_radius=30 * share, platform_radius=15 * share)
    start, goal = ({**pose, "position": share * np.array(pose["position"])} for pose in (START, GOAL))
    problem = PlanningProblem(system=robot, start=start, goal=goal, error_length=share)
    return stored(problem, problem.control(np.array(SOLVED)), 1e-2)


@pytest.mark.parametrize("share", [1e-3, 1e3])
@pytest.mark.parametrize("name", ["u", "leg_lengths", "sigma_s", "sigma_w", "det_s", "det_w"])
def test_every_quantity_is_held_to_its_own_scale(share, name):
    claim = in_metres(share)
    assert verify(claim).ok
    values = claim.trajectory[name].copy()
    values[11] += 3e-4 * np.abs(values).max()
    verdict = verify(replace(claim, trajectory={**claim.trajectory, name: values}))
    assert [reason for reason in verdict.reasons if f"stored {name} is off" in reason], verdict.reasons


@pytest.mark.parametrize("share", [1e-3, 1e3])
def test_a_stored_path_is_held_to_the_scale_of_the_error(share):
    claim = in_metres(share)
    verdict = verify(replace(claim, trajectory=_turn(claim.trajectory)))
    assert [reason for reason in verdict.reasons if "off the replay by 0.02" in reason], verdict.reasons


class FlippedMoment(ThreeUPU):
    """[Paper] eq. (2) with the sign of J's second term wrong."""

    def constraint_rows(self, leg, pose, arm):
        rows = super().constraint_rows(leg, pose, arm)
        return [Row(s, 2 * cross(arm, s) - j, scale) for s, j, scale in rows]


class FlippedArm(ThreeUPU):
    """[Paper] eq. (2) with the sign of K wrong."""

    def actuator_rows(self, leg, pose, arm):
        return [Row(g, -k, scale) for g, k, scale in super().actuator_rows(leg, pose, arm)]


class FlippedTangent(ThreeUPU):
    """The tangential (y) part of the first leg's r with the wrong sign, inside the constraint only."""

    def constraint_rows(self, leg, pose, arm):
        if float(pose.a[1]) == 0:  # the leg at azimuth 0°
            pose = replace(pose, r=pose.r * np.array([1.0, -1.0, 1.0]))
        return super().constraint_rows(leg, pose, arm)


@pytest.mark.parametrize("form", ["feedback", "original"])
@pytest.mark.parametrize(
    ("flawed", "seen"),
    [(FlippedMoment, "turn about r"), (FlippedTangent, "turn about r"), (FlippedArm, "as u says")],
)
def test_planted_sign_errors_are_seen(flawed, seen, form):
    coefficients = PAPER_INITIAL if form == "feedback" else np.array(PAPER_INITIAL) * 0.05
    verdict = verify(honest(flawed(form=form), coefficients))
    assert verdict.error < 1e-6  # the flawed equations are solved: only geometry can tell
    assert not verdict.ok
    assert any(seen in reason for reason in verdict.reasons), verdict.reasons


def test_flipping_a_whole_r_changes_nothing():
    legs = ThreeUPU().legs
    flipped = (replace(legs[0], r=tuple(-x for x in legs[0].r)), *legs[1:])
    plain, turned = (verify(paper(ThreeUPU(legs=list(robot)), SOLVED)) for robot in (legs, flipped))
    assert turned.ok
    assert turned.error == pytest.approx(plain.error, abs=1e-11)
    assert turned.rolling < 1e-8


MIXED_LEGS = [
    Leg((30, 2, 1), (14, 0, 0), (0.1, 0.9, 0.3), (1, 0, 0.2)),
    Leg((-15, 25, -2), (-7, 13, 1), (0.8, 0.5, 0.1), (-0.5, 0.8, 0), "suslov"),
    Leg((-14, -27, 0), (-8, -12, 0), (0.7, -0.4, 0.4), (-0.5, -0.8, 0.1)),
]


@pytest.mark.parametrize("robot", [ThreeUPU(joint="suslov", roller_tilt=0.9), ThreeUPU(legs=MIXED_LEGS)])
def test_other_joints_pass(robot):
    verdict = verify(honest(robot, np.array(PAPER_INITIAL) * 0.3))
    assert verdict.ok, verdict.reasons
    assert max(verdict.rolling, verdict.leg_rate) < 1e-8


def test_broken_bounds_are_named_with_leg_and_time():
    bounds = [
        Bound("leg_length", "leg_lengths", 20, 45),
        Bound("control", "v", -10, 10),
        Bound("clearance", "sigma_s", lower=0.01),
    ]
    claim = paper(ThreeUPU(), SOLVED, bounds=bounds)
    verdict = verify(claim)
    lengths = claim.trajectory["leg_lengths"]
    time, leg = np.unravel_index(np.argmax(lengths), lengths.shape)
    assert [report.ok for report in verdict.bounds] == [False, True, True]
    assert verdict.bounds[0].component == (leg,)
    assert verdict.bounds[0].time == pytest.approx(claim.trajectory["t"][time], abs=0.03)
    excess = verdict.bounds[0].worst
    assert verdict.reasons == (
        f"{verdict.bounds[0].describe()} by {excess:.3g}, more than the 0.045 allowed",
    )
    assert not verdict.ok
    assert claim.judged(verdict).outcome is Outcome.CONSTRAINT_VIOLATED


@pytest.mark.parametrize(("off", "ok"), [(0.0, True), (0.1, False)])
def test_via_pose_is_checked(off, ok):
    claim = paper(ThreeUPU(), SOLVED)
    middle = claim.trajectory["position"][20] + np.array([0, 0, off])
    via = Via(0.5, {"position": middle})
    verdict = verify(replace(claim, problem=replace(claim.problem, via=[via])))
    assert verdict.ok is ok
    assert ok or "via pose at 0.5" in verdict.reasons[0]


def test_free_blocks_of_the_goal_do_not_count():
    claim = paper(ThreeUPU(), SOLVED)
    position_only = replace(claim.problem, goal={"position": GOAL["position"]})
    assert verify(replace(claim, problem=position_only)).error < verify(claim).error


def test_blow_up_is_reported_with_its_time():
    problem = PlanningProblem(system=ThreeUPU(roller_tilt=0.0), start=START, goal=GOAL)
    control = problem.control(np.array(PAPER_INITIAL, dtype=float))
    claim = replace(paper(ThreeUPU(), SOLVED), problem=problem, control=control)
    verdict = verify(claim)
    assert verdict.error is None
    assert not verdict.ok
    assert "stopped at t=0.0717" in verdict.reasons[0]
    assert verdict.original is None


def test_undefined_rates_at_the_start_are_reported():
    claim = paper(ThreeUPU(), SOLVED)
    control = replace(claim.control, coefficients=claim.control.coefficients * np.nan)
    verdict = verify(replace(claim, control=control))
    assert verdict.error is None
    assert "t=0 of 1" in verdict.reasons[0]


def test_parallel_singularities_of_the_conjecture():
    verdict = verify(paper(ThreeUPU.preset("paper_conjecture"), SOLVED_CONJECTURE))
    assert verdict.ok, verdict.reasons  # (7) does not mind; the user is warned
    assert [crossing.which for crossing in verdict.crossings] == ["det_w", "det_w"]
    first, second = verdict.crossings
    assert first.time == pytest.approx(0.540, abs=2e-3)
    assert second.time == pytest.approx(0.852, abs=2e-3)
    assert np.degrees(first.state["yaw"]) == pytest.approx(-62.0, abs=0.1)
    assert np.degrees(second.state["yaw"]) == pytest.approx(-77.7, abs=0.1)
    assert first.returns
    assert second.returns
    assert not verdict.original.ok
    assert verdict.original.error is None
    assert verdict.original.reached == pytest.approx(first.time, abs=1e-3)
    assert sum("det W changes its sign" in warning for warning in verdict.warnings) == 2
    assert sum("can be followed only to" in warning for warning in verdict.warnings) == 1


def on_the_axis(form: str) -> Solution:
    """Up along the axis of `paper_conjecture`, where det W has a double zero at cos ψ = B/A, and W rank 4."""
    robot = ThreeUPU.preset("paper_conjecture", form=form)
    goal = {"position": [0, 0, 36.06993827482299], "orientation": GOAL["orientation"]}
    problem = PlanningProblem(system=robot, start=START, goal=goal, basis=Fourier(0))
    if form == "feedback":
        return stored(problem, problem.control(np.array([[0.0], [0.0], [np.pi / 3]])), 1e-6)
    leg = robot.legs[0]
    lengths = [
        np.linalg.norm(pose["position"] + pose["orientation"] @ np.array(leg.platform) - np.array(leg.base))
        for pose in (START, goal)
    ]
    return stored(problem, problem.control(np.full((3, 1), lengths[1] - lengths[0])), 1e-6)


def test_a_determinant_that_touches_zero_is_a_crossing():
    verdict = verify(on_the_axis("feedback"))
    assert verdict.ok, verdict.reasons  # (7) does not divide by det W
    (touch,) = verdict.crossings
    assert (touch.which, touch.touches, touch.returns) == ("det_w", True, True)
    assert np.cos(touch.state["yaw"]) == pytest.approx(5 / 15, abs=1e-6)
    assert touch.time == pytest.approx(0.67548, abs=1e-5)
    assert [warning for warning in verdict.warnings if "det W touches zero at t=0.67548" in warning]
    assert not verdict.original.ok
    assert verdict.original.error is None
    assert verdict.original.reached == touch.time


@pytest.mark.parametrize("stepped_over", [False, True])
def test_equations_that_divide_by_what_touches_zero_are_not_trusted(stepped_over, monkeypatch):
    if stepped_over:  # as an integrator's steps may do
        monkeypatch.setattr(Watch, "look", lambda watch, step, low, high, end: (high, None))
    verdict = verify(on_the_axis("original"))
    assert not verdict.ok
    assert [reason for reason in verdict.reasons if "det W, by which these equations divide" in reason]
    assert verdict.error is not None or not stepped_over  # whether a step ends near enough to it is chance


class Unicycle(System):
    """ẋ = v cos θ, ẏ = v sin θ, θ̇ = w."""

    model, declared = "test_unicycle", {}
    state_space = StateSpace([scalar("x", "length"), scalar("y", "length"), scalar("theta", "angle")])
    input_space = StateSpace([scalar("v"), scalar("w")])

    def parameters(self):
        return {}

    def vector_fields(self, state):
        return ca.vertcat(ca.horzcat(ca.cos(state[2]), 0), ca.horzcat(ca.sin(state[2]), 0), ca.horzcat(0, 1))


def test_system_without_legs():
    start = {"x": 0.0, "y": 0.0, "theta": 0.0}
    turn, speed = 0.7, 1.3
    goal = {
        "x": speed / turn * np.sin(turn),
        "y": speed / turn * (1 - np.cos(turn)),
        "theta": turn,
    }
    problem = PlanningProblem(system=Unicycle(), start=start, goal=goal, basis=Fourier(0))
    verdict = verify(stored(problem, problem.control(np.array([[speed], [turn]])), 1e-9))
    assert verdict.ok, verdict.reasons
    assert verdict.error < 1e-11
    assert verdict.rolling is None
    assert verdict.leg_rate is None
    assert verdict.original is None
    assert verdict.orthogonality is None


class UnicycleWithOutputs(Unicycle):
    """With an output that is zero but for rounding, and one that is cut at ±π."""

    output_blocks = (scalar("nothing", "length"), scalar("heading", "angle", wraps=True))

    def outputs(self, state, control):
        heading = ca.atan2(ca.sin(state[2]), ca.cos(state[2]))
        x = state[0] + 2
        return {"nothing": (x + 1) ** 3 - x**3 - 3 * x**2 - 3 * x - 1, "heading": heading}


def test_outputs_without_a_scale_and_on_a_cut_refute_nothing():
    problem = PlanningProblem(
        system=UnicycleWithOutputs(),
        start={"x": 0.0, "y": 0.0, "theta": np.pi - 1.0},
        goal={"theta": np.pi},  # where the heading is either of ±π
        basis=Fourier(0),
    )
    claim = stored(problem, problem.control(np.array([[1.3], [1.0]])), 1e-9)
    for sign in (1, -1):
        heading = claim.trajectory["heading"].copy()
        heading[-1] = sign * (np.pi - 1e-12)
        verdict = verify(replace(claim, trajectory={**claim.trajectory, "heading": heading}))
        assert verdict.ok, verdict.reasons
