"""An NLP that gets stuck goes on from other guesses, says so, and never calls a problem infeasible on IPOPT's word."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.guesses import SolverGuess
from nhpocp.solvers.nlp.ipopt import ENDINGS, Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.heisenberg import Heisenberg
from tests.conftest import paper_problem, yaw
from tests.solvers.nlp.pretending import Pretending

FAR = {"position": [0, 0, 27], "orientation": yaw(np.radians(190))}
START = {"position": [0, 0, 25], "orientation": yaw(np.radians(-100))}


def nlp(**settings):
    return MultipleShooting(**{"intervals": 10, "kernels": Interpreted(), **settings})


STUCK = Pretending(Outcome.INFEASIBLE, "Restoration_Failed")  # never gets away from where it starts


def test_a_guess_that_reaches_a_far_goal_is_better_than_nothing():
    solution = planning.solve(paper_problem(start=START, goal=FAR), nlp(optimizer=STUCK))
    assert solution.converged, solution.message
    attempts = solution.details["attempts"]
    assert [attempt["guess"] for attempt in attempts] == [
        "problem",
        "straight",
        "jacobian",
        "jacobian, at less cost",
        "where the NLP ended, corrected, at less cost",
    ]
    assert solution.costs["effort"] < 0.6 * solution.details["handed_back"]["plan"]
    assert solution.evaluations == sum(attempt["evaluations"] for attempt in attempts)
    assert solution.timing["solve_s"] == pytest.approx(sum(attempt["solve_s"] for attempt in attempts))
    assert "optimality is not certified; the Jacobian method's plan is handed back" in solution.warnings[-1]


def test_legs_that_are_too_slow_are_named_and_nothing_is_called_infeasible():
    """Continuity and goal are no constraints that anybody could loosen."""
    limit = 17.7  # 17.63 is needed on the straight way, and more on any other
    problem = paper_problem(bounds=[Bound("leg_speed", "u", -limit, limit)])
    solution = planning.solve(problem, nlp(intervals=6, steps_per_interval=1))
    assert solution.outcome in (Outcome.STAGNATED, Outcome.ITERATION_LIMIT)
    assert "or loosen leg_speed" in solution.message
    assert "loosen continuity" not in solution.message
    assert "Guesses that were tried: problem: " in solution.message
    assert {attempt["guess"] for attempt in solution.details["attempts"]} == {
        "problem",
        "straight",
        "jacobian",
    }


def test_a_bound_that_leaves_no_way_is_named_before_more_iterations():
    """With x held at 0 heisenberg's z never changes."""
    problem = PlanningProblem(
        system=Heisenberg(),
        start={"x": 0.0, "y": 0.0, "z": 0.0},
        goal={"x": 0.0, "y": 0.0, "z": 1.0},
        initial=[[0, 0, 1, 0, 0], [0, 1, 0, 0, 0]],
        bounds=[Bound("state.x", "x", 0.0, 0.0)],
    )
    solution = planning.solve(problem, nlp(intervals=6, optimizer=Ipopt(max_iterations=40)))
    assert solution.outcome is Outcome.ITERATION_LIMIT
    assert "or loosen state.x; or raise max_iterations" in solution.message


def test_the_budget_is_kept_over_all_guesses():
    problem = paper_problem(bounds=[Bound("leg_speed", "u", -18.0, 18.0)])
    solution = planning.solve(
        problem, nlp(intervals=6, steps_per_interval=1, optimizer=Ipopt(max_iterations=20))
    )
    assert solution.outcome is Outcome.ITERATION_LIMIT
    assert len(solution.iterations) <= 20 + 3  # each of three tries begins with its guess
    assert "max_iterations was reached" in solution.message
    assert solution.settings["max_iterations"] == 20


def test_a_guess_need_not_keep_the_bounds_nor_reach_the_goal():
    free = nlp(steps_per_interval=1).solve(paper_problem())
    limit = 0.95 * np.abs(free.trajectory["v"]).max()
    problem = paper_problem(bounds=[Bound("control", "v", -limit, limit)])
    for continuation in (Continuation(step_rule=Adaptive()), Continuation(max_iterations=1)):
        solution = planning.solve(problem, nlp(guess=SolverGuess(continuation)))
        assert solution.converged, solution.message
        assert "attempts" not in solution.details
        assert solution.evaluations > len(solution.iterations)
    assert "the guess is where the jacobian solver ended as iteration_limit" in solution.warnings[0]


def test_a_bound_that_touches_the_goal_is_no_obstacle():
    """Its interior is empty at the goal; IPOPT crept along it, and ended far dearer or nowhere."""
    problem = paper_problem()
    free = nlp(steps_per_interval=4).solve(problem)
    lengths = free.trajectory["leg_lengths"]
    touching = [Bound("leg_length", "leg_lengths", lengths.min(0), lengths.max(0))]
    solution = planning.solve(replace(problem, bounds=touching), nlp(steps_per_interval=4))
    assert solution.converged
    assert solution.details["objective_value"] == pytest.approx(free.details["objective_value"], rel=1e-4)
    assert len(solution.iterations) < 2 * len(free.iterations)


def test_no_word_of_the_optimizers_is_passed_on_as_infeasible():
    words = [word for word, outcome in ENDINGS.items() if outcome is Outcome.INFEASIBLE]
    assert {"Restoration_Failed", "Infeasible_Problem_Detected"} <= set(
        words
    )  # its claim, which is a local one


def test_bounds_are_tightened_where_they_are_broken_only():
    bound = Bound("state.position", "position", [-1.0, -1.0, 0.0], [1.0, 1.0, 40.0])
    values = np.array([[1.2, 0.0, 10.0], [0.0, -1.1, 10.0]])
    below, above = bound.passed(values, 1e-3)
    np.testing.assert_allclose(below, [0, 0.1, 0])
    np.testing.assert_allclose(above, [0.2, 0, 0])
    moved = bound.tightened(below, above)
    np.testing.assert_allclose(moved.lower, [-1, -0.9, 0])
    np.testing.assert_allclose(moved.upper, [0.8, 1, 40])
    assert bound.tightened(np.array([3.0, 0, 0]), above) is None
