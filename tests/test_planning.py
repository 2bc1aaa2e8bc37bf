"""What `solve` refuses before a solver starts, and what it makes of a solver's claim."""

import numpy as np
import pytest
from conftest import paper_problem, yaw

from nhpocp import planning
from nhpocp.constraints import Bound
from nhpocp.solution import Outcome
from nhpocp.solvers.continuation import Continuation
from nhpocp.solvers.multiple_shooting import MultipleShooting
from nhpocp.solvers.step_rules import Euler

SOLVERS = [Continuation(step_rule=Euler(1.0)), MultipleShooting()]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_a_goal_out_of_the_legs_reach_is_infeasible_at_once(solver):
    far = {"position": [0, 0, 500], "orientation": yaw(-np.pi / 2)}
    bounds = [Bound("leg_length", "leg_lengths", 20.0, 60.0)]
    solution = planning.solve(paper_problem(goal=far, bounds=bounds), solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.INFEASIBLE, 0)
    assert "goal itself breaks leg_length[" in solution.message
    assert "which is 501.1, outside [20, 60]" in solution.message


def test_bounds_on_speeds_are_no_matter_of_the_ends():
    bounds = [Bound("leg_speed", "u", -1e-3, 1e-3), Bound("control", "v", -1e-3, 1e-3)]
    solution = planning.solve(paper_problem(bounds=bounds), SOLVERS[0])
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize("form", ["feedback", "original"])
def test_other_component_for_every_solver_and_form(solver, form):
    below = {"position": [0.3, 0.2, -35], "orientation": yaw(-np.pi / 6)}
    solution = planning.solve(paper_problem(goal=below, form=form), solver)
    assert (solution.outcome, solution.evaluations) == (Outcome.OTHER_COMPONENT, 0)
    assert "det W is" in solution.message
    assert not solution.converged


def test_the_problems_own_solver_is_the_default():
    problem = paper_problem(solvers={"jacobian": Continuation(step_rule=Euler(0.5))})
    assert planning.solve(problem).evaluations == 12
    assert planning.solve(paper_problem()).evaluations == 70
