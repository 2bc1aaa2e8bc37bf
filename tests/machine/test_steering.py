"""Plans on machines that differ from the model: the cycle, its endings, and what a machine may do to it."""

import re
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import nhpocp
from nhpocp import deg
from nhpocp.errors import CallError, InvalidProblemError
from nhpocp.machine.feedback.fleet import steer_fleet
from nhpocp.machine.feedback.model_estimate import ModelEstimate, WatchedPlant
from nhpocp.machine.feedback.planning_again import PlannedRun, Replanner
from nhpocp.machine.feedback.set_points import SetPoints
from nhpocp.machine.feedback.simulated_plant import KinematicWorkshop, SimulatedPlant
from nhpocp.machine.feedback.steering import Ending, Steering
from nhpocp.machine.model_errors import ModelErrors
from nhpocp.views.steering_figures import steering
from tests.conftest import paper_problem
from tests.machine.conftest import PROBLEMS, reference

PAPER = paper_problem()
ROBOT = PAPER.system
CART = nhpocp.PlanningProblem(
    system=nhpocp.Unicycle(),
    start={"x": 0, "y": 0, "theta": 0},
    goal={"x": 0, "y": 0.5, "theta": 0},
    initial=[[0.5, 0, -2, 0, 0], [0, 3, 0, 0, 0]],
)
AROUND = nhpocp.PlanningProblem(
    name="around",
    system=nhpocp.Unicycle(),
    start={"x": 0, "y": 0, "theta": 0},
    goal={"x": 3, "y": 0, "theta": 0},
    obstacles=[{"disc": {"centre": [1.5, 0], "radius": 0.3}, "name": "pillar"}],
    bounds={"distance": 0.1},
)
QUICK = Steering(verified=False)


def wrong_robot(**more):
    changed = ROBOT.with_(roller_tilt=ROBOT.parameters()["roller_tilt"] + 2 * deg, base_radius=30.3)
    return SimulatedPlant(changed, PAPER.start, **more)


class Cart:
    """A plant of ones own, in ten lines."""

    def __init__(self):
        self.pose, self.speeds = np.zeros(3), np.zeros(2)

    def measure(self):
        return dict(zip(("x", "y", "theta"), self.pose, strict=True))

    def command(self, set_points):
        self.speeds = np.array(set_points)

    def advance(self, seconds):
        v, w = 1.03 * self.speeds
        for _ in range(5):
            self.pose += seconds / 5 * np.array([v * np.cos(self.pose[2]), v * np.sin(self.pose[2]), w])


class Failing(Cart):
    def __init__(self, after, error):
        super().__init__()
        self.left, self.error = after, error

    def advance(self, seconds):
        self.left -= 1
        if self.left < 0:
            raise self.error
        super().advance(seconds)


def test_a_wrong_robot_comes_to_its_goal_in_four_cycles():
    steered = Steering(cycles=4).run(PAPER, plant := wrong_robot())
    assert steered.reached
    assert nhpocp.verify(steered.cycles[1].plan).ok
    first, last = steered.cycles[1], steered.cycles[-1]
    assert first.position_error > 1  # without feedback: [physics] 1.16 units in another engine
    assert last.position_error < 1e-3
    assert PAPER.goal_error(plant.point) == pytest.approx(last.error)
    errors = [cycle.error for cycle in steered.cycles]
    assert all(after < 0.2 * before for before, after in pairwise(errors))


def test_plans_shrink_with_what_is_left():
    steered = replace(QUICK, tolerance=1e-4).run(PAPER, wrong_robot())
    efforts = [cycle.plan.control.effort for cycle in steered.cycles[2:]]
    assert all(after < 0.2 * before for before, after in pairwise(efforts))


def test_a_machine_that_is_the_model_needs_one_cycle():
    steered = QUICK.run(PAPER, SimulatedPlant(ROBOT, PAPER.start))
    assert [len(steered.cycles), steered.outcome] == [2, Ending.REACHED]


def test_a_machine_at_the_goal_is_left_alone():
    steered = QUICK.run(PAPER, SimulatedPlant(ROBOT, PAPER.goal))
    assert [len(steered.cycles), steered.outcome] == [1, Ending.REACHED]


def test_a_plant_of_ones_own():
    steered = nhpocp.steer(CART, cart := Cart())
    assert steered.reached
    assert steered.cycles[1].error > 1e-2
    assert not cart.speeds.any()  # a run ends with zero inputs


@pytest.mark.parametrize("after", [0, 150, 250])
def test_a_plant_that_raises_keeps_what_was_measured(after):
    steered = QUICK.run(CART, plant := Failing(after, OSError("no link to the motors")))
    assert steered.outcome is Ending.INTERRUPTED
    assert "advance() raised OSError: no link to the motors" in steered.message
    assert len(steered.cycles) == 1 + after // 200
    assert not plant.speeds.any()


def test_a_stop_by_hand_keeps_what_was_measured():
    steered = QUICK.run(CART, plant := Failing(250, KeyboardInterrupt()))
    assert steered.outcome is Ending.INTERRUPTED
    assert len(steered.cycles) == 2
    assert not plant.speeds.any()


def test_a_plant_that_hangs_is_not_waited_for():
    class Hanging(Cart):
        def measure(self):
            time.sleep(0.5)
            return super().measure()

    steered = replace(QUICK, patience=0.05).run(CART, Hanging())
    assert steered.outcome is Ending.INTERRUPTED
    assert "measure() raised TimeoutError" in steered.message
    assert not steered.cycles
    assert np.isnan(steered.error)


@pytest.mark.parametrize("pose", [{"x": 0, "y": 0}, {"x": 0, "y": float("nan"), "theta": 0}, 3])
def test_a_measurement_that_is_none_ends_it(pose):
    class Blind(Cart):
        def measure(self):
            return pose

    assert "measure() gave no pose" in QUICK.run(CART, Blind()).message


def slow_cart(problem):
    """Makes a fifth too little of v, which takes it through the pillar."""
    return SimulatedPlant(problem.system, problem.start, gains=[0.8, 1])


def test_a_machine_that_leaves_the_bounds_on_its_way_is_told_of():
    steered = QUICK.run(AROUND, slow_cart(AROUND))
    assert steered.reached
    ((cycle, report),) = steered.broken
    made = reference(slower(steered.cycles[1].plan), times := np.linspace(0, 1, 2001), 1.0, quintic=False)
    distances = np.hypot(made[:, 0] - 1.5, made[:, 1]) - 0.3 - 0.1  # radii of pillar and body
    assert (cycle, report.name) == (1, "distance[body, pillar]")
    assert report.value == pytest.approx(distances.min(), abs=1e-4) == pytest.approx(-0.0955, abs=2e-3)
    assert report.time == pytest.approx(times[distances.argmin()], abs=5e-3)
    assert steered.cycles[1].path(times) == pytest.approx(made, abs=5e-4)
    words = r"cycle 1: distance\[body, pillar\] is -0\.09\d+ at t=0\.\d+, below 0\.1 by 0\.19\d"
    assert re.fullmatch(words, steered.warnings[0])


def test_the_picture_marks_cycles_in_which_a_bound_was_broken():
    one = replace(QUICK, cycles=1)
    for machine, told in ((slow_cart(AROUND), True), (SimulatedPlant(AROUND.system, AROUND.start), False)):
        legend = steering(one.run(AROUND, machine)).axes[0].get_legend()
        assert ("a bound broken" in [text.get_text() for text in legend.get_texts()]) is told


def slower(plan):
    gains = np.array([[0.8], [1]])
    return replace(plan, control=replace(plan.control, coefficients=gains * plan.control.coefficients))


def test_a_machine_that_is_the_model_keeps_the_bounds_as_verified():
    bounds = {"leg_length": [15, 70], "leg_speed": 400, "control": 60, "joint_angle": {"cone": {"max": 1.4}}}
    problem = PAPER.with_(bounds={**bounds, "state": {"position": {"max": [40, 40, 60]}}, "clearance": 1e-4})
    first = QUICK.run(problem, SimulatedPlant(ROBOT, problem.start)).cycles[1]
    verdict = nhpocp.verify(first.plan)
    assert len(first.path.bounds) == len(verdict.bounds) == 7
    for report, verified in zip(first.path.bounds, verdict.bounds, strict=True):
        assert (report.ok, report.name) == (True, verified.name)
        assert report.value == pytest.approx(verified.value, rel=2e-3)
        assert report.time == pytest.approx(verified.time, abs=5e-3)


def test_rates_are_those_of_the_machine_in_its_own_time():
    problem = CART.with_(bounds={"control": 20})
    fast = SimulatedPlant(CART.system, CART.start, gains=[1.2, 1])
    steered = replace(QUICK, duration=0.5).run(problem, fast)
    first = steered.cycles[1]
    inputs = first.plan.control(np.linspace(0, 1, 401)) * [2.4, 2]
    largest = np.abs(inputs).max(axis=0)
    assert np.abs(first.path.inputs).max(axis=0) == pytest.approx(largest, rel=1e-3)
    assert [abs(report.value) for report in first.path.bounds] == pytest.approx(largest, rel=1e-3)


def test_of_accelerations_between_commands_nothing_is_said():
    problem = PAPER.with_(bounds={"leg_acceleration": 5000, "leg_speed": 400}, basis=nhpocp.Fourier(2))
    steered = QUICK.run(problem, SimulatedPlant(ROBOT, problem.start))
    assert [report.bound.label for report in steered.cycles[1].path.bounds] == ["leg_speed"]


def test_of_a_machine_outside_nothing_is_said_of_its_way():
    steered = QUICK.run(AROUND, Cart())
    assert steered.reached
    assert [cycle.path for cycle in steered.cycles] == [None] * len(steered.cycles)
    assert steered.warnings == ()


def test_where_nothing_is_bounded_no_path_is_kept():
    assert QUICK.run(CART, SimulatedPlant(CART.system, CART.start)).cycles[1].path is None


def test_a_run_that_is_interrupted_is_told_of_too():
    class Breaking(SimulatedPlant):
        left = 170

        def advance(self, seconds):
            self.left -= 1
            if self.left < 0:
                raise OSError("a wheel is off")
            super().advance(seconds)

    steered = QUICK.run(AROUND, Breaking(AROUND.system, AROUND.start, gains=[0.8, 1]))
    assert steered.outcome is Ending.INTERRUPTED
    assert len(steered.cycles) == 1
    assert steered.unfinished.times[-1] == pytest.approx(0.85)
    assert [cycle for cycle, _ in steered.broken] == [1]


def test_the_way_back_counts_too():
    mirrored = SimulatedPlant(AROUND.system, AROUND.start, gains=[-1, 1])
    steered = QUICK.run(AROUND, mirrored)
    assert steered.outcome is Ending.NO_PROGRESS
    assert steered.cycles[1].path.times[-1] == pytest.approx(2)


def test_of_many_machines_the_worst_is_named():
    errors, workshop = ModelErrors.parsed("v=20%", AROUND.system), KinematicWorkshop(AROUND.start)
    fleet = steer_fleet(AROUND, errors, 3, QUICK, workshop)
    broken = [k for k, machine in enumerate(fleet.machines) if machine.steered.broken]
    reports = [machine.steered.broken[0][1] for machine in fleet.machines if machine.steered.broken]
    worst = broken[int(np.argmax([report.worst for report in reports]))]
    (sentence,) = fleet.warnings
    wanted = f"distance was not kept by {len(broken)} of 3 machines, the worst machine {worst} in cycle 1: distance["
    assert sentence.startswith(wanted)


def test_progress_is_never_reversed():
    class Mirrored(Cart):
        def command(self, set_points):
            self.speeds = np.array([1, -1]) * set_points

    steered = QUICK.run(CART, Mirrored())
    assert steered.outcome is Ending.NO_PROGRESS
    first, last = steered.cycles
    assert last.error > first.error
    assert steered.error == pytest.approx(first.error, abs=1e-2)  # taken back along its path
    robot = wrong_robot()
    run = SetPoints.of(PAPER, PAPER.control(PAPER.initial))
    there = run.run(robot)
    run.backwards().begun_at(there).run(robot)
    assert PAPER.system.state_space.distance(robot.point, PAPER.start_point) < 1e-5


def test_a_plan_that_fails_moves_nothing():
    goal = {"position": [0, 0, 200], "orientation": {"rpy": [0, 0, 0]}}
    elsewhere = PAPER.with_(goal=goal, bounds={"leg_length": [20, 60]})
    steered = QUICK.run(elsewhere, plant := SimulatedPlant(ROBOT, PAPER.start))
    assert steered.outcome is Ending.PLAN_FAILED
    assert "stays where it is" in steered.message
    assert steered.refused is not None
    assert plant.point == pytest.approx(PAPER.start_point, abs=1e-15)


def test_corrections_under_way_bring_the_first_run_nearer():
    plain, corrected = (replace(QUICK, cycles=1, rate=rate) for rate in (None, 10))
    without, within = (steering.run(PAPER, wrong_robot()).cycles[1] for steering in (plain, corrected))
    assert (without.corrections, within.corrections) == (0, 8)
    assert within.error < 0.02 * without.error
    steered = replace(QUICK, rate=10).run(CART, cart := Cart())
    assert steered.reached
    assert len(steered.cycles) == 2  # what a gain makes too much of is found under way
    assert not cart.speeds.any()


def test_corrections_are_those_of_the_first_run():
    class Astray(Cart):  # its error is none of a parameter, nor of a gain
        def command(self, set_points):
            super().command(np.array(set_points) - [0, 0.03 * set_points[0]])

    steered = replace(QUICK, rate=10).run(CART, Astray())
    assert steered.reached
    assert [cycle.corrections > 0 for cycle in steered.cycles[:3]] == [False, True, False]


def test_feedback_under_way_is_worth_more_than_five_times():
    workshop = KinematicWorkshop(PAPER.start, 1e-4, 1 / 400)
    errors = ModelErrors.of_all(2, ROBOT)
    fleet = steer_fleet(PAPER, errors, 4, replace(QUICK, cycles=1, rate=10), workshop)
    without, within = (np.median(fleet.errors_at_the_end("error", feedback)) for feedback in (False, True))
    assert 10 * within < without


def followed(plant, estimate, until=0.3):
    """A part of the paper's first control, measured at three times."""
    run = SetPoints.of(PAPER, PAPER.control(PAPER.initial))
    for share in (1 / 3, 2 / 3, 1):
        part, run = run.until(share * until), run.after(run.until(share * until))
        part.run(WatchedPlant(plant, estimate))
        estimate.learn(PAPER.system.state_space.pack(plant.measure()))


def test_parameters_are_found_from_a_part_of_a_run():
    estimate = ModelEstimate(PAPER, 1.0, 200)
    followed(wrong_robot(noise=1e-4), estimate)
    known = estimate.problem.system.parameters()
    assert known["roller_tilt"] == pytest.approx(77 * deg, abs=0.1 * deg)
    assert known["base_radius"] == pytest.approx(30.3, rel=3e-3)
    assert known["platform_radius"] == pytest.approx(15, rel=5e-3)
    exact = ModelEstimate(PAPER, 1.0, 200)
    followed(SimulatedPlant(ROBOT, PAPER.start, step=0.01), exact)
    assert exact.problem is PAPER


def test_of_a_robot_without_parameters_only_the_lag_is_learnt():
    problem = nhpocp.load_problem(PROBLEMS / "parallel_robot.yaml")
    estimate = ModelEstimate(problem, 1.0, 200)
    for k in range(3):
        estimate.command(np.array([30 + 0.1 * k, 30, 30]))
        estimate.advance(0.01)
    behind = problem.system.state_space.retract(estimate._twins[0].point, -0.02 * estimate._velocity)
    estimate.learn(behind)
    assert estimate.problem is problem
    assert estimate.without_lag(behind) == pytest.approx(estimate._twins[0].point, abs=2e-4)


def test_a_lag_of_servos_is_no_error_of_the_model():
    class Late(SimulatedPlant):
        """By four commands of 5 ms."""

        def __init__(self, *given):
            super().__init__(*given)
            self.waiting = []

        def command(self, set_points):
            self.waiting = [*self.waiting, set_points] if self.waiting else [set_points] * 5
            super().command(self.waiting.pop(0))

    estimate = ModelEstimate(PAPER, 1.0, 200)
    followed(late := Late(ROBOT, PAPER.start), estimate)
    known = estimate.problem.system.parameters()
    assert known["roller_tilt"] == pytest.approx(75 * deg, abs=0.2 * deg)
    behind = np.linalg.norm(late.point - estimate._twins[0].point)
    caught_up = np.linalg.norm(estimate.without_lag(late.point) - estimate._twins[0].point)
    assert caught_up < 0.2 * behind


def test_corrections_come_no_faster_than_commands():
    steered = replace(QUICK, cycles=1, rate=1000).run(CART, Cart())
    assert 0 < steered.cycles[1].corrections <= 200
    assert steered.cycles[1].error < 0.1


def test_a_corrected_run_that_leads_away_is_taken_back():
    class Astray(Cart):
        def command(self, set_points):
            self.speeds = np.array([1, -1]) * set_points

    steered = replace(QUICK, rate=4).run(CART, Astray())
    assert steered.error <= steered.cycles[0].error + 1e-2


def test_a_limit_of_cycles_and_of_progress():
    assert replace(QUICK, cycles=1).run(PAPER, wrong_robot()).outcome is Ending.CYCLE_LIMIT

    class Stuck(Cart):
        def advance(self, seconds):
            pass

    assert QUICK.run(CART, Stuck()).outcome is Ending.NO_PROGRESS


def test_the_same_seed_is_the_same_machine():
    def ends(seed):
        workshop = KinematicWorkshop(PAPER.start, 1e-4, 1 / 400)
        fleet = steer_fleet(PAPER, ModelErrors.of_all(2, ROBOT), 2, QUICK, workshop, seed=seed)
        assert fleet.reached == 2
        assert fleet.errors_at_the_end("position_error", feedback=True).max() < 5e-3
        return fleet.errors_at_the_end("error", feedback=False)

    first = ends(0)
    assert np.array_equal(first, ends(0))
    assert not np.intersect1d(first, ends(1)).size


def test_a_longer_run_takes_the_same_path():
    short, long = SetPoints.of(PAPER, control := PAPER.control(PAPER.initial)), None
    long = SetPoints.of(PAPER, control, duration=10)
    assert long.times[-1] == pytest.approx(10)
    assert np.array_equal(short.values, long.values)
    carts = []
    for duration in (None, 10):
        SetPoints.of(CART, CART.control(CART.initial), duration).run(cart := Cart())
        carts.append(cart.pose)
    assert carts[0] == pytest.approx(carts[1], abs=1e-3)


def test_an_offset_of_the_encoders_moves_nothing():
    robot = wrong_robot()
    lengths = ROBOT.actuator_positions(PAPER.start_point)
    robot.command(lengths + 3)
    robot.advance(0.1)
    assert robot.point == pytest.approx(PAPER.start_point, abs=1e-12)


def test_a_simulated_machine_is_the_model_where_nothing_is_wrong():
    control = PAPER.control(PAPER.initial)
    SetPoints.of(PAPER, control).run(plant := SimulatedPlant(ROBOT, PAPER.start))
    end = nhpocp.simulate(PAPER, control).trajectory["position"][-1]
    assert plant.point[:3] == pytest.approx(end, abs=1e-3)


def test_errors_are_read_as_they_are_written():
    errors = ModelErrors.parsed("roller_tilt=2deg, base_radius=1%,platform_radius=0.3", ROBOT)
    system, gains, wrong = errors.machine()
    assert gains is None
    assert wrong == pytest.approx({"roller_tilt": 77 * deg, "base_radius": 30.3, "platform_radius": 15.3})
    assert system.parameters()["base_radius"] == pytest.approx(30.3)
    assert ModelErrors.parsed("w=-5%", CART.system).machine()[1] == pytest.approx([1, 0.95])
    assert [error.name for error in ModelErrors.parsed("2%", nhpocp.Car()).errors] == ["wheelbase"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("roler_tilt=2deg", "did you mean 'roller_tilt'?"),
        ("roller_tilt=two", "expected a number"),
        ("roller_tilt", "expected NAME=AMOUNT"),
        ("base_radius=1%,base_radius=2%", "given twice"),
        ("base_radius=-100%", "no machine of these errors"),
    ],
)
def test_errors_that_are_none_are_refused(text, words):
    with pytest.raises(InvalidProblemError, match=re.escape(words)):
        ModelErrors.parsed(text, ROBOT).machine()


def test_wrong_calls_are_answered():
    with pytest.raises(CallError, match="expected a plant"):
        QUICK.run(CART, object())
    with pytest.raises(InvalidProblemError, match="none of none, effort"):
        Steering(objective="efort")
    with pytest.raises(InvalidProblemError, match="number > 0"):
        Steering(duration=0)
    with pytest.raises(InvalidProblemError, match="expected 3 finite numbers"):
        wrong_robot().command([1, 2])
    with pytest.raises(InvalidProblemError, match="noise"):
        SimulatedPlant(ROBOT, PAPER.start, noise=-1)


def test_a_plan_that_never_moved_falls_back_to_the_solver():
    replanner = Replanner.of(PAPER, 1e-3)
    plan = replanner.plan(PAPER)
    useless = replace(plan, control=PAPER.control(np.zeros_like(PAPER.initial)))
    assert replanner.plan(PAPER, PlannedRun(useless, 1.0)).outcome.value == "converged"
