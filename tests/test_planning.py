"""What `solve` refuses before a solver starts, and what it makes of a solver's claim."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning, so3
from nhpocp.constraints.bound import Bound
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.numeric import numeric_system
from tests.conftest import paper_problem, yaw

SOLVERS = [Continuation(step_rule=Euler(1.0)), MultipleShooting()]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_a_goal_out_of_the_legs_reach_is_infeasible_at_once(solver):
    far = {"position": [0, 0, 500], "orientation": yaw(-np.pi / 2)}
    bounds = [Bound("leg_length", "leg_lengths", 20.0, 60.0)]
    solution = planning.solve(paper_problem(goal=far, bounds=bounds), solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.INFEASIBLE, 0)
    assert "goal itself breaks leg_length[" in solution.message
    assert "which is 501.1, outside [20, 60]" in solution.message


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_a_refused_task_stands_still_for_a_duration_that_its_horizon_allows(solver):
    below = {"position": [0.3, 0.2, -35], "orientation": yaw(-np.pi / 6)}
    solution = planning.solve(paper_problem(goal=below, horizon=Horizon(None, 2.0, 4.0)), solver)
    assert solution.outcome is Outcome.OTHER_COMPONENT
    assert solution.control.horizon == solution.trajectory["t"][-1] == 3.0


def test_bounds_on_speeds_are_no_matter_of_the_ends():
    bounds = [Bound("leg_speed", "u", -18.0, 18.0), Bound("control", "v", -1e-3, 1e-3)]
    short = Continuation(step_rule=Euler(1.0), max_iterations=40)  # no control keeps them; why search long
    solution = planning.solve(paper_problem(bounds=bounds), short)
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED


def test_a_stop_while_a_cure_is_sought_keeps_what_was_found(monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(planning, "patient_horizon", stop)
    bounds = [Bound("control", "v", -1e-3, 1e-3)]
    short = Continuation(step_rule=Euler(1.0), max_iterations=40)
    solution = planning.solve(paper_problem(bounds=bounds), short)
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED
    assert solution.verdict.error < 1e-3


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize("form", ["feedback", "original"])
def test_other_component_for_every_solver_and_form(solver, form):
    below = {"position": [0.3, 0.2, -35], "orientation": yaw(-np.pi / 6)}
    solution = planning.solve(paper_problem(goal=below, form=form), solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.OTHER_COMPONENT, 0)
    assert "det W is" in solution.message
    assert not solution.converged


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize(
    "goal", [{"leg_lengths": [38, 39, 40]}, {"position": [0.4, 0.1, 29]}], ids=["legs", "place"]
)
def test_a_goal_that_many_poses_meet_names_the_one_reached(solver, goal):
    solution = planning.solve(paper_problem(goal=goal), solver)
    assert solution.converged
    named = re.search(
        r"It ends at position = \((.*)\), orientation roll, pitch, yaw = \((.*)\) deg\.", solution.message
    )
    position, angles = (np.array([float(word) for word in part.split(",")]) for part in named.groups())
    np.testing.assert_allclose(position, solution.trajectory["position"][-1], rtol=1e-5)
    rotation = so3.from_rpy(np.radians(angles))
    np.testing.assert_allclose(rotation, solution.trajectory["orientation"][-1], atol=1e-5)


def test_a_goal_that_is_a_pose_needs_no_naming():
    assert "It ends at" not in planning.solve(paper_problem(), SOLVERS[0]).message


def test_the_problems_own_solver_is_the_default():
    problem = paper_problem(solvers={"jacobian": Continuation(step_rule=Euler(0.5))})
    assert planning.solve(problem).evaluations == 12
    assert planning.solve(paper_problem()).settings["step_rule"] == "auto"


# goes round det W = 0 and through det S = 0 [leg speeds u, Fourier h = 2]
THROUGH_DET_S = np.array(
    [[-2.78, -0.2, 2.85, 4.15, 0.36], [2.71, 5.91, -0.69, -0.97, 0.33], [-9.83, 2.38, 2.24, 8.0, -5.49]]
)


def test_a_goal_across_det_s_alone_is_reached_in_the_original_form():
    """(7) cannot pass det S = 0; (3) needs det W ≠ 0 only. The goal is the end of a path that does."""
    problem = paper_problem("paper_conjecture", form="original", initial=THROUGH_DET_S)
    numeric, space = numeric_system(problem.system), problem.system.state_space
    flow = RungeKutta4(400).flow(Dynamics(numeric.rate_function), problem.basis, 1.0)
    goal = space.unpack(space.nearest(flow.end(problem.start_point, THROUGH_DET_S)))
    refused = planning.solve(paper_problem("paper_conjecture", goal=goal), Continuation())
    assert refused.outcome is Outcome.OTHER_COMPONENT
    assert "det S is" in refused.message
    assert "`form: original`" in refused.message
    start = THROUGH_DET_S + np.random.default_rng(2).normal(0, 0.6, (3, 5))
    found = planning.solve(replace(problem, goal=goal, initial=start), Auto())
    assert found.converged, found.message
    determinants = found.trajectory["det_s"]
    assert determinants[0] * determinants[-1] < 0
    assert (found.trajectory["det_w"] * found.trajectory["det_w"][0] > 0).all()
