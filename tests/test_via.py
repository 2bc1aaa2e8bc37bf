"""Via poses: both solvers pass them at their time, by the replay's word."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.flow.end_point_map import VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.horizon import Horizon
from nhpocp.planning import solve
from nhpocp.problem_file import dump_problem, parse_problem, read_text
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler, Ode
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.solvers.nlp.guesses import (
    NoGuessError,
    ProblemGuess,
    SolverGuess,
    StraightGuess,
    make_guess,
    meets,
    waypoints,
)
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.single_shooting import SingleShooting
from nhpocp.solvers.nlp.task_rows import place, stage_knots
from nhpocp.systems.numeric import numeric_system
from nhpocp.verification.replay import replay
from nhpocp.via import Via
from tests.conftest import paper_problem, yaw

MIDDLE = {"position": [0, 0, 30]}
NEWTON = Continuation(step_rule=Adaptive())


def with_via(preset="default", at=0.5, values=None, **changes):
    return paper_problem(preset, via=[Via(at, values or MIDDLE)], **changes)


def passed(solution, share):
    """The replayed pose at a share of the horizon: SciPy, none of the solvers' code."""
    problem = solution.problem
    path = replay(numeric_system(problem.system), solution.control, problem.start_point)
    return problem.system.state_space.unpack(path.at(share * solution.control.horizon))


@pytest.mark.parametrize("at", [0.5, 0.37])
@pytest.mark.parametrize("preset", ["default", "normal75"])
@pytest.mark.parametrize("solver", [NEWTON, MultipleShooting(intervals=40)], ids=lambda s: s.name)
def test_the_replayed_path_passes_the_via_pose(solver, preset, at):
    solution = solve(with_via(preset, at), solver)
    assert solution.converged, solution.message
    position = passed(solution, at)["position"]
    assert np.linalg.norm(position - [0, 0, 30]) < 1.01 * solver.tolerance
    assert solution.verdict.error == pytest.approx(solution.final_error, abs=0.1 * solver.tolerance)
    # without it the path is elsewhere
    without = solve(replace(solution.problem, via=()), NEWTON)
    assert np.linalg.norm(passed(without, at)["position"] - [0, 0, 30]) > 0.1


@pytest.mark.parametrize(
    "solver",
    [
        Continuation(step_rule=Euler(1.0)),
        Continuation(step_rule=Ode(1.0), tolerance=1e-2),
        replace(NEWTON, sensitivity=VariationalEndPointMap),
        replace(NEWTON, integrator=CasadiRungeKutta()),
        replace(NEWTON, integrator=Cvodes()),
        replace(NEWTON, integrator=RungeKutta4(30)),
    ],
    ids=["euler", "ode", "variational", "rk", "cvodes", "coarse"],
)
def test_every_kind_of_continuation_takes_via_poses(solver):
    problem = with_via(at=0.37)
    solution = solve(problem, solver)
    assert solution.converged, solution.message
    # the first record's E is over all tasks: that of the start's control at the goal alone is 1.3377
    end = passed(replace(solution, control=problem.control(problem.initial)), 0.37)
    missed = np.linalg.norm(end["position"] - [0, 0, 30])
    first = np.hypot(missed, 1.3376783)
    assert solution.iterations[0]["error"] == pytest.approx(first, rel=1e-4)


def test_a_piecewise_constant_basis_and_two_via_poses():
    via = [Via(0.73, {"orientation": yaw(-1.4)}), Via(0.31, {"position": [0, 0, 27]})]
    problem = paper_problem(via=via, basis=PiecewiseConstant(8), initial=None)
    assert [task.share for task in problem.tasks] == [0.31, 0.73, 1.0]
    solution = solve(problem, NEWTON)
    assert solution.converged, solution.message
    assert np.linalg.norm(passed(solution, 0.31)["position"] - [0, 0, 27]) < 1.01e-3
    assert np.linalg.norm(passed(solution, 0.73)["orientation"] - yaw(-1.4)) < 2e-3


def test_the_null_space_phase_keeps_the_via_pose_and_meets_the_nlp_over_the_same_basis():
    problem = with_via(at=0.37)
    least = solve(problem, replace(NEWTON, objective="effort"))
    assert least.converged, least.message
    assert np.linalg.norm(passed(least, 0.37)["position"] - [0, 0, 30]) < 1e-5
    nlp = MultipleShooting(
        intervals=30, steps_per_interval=4, over_basis=True, guess=SolverGuess(NEWTON), optimizer=Ipopt(1e-5)
    )
    same = solve(problem, nlp)
    assert same.converged, same.message
    assert least.costs["effort"] == pytest.approx(same.costs["effort"], rel=1e-5)


NLPS = {
    "inside": (0.37, {}, {"intervals": 40}),
    "fatrop": (0.37, {}, {"intervals": 40, "optimizer": Fatrop()}),
    "single": (
        0.37,
        {},
        {"intervals": 20, "transcription": SingleShooting, "over_basis": True, "optimizer": Ipopt(1e-3)},
    ),
    "free horizon": (0.37, {"horizon": Horizon(1.0, 0.5, 3.0), "objective": "leg_effort"}, {"intervals": 40}),
    "mesh check": (0.37, {}, {"intervals": 20, "mesh_check": True}),
    "straight": (0.37, {}, {"intervals": 40, "guess": StraightGuess()}),
    "auto start": (0.37, {"initial": None}, {"intervals": 40}),
}


@pytest.mark.parametrize("case", NLPS)
def test_every_kind_of_nlp_takes_via_poses(case):
    at, changes, settings = NLPS[case]
    solver = MultipleShooting(**settings)
    solution = solve(with_via(at=at, **changes), solver)
    assert solution.converged, solution.message
    assert np.linalg.norm(passed(solution, at)["position"] - [0, 0, 30]) < 1.01 * solver.tolerance
    assert solution.details["optimality"]["stationarity"] < 1e-5
    if case == "mesh check":
        assert solution.details["mesh_check"]["outcome"] == "converged"
    if case == "free horizon":
        assert solution.control.horizon == pytest.approx(3.0)


def test_a_via_pose_that_no_interval_can_meet_is_named_when_it_fails():
    problem = with_via(at=0.37, values={"position": [0, 0, 500]})
    solver = MultipleShooting(intervals=5)
    solver = replace(solver, optimizer=replace(solver.optimizer, max_iterations=4))
    solution = solve(problem, solver)
    assert not solution.converged
    assert solution.final_error > 100
    assert any("via pose at 0.37" in reason for reason in solution.verdict.reasons)
    gone = solve(problem, replace(NEWTON, max_iterations=3))
    assert not gone.converged
    assert gone.iterations[0]["error"] > 100


def test_position_only_goals_with_a_via_pose():
    problem = with_via(at=0.37, goal={"position": [-0.4, -0.2, 35]})
    for solver in (NEWTON, MultipleShooting(intervals=40)):
        solution = solve(problem, solver)
        assert solution.converged, solution.message
        assert (
            np.linalg.norm(solution.trajectory["position"][-1] - [-0.4, -0.2, 35]) < 1.01 * solver.tolerance
        )


def test_the_meeting_is_the_path_that_everybody_else_follows():
    """The row's value at a rolled-out path is the pose of an RK4 with a step that ends there."""
    for basis in (None, Fourier(2)):
        for at in (0.37, 0.5, 0.01):
            problem = with_via(at=at)
            guess = make_guess(ProblemGuess(), problem, basis, 10, 0)
            programme = SingleShooting(problem, guess, basis, 10, 2, [], Interpreted())
            values = np.array(programme.functions["nlp"](programme.pack(guess), [])[1]).ravel()
            rows = [i for i, row in enumerate(programme.rows) if row.name.startswith("via")]
            point = meets(problem, guess.control, 10, 2)[0]
            expected = (point[:3] - [0, 0, 30]) / problem.scale
            np.testing.assert_allclose(values[rows], expected, atol=1e-9)
            assert {programme.rows[i].time for i in rows} == {at}


@pytest.mark.parametrize("steps", [1, 3, 4])
@pytest.mark.parametrize("offset", [0.0, 0.2, 1 / 3, 0.5, 0.9])
def test_the_steps_of_a_stage_lead_to_the_offset(steps, offset):
    times = CLASSICAL.times(stage_knots(offset, steps))
    assert times[0] == 0
    assert times[-1] == pytest.approx(offset)
    np.testing.assert_allclose(times[1::2], 0.5 * (times[:-1:2] + times[2::2]))
    assert np.all(np.diff(times[::2]) <= 1 / steps + 1e-9)


def test_a_share_is_at_a_node_up_to_rounding():
    assert place(0.3, 10) == (3, 0.0)
    assert place(0.1 + 0.2, 10) == (3, 0.0)
    assert place(0.37, 10) == (3, pytest.approx(0.7))


def test_waypoints_fill_in_free_blocks():
    problem = paper_problem(via=[Via(0.25, {"position": [0, 0, 30]}), Via(0.5, {"orientation": yaw(-1.0)})])
    shares, points = waypoints(problem)
    space = problem.system.state_space
    assert shares.tolist() == [0, 0.25, 0.5, 1]
    poses = [space.unpack(point) for point in points]
    np.testing.assert_allclose(poses[2]["position"], [-0.4 / 3, -0.2 / 3, 30 + 5 / 3])
    np.testing.assert_allclose(poses[1]["orientation"], yaw(0.5 * (-np.pi / 6 - 1.0)), atol=1e-12)
    np.testing.assert_allclose(points[-1], problem.goal_point, atol=1e-12)
    with pytest.raises(NoGuessError, match="leg_lengths is an output"):
        waypoints(replace(problem, goal={"leg_lengths": [38, 39, 40]}))


VIA = "via: [{at: 0.5, position: [0, 0, 30]}]"
FILE = f"""\
nhpocp: 1
system: {{model: three_upu}}
start: {{position: [0, 0, 25], orientation: {{rpy: [0, 0, -pi/6]}}}}
goal: {{position: [-0.4, -0.2, 35], orientation: {{rpy: [0, 0, -pi/2]}}}}
{VIA}
"""


def test_the_file_says_the_same_as_python_and_comes_back():
    problem = parse_problem(FILE)
    assert [(task.share, set(task.values)) for task in problem.tasks[:-1]] == [(0.5, {"position"})]
    again = parse_problem(dump_problem(replace(problem)))
    assert [via.share for via in again.via] == [0.5]
    np.testing.assert_array_equal(again.via[0].goal["position"], [0, 0, 30])
    filled = read_text(FILE).filled()
    assert filled["via"] == [{"at": 0.5, "position": [0, 0, 30]}]
    assert read_text(json.dumps(filled)).filled() == filled


@pytest.mark.parametrize(
    ("line", "path", "words"),
    [
        ("via: [{at: 0.5}]", "via[0]", "empty; expected some of position"),
        (f"{VIA[:-1]}, {{at: 0.5, orientation: {{rpy: [0, 0, 0]}}}}]", "via[1].at", "already"),
        ("via: [{at: 0.5, positon: [0, 0, 30]}]", "via[0].positon", "did you mean 'position'"),
    ],
)
def test_a_via_pose_that_cannot_be_meant_is_refused_with_its_place(line, path, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        read_text(FILE.replace(VIA, line))
    assert (caught.value.path, caught.value.line) == (path, 5)


@pytest.mark.parametrize("share", [0.0, 1.0, 1e-9, 1 - 1e-9, 0.5, np.nan])
def test_python_refuses_times_that_are_taken(share):
    with pytest.raises(InvalidProblemError, match="via"):
        paper_problem(via=[Via(0.5, MIDDLE), Via(share, MIDDLE)])
