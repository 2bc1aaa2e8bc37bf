"""The second opinion: what it confirms, and that planted faults make it disagree."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from nhpocp import so3
from nhpocp.arrays import cross
from nhpocp.constraints import Bound
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.problem import PlanningProblem, Via
from nhpocp.solution import Outcome, Solution
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import Leg, ThreeUPU
from nhpocp.verification import geometry, verify
from nhpocp.verification.crossings import sign_changes
from nhpocp.verification.replay import integrate, sample

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
    state, states, steps = problem.start_point, [problem.start_point], 20
    h = control.horizon / (steps * (len(times) - 1))
    values = control(np.linspace(0, control.horizon, 2 * steps * (len(times) - 1) + 1))
    for k in range(steps * (len(times) - 1)):  # the classical Runge-Kutta method
        first, middle, last = values[2 * k : 2 * k + 3]
        k1 = _flat(rate(state, first))
        k2 = _flat(rate(state + h / 2 * k1, middle))
        k3 = _flat(rate(state + h / 2 * k2, middle))
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + _flat(rate(state + h * k3, last)))
        if (k + 1) % steps == 0:
            states.append(state)
    trajectory = {"t": times, **numeric.trajectory(np.array(states), control(times), problem.scale)}
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


def test_perturbed_coefficient_fails():
    claim = paper(ThreeUPU(), SOLVED)
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
        (lambda trajectory: {"t": trajectory["t"]}, "no stored trajectory"),
    ],
)
def test_tampered_trajectory_fails(tamper, said):
    claim = paper(ThreeUPU(), SOLVED)
    verdict = verify(replace(claim, trajectory=tamper(claim.trajectory)))
    assert not verdict.ok
    assert any(said in reason for reason in verdict.reasons), verdict.reasons


class FlippedMoment(ThreeUPU):
    """[Paper] eq. (2) with the sign of J's second term wrong."""

    def constraint_row(self, leg, arm):
        s, j = super().constraint_row(leg, arm)
        return s, 2 * cross(arm, s) - j


class FlippedArm(ThreeUPU):
    """[Paper] eq. (2) with the sign of K wrong."""

    def actuator_row(self, leg, arm):
        g, k = super().actuator_row(leg, arm)
        return g, -k


class FlippedTangent(ThreeUPU):
    """The tangential (y) part of the first leg's r with the wrong sign, inside the constraint only."""

    def constraint_row(self, leg, arm):
        if float(leg.a[1]) == 0:  # the leg at azimuth 0°
            leg = replace(leg, r=leg.r * np.array([1.0, -1.0, 1.0]))
        return super().constraint_row(leg, arm)


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
    assert verdict.reasons == (verdict.bounds[0].describe(),)
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


coordinate = st.floats(-1, 1)
triple = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=25, deadline=None)
@given(
    legs=st.tuples(*[st.tuples(triple, triple, triple, triple, st.booleans())] * 3),
    position=triple,
    turn=triple,
    control=triple,
)
def test_rolling_holds_for_any_geometry_and_pose(legs, position, turn, control):
    assume(all(np.linalg.norm(part) > 0.2 for leg in legs for part in leg[2:4]))
    assume(np.linalg.norm(control) > 0.1)
    robot = ThreeUPU(
        legs=[
            Leg(tuple(20 * x for x in a), tuple(10 * x for x in b), r, w4, "suslov" if suslov else "veselova")
            for a, b, r, w4, suslov in legs
        ]
    )
    pose = {"position": 10 * np.array(position) + [0, 0, 40], "orientation": so3.exp(2 * np.array(turn))}
    states, numeric = robot.state_space.pack(pose)[None], NumericSystem(robot)
    assume(abs(numeric.determinants(states)["s"][0]) > 1e-2)
    rolling, leg_rate = geometry.residuals(numeric, states, np.array([control]))
    assert rolling[0] < 1e-8
    assert leg_rate[0] < 1e-8


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


def test_nothing_straddles_a_discontinuity():
    """A control that jumps is integrated exactly, and both of its limits are sampled."""

    def rate(t, x, side):
        later = t > 0.3 or (t == 0.3 and side == "right")
        return np.array([5.0 if later else -1.0])

    path = integrate(rate, np.zeros(1), 1.0, np.array([0.3]))
    np.testing.assert_allclose(path([0.15, 0.3, 1.0])[:, 0], [-0.15, -0.3, -0.3 + 0.7 * 5], atol=1e-14)


def test_sampling_gives_both_sides_of_a_breakpoint():
    class Jump(Fourier):
        def breakpoints(self, horizon):
            return np.array([0.3])

        def table(self, times, horizon, side="right"):
            times = np.asarray(times)
            return np.where((times > 0.3) | ((times == 0.3) & (side == "right")), 5.0, -1.0)[:, None]

    path = integrate(lambda t, x, side: np.ones(1), np.zeros(1), 1.0, np.array([0.3]))
    samples = sample(path, Control(Jump(0), [[1.0]]), 11)
    at_jump = samples.times == 0.3
    assert samples.controls[at_jump, 0].tolist() == [-1.0, 5.0]


@pytest.mark.parametrize("zeros", [[0.123456789], [0.5], [0.501, 0.5013], [0.2, 0.7, 0.71]])
def test_sign_changes_are_found_to_nine_digits(zeros):
    def function(t):
        return float(np.prod([t - zero for zero in zeros]))

    times = np.linspace(0, 1, 101)  # 0.5 is a sample; 0.501 and 0.5013 fall between two
    found = sign_changes(function, times, np.array([function(t) for t in times]))
    np.testing.assert_allclose(found, zeros, atol=1e-9)


def test_touching_zero_is_no_change_of_sign():
    times = np.linspace(0, 1, 101)
    assert sign_changes(lambda t: (t - 0.503) ** 2 + 1e-9, times, (times - 0.503) ** 2 + 1e-9) == []
