"""Routes of poses: what makes a pose valid, edges without gaps, searches that end, and what they say."""

import subprocess
import sys
from dataclasses import replace

import casadi as ca
import goals
import numpy as np
import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

import nhpocp
from nhpocp import planning
from nhpocp.bodies.obstacles import Obstacle
from nhpocp.constraints.bound import Bound
from nhpocp.errors import InvalidProblemError, MissingDependencyError
from nhpocp.flow.compiled.kernels import Compiled
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import settled_path
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation import auto
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.route_manoeuvres import RouteManoeuvres
from nhpocp.solvers.continuation.settings import JacobianSettings
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.route import easing
from nhpocp.solvers.route import find_route as find_route_module
from nhpocp.solvers.route.easing import eased
from nhpocp.solvers.route.find_route import find_route, lacking
from nhpocp.solvers.route.pose_checks import PoseChecks, least_margins, pose_checks, signed_least
from nhpocp.solvers.route.route import LEAST, Poses, Route
from nhpocp.solvers.route.rrt_connect import ROOM, Trees, _box
from nhpocp.systems.numeric import numeric_system
from tests.conftest import paper_problem, yaw

BENT, STRAIGHT = 13, 3  # robots whose goals are seen from the start, and are not
COMPILED = Continuation(step_rule=Adaptive(), integrator=RungeKutta4(kernels=Compiled()))
LAME = Auto(Continuation(step_rule=Adaptive(), max_iterations=1), restarts=0)


def walked(seed, **changes):
    task = goals.random_robot_task(seed)
    return replace(task.towards(goals.walked_goal(task, seed)), **changes)


@pytest.fixture(scope="module")
def bent():
    return walked(BENT)


@pytest.fixture(scope="module")
def bent_route(bent):
    return find_route(bent, 60.0, 0)


@pytest.fixture(scope="module")
def followed():
    """A goal that no start leads to, by manoeuvres along a route."""
    return planning.solve(walked(STRAIGHT), Auto(COMPILED, restarts=0))


def test_a_route_leads_from_start_to_goal_without_an_invalid_pose(bent, bent_route):
    route = bent_route.route
    assert len(route.waypoints) > 2
    np.testing.assert_array_equal(route.waypoints[[0, -1]], [bent.start_point, bent.goal_point])
    path = np.array([route.at(length) for length in np.linspace(0.0, route.length, 1001)])
    assert route.poses.checks.slacks(path).min() > 0
    numeric = numeric_system(bent.system)
    for name, values in numeric.determinants(path).items():
        assert (values * values[0] > 0).all(), name
    least = {check.matrix: check.least for check in bent_route.checks.checks}
    for name, values in numeric.sigmas(path, bent.scale).items():
        assert values.min() > least[name] > 0


def test_the_straight_motion_of_that_robot_is_no_route(bent, bent_route):
    assert not bent_route.route.poses.free(bent.start_point, bent.goal_point)
    assert sum(bent_route.route.poses.checks.refusals.values()) > 0


def test_a_search_is_seeded(bent, bent_route):
    again, other = find_route(bent, 60.0, 0), find_route(bent, 60.0, 1)
    np.testing.assert_array_equal(again.route.waypoints, bent_route.route.waypoints)
    assert other.route.waypoints.shape != again.route.waypoints.shape or not np.allclose(
        other.route.waypoints, again.route.waypoints
    )


@pytest.mark.parametrize("seed", [2**64 - 2, 2**64 - 1, 2**70])
def test_a_search_takes_any_seed(bent, seed):
    assert find_route(bent, 60.0, seed).route is not None


TURN = st.floats(-1.5, 1.5)
SHIFT = st.floats(-1.5, 1.5)


@pytest.fixture(scope="module")
def spaces():
    """Poses of several robots, measured."""
    problems = [walked(seed) for seed in (0, 2, 5)]
    return [(p, Poses(p, pose_checks(p, 0.2))) for p in problems]


@settings(max_examples=60, deadline=None)
@given(
    robot=st.integers(0, 2), tangent=st.tuples(SHIFT, SHIFT, SHIFT, TURN, TURN, TURN), part=st.floats(0, 1)
)
def test_an_edge_that_is_free_has_no_invalid_pose(spaces, robot, tangent, part):
    """At a hundred times as many samples as it began with."""
    problem, poses = spaces[robot]
    middle = poses.tangent(problem.goal_point, problem.start_point)[0]
    here = poses.checks.between(problem.start_point, middle, np.array([part]))[0]
    there = problem.system.state_space.retract(here, np.array(tangent) * problem.scales.states)
    if not poses.free(here, there):
        return
    moved, size = poses.tangent(there, here)
    samples = poses.checks.between(here, moved, np.linspace(0.0, 1.0, 100 * (2 + int(10 * size))))
    assert poses.checks.slacks(samples).min() > 0


def test_bounds_that_a_pose_can_break_are_checked_and_rates_are_not():
    bounds = {
        "leg_length": [20, 60],
        "leg_speed": 1e-3,
        "clearance": 0.01,
        "joint_angle": {"theta4": [-1.5, 1.5]},
    }
    problem = paper_problem(bounds=bounds)
    checks = pose_checks(problem, 0.0)
    names = [check.name for check in checks.checks]
    assert names[2:] == ["leg_length", "joint_angle.theta4"]
    assert "det S = 0" in names[0]
    assert "det W = 0" in names[1]
    high = problem.start_point.copy()
    high[2] += 60
    assert not checks.valid(high[None])
    assert checks.refusals["leg_length"] == 1
    lengths = numeric_system(problem.system).outputs(high[None], np.zeros((1, 3)))["leg_lengths"]
    assert checks.least(checks.slacks(high[None]))[2] == pytest.approx((60 - lengths.max()) / 60, abs=1e-3)


@pytest.mark.parametrize("others", [{}, {"leg_length": [20, 60]}])
def test_a_bound_that_is_open_on_both_sides_refuses_nothing(others):
    problem = paper_problem(bounds={**others, "state": {"position": [None, None]}})
    ends = np.stack([problem.start_point, problem.goal_point])
    for fraction in (0.0, 0.2):
        assert pose_checks(problem, fraction).valid(ends)
        names = [check.name for check in pose_checks(problem, fraction).checks]
        assert names[2:] == list(others)


def test_routes_keep_a_part_of_what_start_and_goal_have_to_spare():
    problem = paper_problem(bounds={"leg_length": [20, 60]})
    ends = np.stack([problem.start_point, problem.goal_point])
    bare, reserved = (pose_checks(problem, fraction).slacks(ends)[:, 2:] for fraction in (0.0, 0.2))
    assert bare.shape == (2, 6)  # either limit of each leg
    assert bare.min() > 0
    np.testing.assert_allclose(bare - reserved, 0.2 * bare.min(), atol=1e-3)


def test_a_clearance_that_is_asked_for_is_kept_by_routes():
    problem = paper_problem(bounds=[Bound("clearance.sigma_s", "sigma_s", 0.3)])
    least = least_margins(problem, 0.01)
    assert least["s"] == 0.3
    assert 0 < least["w"] < 0.3


def test_the_end_of_a_search_without_a_route_says_how_near_it_came(bent):
    words = find_route(bent, 60.0, 0, stopped=lambda: True).words
    assert "the tree from the start (" in words
    assert "came as near to the goal as" in words
    assert " deg" in words
    assert "σ" not in words.partition(":")[0]


def test_what_refused_most_is_named(bent):
    """Trees that did not grow, since their straight motion was refused three times."""
    poses = Poses(bent, pose_checks(bent, 0.5))
    ends = np.stack([bent.start_point, bent.goal_point])
    assert not any(poses.free(*ends) for _ in range(3))
    words = find_route_module._growth(bent, poses, Trees(None, *ends[:, None]), 1.0)
    refusals = poses.checks.refusals
    most = max(refusals, key=lambda name: refusals[name])
    assert words.endswith(f"most refused by {most} ({refusals[most]} of {sum(refusals.values())})")


def test_a_goal_out_of_bounds_is_named_at_once(bent):
    position = np.asarray(bent.start["position"])
    box = Bound("state.position", "position", position - 1.0, position + 1.0)
    words = find_route(bent.with_(bounds=[box]), 60.0, 0).words
    assert words == "no route leads from or to the goal, which is refused by state.position"


def test_manoeuvres_along_a_route_stay_clear_of_what_it_avoids(followed):
    assert followed.converged, followed.message
    assert "manoeuvres in sequence along a route" in followed.message
    assert len(followed.control.basis.bases) > 1
    assert not followed.verdict.crossings
    assert followed.trajectory["sigma_s"].min() > 0.01
    assert followed.settings["route"] == "auto"


def test_every_manoeuvre_keeps_the_checks(followed):
    """Of the first three, held against the same controls integrated by themselves."""
    problem = followed.problem
    found = find_route(problem, 60.0, 0)
    manoeuvres = RouteManoeuvres(problem, COMPILED, found.route, found.checks, 0)
    for _ in manoeuvres.walk():
        if len(manoeuvres.controls) == 3:
            break
    here = problem.start_point
    for control in manoeuvres.controls:
        _, path = settled_path(problem, control, 400, here)
        assert found.checks.slacks(path).min() > 0
        here = path[-1]
    np.testing.assert_allclose(here, manoeuvres.here, atol=1e-4)
    space = problem.system.state_space
    missed = space.weights(problem.error_length) * space.difference(here, found.route.at(manoeuvres.walked))
    assert np.linalg.norm(missed) < 1e-2  # what the steps of the search miss, in which the next one begins
    assert not manoeuvres.arrived


@pytest.mark.parametrize(
    ("system", "start", "goal"),
    [
        (nhpocp.Unicycle(), {"x": 0, "y": 0, "theta": 0}, {"x": 1, "y": 2, "theta": 2.5}),
        (nhpocp.Car(), {"x": 0, "y": 0, "theta": 0, "phi": 0}, {"x": 0, "y": 1.5, "theta": 3, "phi": 0}),
    ],
    ids=["unicycle", "car"],
)
def test_vehicles_follow_routes_too(system, start, goal):
    solution = planning.solve(
        nhpocp.PlanningProblem(system=system, start=start, goal=goal), Auto(COMPILED, route="always")
    )
    assert solution.converged, solution.message
    assert solution.details["tried"][0]["way"].endswith("along a route")


WALL = {"centre": [0, 2], "size": [20, 0.3]}
CLUSTER = {"centre": [5, 0], "size": [4, 5]}


@pytest.mark.parametrize(
    ("goal", "rectangle"), [([0, 4], WALL), ([10, 0], CLUSTER)], ids=["wider than the way", "as wide as long"]
)
def test_routes_lead_around_what_is_wide(goal, rectangle):
    """Coordinates without bounds were looked for no farther than 2 beside start and goal, each for itself."""
    problem = nhpocp.PlanningProblem(
        system=nhpocp.Car(),
        start={"x": 0, "y": 0, "theta": 0, "phi": 0},
        goal={"x": goal[0], "y": goal[1], "theta": 0, "phi": 0},
        obstacles=[Obstacle("rectangle", rectangle)],
        bounds={"distance": 0.1},
    )
    assert find_route(problem, 60.0, 0).route is not None


def test_a_car_does_not_turn_its_wheels_across():
    problem = nhpocp.PlanningProblem(
        system=nhpocp.Car(),
        start={"x": 0, "y": 0, "theta": 0, "phi": 0},
        goal={"x": 1, "y": 0, "theta": 0, "phi": 0},
    )
    poses = Poses(problem, pose_checks(problem, 0.0))
    assert not poses.free(
        np.array([0.0, 0, 0, 0]), np.array([0.0, 0, 0, 3.0])
    )  # tan φ is finite at both ends


def test_a_half_turn_is_no_straight_part():
    problem = paper_problem()
    poses = Poses(problem, pose_checks(problem, 0.2))
    back = problem.system.state_space.pack(
        {"position": problem.start["position"], "orientation": yaw(np.pi - np.pi / 6)}
    )
    assert not np.isfinite(poses.tangent(np.asarray(back), problem.start_point)[1])


def test_a_route_begins_at_a_pose_half_a_turn_from_the_identity():
    problem = nhpocp.PlanningProblem(
        system=nhpocp.RollingSphere(),
        start={"position": [0, 0], "orientation": {"rpy": [0, 0, np.pi]}},
        goal={"position": [3, 0], "orientation": {"rpy": [0, 0, np.pi - 0.3]}},
        obstacles=[{"box": {"centre": [1.5, 0, 1], "size": [0.2, 1, 2]}}],
        bounds={"distance": 0.05},
    )
    route = find_route(problem, 60.0, 0).route
    assert len(route.waypoints) > 2
    np.testing.assert_array_equal(route.waypoints[[0, -1]], [problem.start_point, problem.goal_point])


def test_an_eased_route_takes_fewer_manoeuvres_and_is_valid(bent, bent_route):
    poses = bent_route.route.poses
    ends = bent.start_point, bent.goal_point
    laborious = Route(np.insert(bent_route.route.waypoints, 1, bent_route.route.at(0.01), axis=0), poses)
    easier = eased(laborious, np.random.default_rng(0))
    assert easier.manoeuvres(0.0, easier.length) <= laborious.manoeuvres(0.0, laborious.length)
    path = np.array([easier.at(length) for length in np.linspace(0.0, easier.length, 1001)])
    assert poses.checks.slacks(path).min() > 0
    np.testing.assert_allclose(easier.waypoints[[0, -1]], ends, atol=1e-9)


def test_an_easy_route_is_worth_few_tries(bent_route, monkeypatch):
    route, tried, beside = bent_route.route, [], easing._beside
    monkeypatch.setattr(easing, "_beside", lambda *arguments: tried.append(1) or beside(*arguments))
    monkeypatch.setattr(easing, "WORTH", 1.0)
    eased(route, np.random.default_rng(1))
    assert 0 < 2 * len(tried) <= route.manoeuvres(0.0, route.length) + 2


def test_a_route_by_another_way_keeps_the_rest(bent_route):
    route = bent_route.route
    first, last = 0.3 * route.length, 0.6 * route.length
    same = route.by(first, [route.at(first), route.at(last)], last)
    for length in (0.1 * route.length, first):
        np.testing.assert_allclose(same.at(length), route.at(length), atol=1e-9)
    np.testing.assert_array_equal(same.waypoints[-1], route.waypoints[-1])


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("far", [1e7, 1e155, 1e300])
@pytest.mark.parametrize("end", ["start", "goal"])
def test_what_is_farther_than_anybody_looks_has_no_route(far, end):
    beyond = paper_problem(**{end: {"position": [far, far, far], "orientation": np.eye(3)}})
    search = find_route(beyond, 0.05, seed=0)
    assert search.route is None
    assert search.words.startswith("no route")


def test_the_checks_of_a_problem_are_built_once(monkeypatch):
    built, init = [], PoseChecks.__init__
    monkeypatch.setattr(PoseChecks, "__init__", lambda *given: built.append(1) or init(*given))
    problem = paper_problem(bounds={"leg_length": [20, 60]})
    for seed in (0, 1):
        assert find_route(problem, 60.0, seed).route is not None
    assert len(built) == 1


def test_what_is_built_counts_among_the_seconds(bent, monkeypatch):
    """Of 60, of which 50 have gone before the search: no more than 10 for any level."""
    ends, allowed, times = np.stack([bent.start_point, bent.goal_point]), [], iter([0.0])
    monkeypatch.setattr(find_route_module, "thread_time", lambda: next(times, 50.0))
    monkeypatch.setattr(
        find_route_module,
        "grown",
        lambda problem, poses, given, seed: allowed.append(given.seconds) or Trees(None, *ends[:, None]),
    )
    assert find_route(bent, 60.0, 0).route is None
    assert allowed == [9.0, 10.0, 10.0, 10.0]


def test_an_end_on_a_singular_surface_is_named_at_once():
    singular = nhpocp.ThreeUPU(10.0, 10.0, np.pi / 2, "normal")
    beside = paper_problem(system=singular, start={"position": [0, 0, 25], "orientation": yaw(0.0)})
    assert "no route leads from or to the start" in find_route(beside, 60.0, seed=0).words


def test_problems_that_no_route_serves_say_why():
    assert lacking(paper_problem()) == ""
    assert "drift" in lacking(
        nhpocp.PlanningProblem(
            system=nhpocp.DoubleIntegrator(),
            start={"q": [-1], "q_dot": [0]},
            goal={"q": [0], "q_dot": [0]},
        )
    )
    assert "via" in lacking(paper_problem(via=[{"at": 0.5, "position": [0, 0, 30]}]))
    assert "outputs" in lacking(paper_problem(goal={"leg_lengths": [38, 39, 40]}))


@pytest.mark.parametrize("objective", ["none", "effort"])
def test_where_start_is_goal_no_route_is_followed(objective):
    """It would take no manoeuvres, which are no plan."""
    rest = {"x": 0.0, "y": 0.0, "theta": 1.0}
    problem = nhpocp.PlanningProblem(system=nhpocp.Unicycle(), start=rest, goal=rest)
    turned = paper_problem(goal=paper_problem().start)
    assert lacking(problem) == lacking(turned) == "the start is the goal"
    continuation = Continuation(step_rule=Adaptive(), objective=objective)
    solution = planning.solve(problem, Auto(continuation, route="always"))
    assert solution.converged, solution.message


def test_without_ompl_auto_says_what_would_help(bent, monkeypatch):
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setattr(auto, "BUDGET", 20)
    solution = planning.solve(bent, LAME)
    assert solution.outcome is Outcome.NOT_REACHED
    assert 'pip install "nhpocp[routes]"' in solution.message
    with pytest.raises(MissingDependencyError, match=r"nhpocp\[routes\]"):
        planning.solve(bent, replace(LAME, route="always"))


def test_routes_need_the_rule_that_follows_them():
    with pytest.raises(InvalidProblemError, match="step_rule: auto"):
        JacobianSettings(step_rule="euler", route="always").solver(None, {})
    solver = JacobianSettings(route="never", route_seconds=3.0).solver(None, {})
    assert (solver.route, solver.route_seconds) == ("never", 3.0)


def test_ompl_is_quiet(tmp_path):
    """At the end of Python too, where it complains of what it finds alive."""
    code = (
        "import goals; from nhpocp.solvers.route.find_route import find_route\n"
        f"task = goals.random_robot_task({BENT})\n"
        f"print(len(find_route(task.towards(goals.walked_goal(task, {BENT})), 60.0, 0).route.waypoints))\n"
        "import gc; gc.freeze()  # as the command line does\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd="scripts", check=True
    )
    assert int(done.stdout) > 2
    assert done.stderr == ""


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=9, max_size=9), st.sampled_from([1.0, 1e-6, 0.0]))
@example(
    [1e-08, 5.960464477539063e-08, 1e-08, 3.0, 5.960464477539063e-08, -1.5, 0.0, 0.0, 0.0], 0.0
)  # rank 1, nearly
@example([0.0, 0.0, 0.125, 5.960464477539063e-08, 0.0, 0.0, 0.0, 1.0, 0.0], 1e-6)
def test_the_signed_least_singular_value_is_lapacks(entries, shrunk):
    matrix = np.reshape(entries, (3, 3))
    matrix[2] = shrunk * matrix[2] + (1 - shrunk) * matrix[:2].sum(axis=0)  # near or on det M = 0
    symbol = ca.SX.sym("M", 3, 3)
    value = float(ca.Function("least", [symbol], [signed_least(symbol)])(matrix))
    expected = np.linalg.svd(matrix, compute_uv=False)
    exact = (
        1e-7 if expected[1] > 1e-3 * expected[0] else 2e-5
    )  # of nearly rank 1 the formula's angle is rounded
    assert abs(abs(value) - expected[-1]) <= exact * expected[0]
    if expected[-1] > 1e-6 * expected[0]:
        assert value * np.linalg.det(matrix) > 0


def test_with_nothing_around_no_route_goes_far_off():
    """Through a wider box a robot's routes took three times as many manoeuvres."""
    task = goals.random_robot_task(65)
    problem = task.towards(goals.walked_goal(task, 65))
    low, high = _box(problem)
    ends = np.stack([problem.start_point[:3], problem.goal_point[:3]])
    reach = ROOM * problem.scales.length + np.ptp(ends, axis=0)
    np.testing.assert_allclose(low, ends.min(axis=0) - reach)
    np.testing.assert_allclose(high, ends.max(axis=0) + reach)


@settings(max_examples=60, deadline=None)
@given(tangent=st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), part=st.floats(0.0, 1.0))
def test_what_is_refused_for_its_manoeuvres_before_its_poses_is_no_valid_edge(
    bent, bent_route, tangent, part
):
    """Fewer poses say how many manoeuvres an edge takes than say that it is valid; they agree on what is not."""
    poses, space = bent_route.route.poses, bent.system.state_space
    here = bent_route.route.at(part * bent_route.route.length)
    there = np.asarray(space.retract(here, np.array(tangent) * poses.scales))
    takes, valid = poses.manoeuvres(here, there), poses.valid(here, there)
    size = poses.tangent(there, here)[1]
    event(f"valid: {valid}, finite: {bool(np.isfinite(takes))}")
    assert np.isfinite(takes) or not valid
    assert poses.free(here, there) == (valid and takes <= (poses.most + LEAST) * size)
