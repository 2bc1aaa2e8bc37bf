"""Tasks: errors and Jacobians of blocks and outputs, and the same goals reached by both solvers."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from nhpocp import planning, so3
from nhpocp.constraints.bound import Bound
from nhpocp.errors import InvalidProblemError, OrientationAtPiError
from nhpocp.outcome import Outcome
from nhpocp.problem_file import dump_problem, parse_problem, read_text, systems
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.solvers.nlp.guesses import StraightGuess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.task import Task
from nhpocp.via import Via
from nhpocp.views.figures import relative_pose
from tests.conftest import paper_problem, yaw

RANDOM = np.random.default_rng(5)
VALUES = {
    "position": np.array([1.0, -2.0, 30.0]),
    "orientation": yaw(-1.0),
    "leg_lengths": np.array([38.0, 39.0, 40.0]),
    "platform_normal": np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0]),
}
GOALS = [
    ("position",),
    ("orientation",),
    ("leg_lengths",),
    ("platform_normal",),
    ("position", "platform_normal"),
    ("leg_lengths", "orientation"),
    ("leg_lengths", "platform_normal"),
]


def task_of(names, system=None):
    system = system or paper_problem().system
    return Task(system, {name: VALUES[name] for name in names}, 1.0, 2.0, 15.0)


def pose(system):
    turn = so3.exp(RANDOM.normal(scale=0.5, size=3))
    return np.asarray(system.state_space.pack({"position": [1.0, 2.0, 27.0], "orientation": turn}))


@pytest.mark.parametrize("names", GOALS, ids=" ".join)
def test_e_falls_along_the_step_that_the_jacobian_promises(names):
    """Along δ with J δ = -e the error shrinks to (1 - γ) e: by finite differences of e itself."""
    task = task_of(names)
    space, h = task.space, 1e-6
    for _ in range(3):
        point = pose(task.system)
        e, J = task.scales * task.difference(point), task.jacobian(point, np.eye(6))
        assert e.shape == (task.size,) == (len(task.units),) == task.weights.shape
        step = -np.linalg.lstsq(J, e, rcond=None)[0]
        there = task.scales * task.difference(np.asarray(space.retract(point, h * step)))
        np.testing.assert_allclose((there - e) / h, -e, atol=2e-5)


@pytest.mark.parametrize("names", GOALS, ids=" ".join)
def test_the_equations_vanish_where_the_error_does_and_agree_to_first_order(names):
    task, space = task_of(names), paper_problem().system.state_space
    x = ca.SX.sym("x", space.size)
    equations = ca.Function("equations", [x], [ca.vertcat(*task.equations(x))])
    point = pose(task.system)
    found = np.array(equations(point)).ravel()
    np.testing.assert_allclose(found, [float(value) for value in task.equations(point)], atol=1e-12)
    # Newton's method on e ends where the equations hold
    for _ in range(25):
        J = task.jacobian(point, np.eye(6))
        e = task.scales * task.difference(point)
        point = np.asarray(space.retract(point, -np.linalg.lstsq(J, e, rcond=None)[0]))
    assert task.error(point) < 1e-12
    np.testing.assert_allclose(np.array(equations(point)), 0, atol=1e-12)


def test_the_error_of_a_direction_is_its_angle():
    task, space = task_of(["platform_normal"]), paper_problem().system.state_space
    normal = VALUES["platform_normal"]
    across = np.cross(normal, [0, 0, 1.0]) / np.linalg.norm(np.cross(normal, [0, 0, 1.0]))
    upright = so3.exp(-np.arctan2(np.hypot(*normal[:2]), normal[2]) * across)  # takes e_z to the normal
    for angle in (0.0, 1e-9, 1e-3, 0.1, 1.0, 3.0, np.pi - 1e-6):
        turned = so3.exp(angle * across) @ upright
        point = np.asarray(space.pack({"position": [0, 0, 25], "orientation": turned}))
        np.testing.assert_allclose(turned[:, 2] @ normal, np.cos(angle), atol=1e-12)
        assert task.error(point) == pytest.approx(angle, abs=1e-12)
        assert np.isfinite(task.jacobian(point, np.eye(6))).all()
    point = np.asarray(space.pack({"position": [0, 0, 25], "orientation": so3.exp(np.pi * across) @ upright}))
    with pytest.raises(OrientationAtPiError, match=r"3\.14159\d* rad, a half turn"):
        task.difference(point)
    assert np.isnan(task.error(point))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.03, 0.04, 1.0, np.pi / 2, 3.0, np.pi - 1e-7])
def test_the_turn_between_two_directions(angle):
    origin, axis = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    direction = so3.exp(angle * axis) @ origin
    np.testing.assert_allclose(so3.between(origin, direction), angle * axis, atol=1e-12, rtol=1e-7)
    np.testing.assert_allclose(so3.exp(so3.between(origin, direction)) @ origin, direction, atol=1e-8)
    y = ca.SX.sym("y", 3)
    turn = so3.between(ca.DM(origin), y)
    values = ca.Function("turn", [y], [turn, ca.jacobian(turn, y)])(direction)
    np.testing.assert_allclose(np.array(values[0]).ravel(), so3.between(origin, direction), atol=1e-12)
    assert np.isfinite(np.array(values[1])).all()
    if angle < 3.1:  # beyond, the denominator has no digits
        np.testing.assert_allclose(so3.gibbs_between(origin, direction), np.tan(angle / 2) * axis, atol=1e-12)


def test_opposite_directions_have_no_turn():
    with pytest.raises(OrientationAtPiError):
        so3.between(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))


# --- solved ---------------------------------------------------------------------------------------------------


NEWTON = Continuation(step_rule=Adaptive())
NLP = MultipleShooting(intervals=40)
SOLVED = {
    "leg_lengths": {"leg_lengths": VALUES["leg_lengths"]},
    "platform_normal": {"platform_normal": [0.2, -0.1, 1]},
    "legs and normal": {"leg_lengths": [42.3, 42.4, 42.5], "platform_normal": [0, 0.02, 1]},
    "position and normal": {"position": [0, 0, 35], "platform_normal": [0.1, 0, 1]},
}


def reached(solution, goal):
    """How far the trajectory's own end, from its pose and the legs' geometry, is from a goal."""
    end = {name: solution.trajectory[name][-1] for name in ("position", "orientation")}
    legs = solution.problem.system.legs
    ends = [end["position"] + end["orientation"] @ leg.platform - leg.base for leg in legs]
    end |= {"leg_lengths": np.linalg.norm(ends, axis=1), "platform_normal": end["orientation"] @ [0, 0, 1]}
    wanted = {name: np.asarray(value, dtype=float) for name, value in goal.items()}
    if "platform_normal" in wanted:
        wanted["platform_normal"] = wanted["platform_normal"] / np.linalg.norm(wanted["platform_normal"])
    return max(float(np.linalg.norm(end[name] - value)) for name, value in wanted.items())


@pytest.mark.parametrize("goal", SOLVED)
@pytest.mark.parametrize("solver", [NEWTON, NLP], ids=lambda solver: solver.name)
def test_outputs_are_reached_by_both_solvers(solver, goal):
    problem = paper_problem("normal75", goal=SOLVED[goal])
    solution = planning.solve(problem, solver)
    assert solution.converged, solution.message
    assert reached(solution, SOLVED[goal]) < 1.01 * solver.tolerance
    assert solution.verdict.error == pytest.approx(solution.final_error, abs=0.1 * solver.tolerance)


def test_the_least_effort_to_tilt_the_platform_is_the_square_of_the_angle():
    """∫|ω|² ≥ φ²/T, and v = -ω is free: [Paper] eq. (7)."""
    angle = np.arctan(np.hypot(0.2, 0.1))
    problem = paper_problem(goal={"platform_normal": [0.2, -0.1, 1]})
    for solver in (NLP, replace(NLP, optimizer=Fatrop()), replace(NEWTON, objective="effort")):
        assert planning.solve(problem, solver).costs["effort"] == pytest.approx(angle**2, rel=1e-5)


def test_output_errors_decay_as_16_says():
    """ė = -γ e with the output's own derivative: (17) leaves 1 - γ of the error, to second order."""
    problem = paper_problem(goal={"leg_lengths": [31.0, 31.2, 31.1]}, initial=0.1 * np.eye(3, 5))
    errors = [
        r["error"] for r in Continuation(step_rule=Euler(0.01), max_iterations=3).solve(problem).iterations
    ]
    assert errors[1] / errors[0] == pytest.approx(0.99, abs=1e-3)


def test_a_via_pose_may_fix_outputs():
    via = [Via(0.4, {"platform_normal": [0.1, 0, 1], "leg_lengths": [36, 36.5, 37]})]
    for solver in (NEWTON, NLP):
        solution = planning.solve(paper_problem(via=via, goal={"position": [0, 0, 35]}), solver)
        assert solution.converged, solution.message


def test_a_straight_guess_needs_a_pose():
    solution = planning.solve(paper_problem(goal=SOLVED["leg_lengths"]), replace(NLP, guess=StraightGuess()))
    assert solution.converged
    assert any("leg_lengths is an output" in words for words in solution.warnings)  # and another guess served


def test_a_direction_opposite_to_its_goal_is_named():
    """Standing still at the start, half a turn from the goal."""
    start = {"position": [0, 0, 25], "orientation": np.eye(3)}
    problem = paper_problem(start=start, goal={"platform_normal": [0, 0, -1]}, initial=np.zeros((3, 5)))
    assert NEWTON.solve(problem).outcome is Outcome.ORIENTATION_AT_PI
    solution = MultipleShooting(intervals=5).solve(problem)
    assert solution.details["attempts"][0]["outcome"] == "not_finite"
    assert "half a turn" in solution.message
    assert solution.outcome is Outcome.CONVERGED  # another guess served
    assert solution.final_error <= solution.tolerance


def test_verification_refutes_a_missed_output():
    goal = SOLVED["legs and normal"]
    claim = NEWTON.solve(paper_problem("normal75", goal=goal))
    problem = claim.problem
    for changed in ({"leg_lengths": [42.3, 42.4, 42.51]}, {"platform_normal": [0, 0.03, 1]}):
        verdict = planning.verify(replace(claim, problem=replace(problem, goal={**goal, **changed})))
        assert not verdict.ok
        assert verdict.error == pytest.approx(0.01, rel=0.05)


def test_values_that_break_a_bound_are_infeasible_at_once():
    bounds = [Bound("leg_length", "leg_lengths", 20, 39.5), Bound("state.position", "position", -10, 32)]
    for goal, via, words in (
        (SOLVED["leg_lengths"], [], "the goal itself breaks leg_length[2], which is 40, outside [20, 39.5]"),
        (
            {"orientation": yaw(-1.0)},
            [Via(0.5, {"position": [0, 0, 33]})],
            "the via pose at 0.5 itself breaks",
        ),
    ):
        solution = planning.solve(paper_problem(goal=goal, via=via, bounds=bounds), NEWTON)
        assert (solution.outcome, solution.evaluations) == (Outcome.INFEASIBLE, 0)
        assert words in solution.message


def test_pictures_of_a_goal_that_is_an_output():
    """One panel an output: the legs' lengths off theirs, and the turn from the wanted direction."""
    figure = relative_pose(NEWTON.solve(paper_problem("normal75", goal=SOLVED["legs and normal"])))
    lengths, turn = (
        [line.get_ydata() for line in axes.get_lines() if len(line.get_ydata()) > 2] for axes in figure.axes
    )
    assert (len(lengths), len(turn)) == (3, 3)
    assert max(abs(values[-1]) for values in [*lengths, *turn]) < 1e-3 < abs(lengths[0][0])


# --- written ----------------------------------------------------------------------------------------------------


FILE = """\
nhpocp: 1
system: {model: three_upu}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -pi/6]}}
goal: {leg_lengths: [38, 39, 40], platform_normal: [0, 0.1, 1]}
"""


def test_a_file_may_name_outputs_and_comes_back():
    problem = parse_problem(FILE)
    assert set(problem.goal) == {"leg_lengths", "platform_normal"}
    assert np.linalg.norm(problem.goal["platform_normal"]) == pytest.approx(1.0)
    again = parse_problem(dump_problem(replace(problem)))
    for name, value in problem.goal.items():
        np.testing.assert_array_equal(again.goal[name], value)
    assert read_text(FILE).filled()["goal"]["platform_normal"] == [0, 0.1, 1]
    assert read_text(FILE).warnings == []
    named = [output["name"] for output in systems()["three_upu"]["pose_outputs"]]
    assert named == ["leg_lengths", "platform_normal"]


@pytest.mark.parametrize(
    ("goal", "path", "words"),
    [
        ("{leg_length: [38, 39, 40]}", "goal.leg_length", "did you mean 'leg_lengths'?"),
        ("{leg_lengths: [38, 39]}", "goal.leg_lengths", "2 numbers; expected 3"),
        ("{platform_normal: [0, 0, 0]}", "goal.platform_normal", "the zero vector"),
        (
            "{platform_normal: {rpy: [0, 0, 0]}}",
            "goal.platform_normal",
            "expected \\[x, y, z\\], got a mapping",
        ),
        ("{joint_angles: [0, 0, 0]}", "goal.joint_angles", "unknown key"),
        (
            "{position: [0, 0, 30], leg_lengths: [38, 39, 40], platform_normal: [0, 0, 1]}",
            "goal",
            "fixes 8 numbers of a state that has 6",
        ),
    ],
)
def test_what_is_no_goal_is_refused_with_its_place(goal, path, words):
    text = FILE.replace("{leg_lengths: [38, 39, 40], platform_normal: [0, 0.1, 1]}", goal)
    with pytest.raises(InvalidProblemError, match=words) as caught:
        read_text(text, "p.yaml")
    assert (caught.value.path, caught.value.line) == (path, 4)


def test_python_is_refused_the_same():
    for goal, words in (
        ({}, "expected some of position: .*, orientation: .*, leg_lengths: .*, platform_normal"),
        ({"platform_normal": [0, 0, 0]}, "zero vector"),
        ({**VALUES}, "fixes 11 numbers"),
        ({"u": [0, 0, 0]}, "unknown key"),
    ):
        with pytest.raises(InvalidProblemError, match=words):
            paper_problem(goal=goal)
