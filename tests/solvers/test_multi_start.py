"""`starts`: the first of several starts that reaches the goal, the same on any executor."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.outcome import Outcome
from nhpocp.problem_file import parse_problem
from nhpocp.solvers.continuation import multi_start
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.multi_start import MultiStart, processes
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from tests.conftest import paper_problem

pytestmark = pytest.mark.usefixtures("slow_robots")


def one_thread():
    return ThreadPoolExecutor(1)


@pytest.mark.parametrize("executor", [one_thread, processes])
def test_the_first_that_reaches_the_goal_in_their_order(executor):
    """Λ0 = 0 has no rank; start 2 is the seeded one that `initial: auto` with seed 1 draws."""
    problem = paper_problem(initial=np.zeros((3, 5)))
    rule = Continuation(step_rule=Adaptive())
    solution = planning.solve(problem, MultiStart(rule, 4, executor))
    assert solution.converged
    tried = solution.details["tried"]
    assert [entry["outcome"] for entry in tried] == ["rank_deficient", "converged"]
    assert "start 2 of 4" in solution.message
    alone = planning.solve(paper_problem(initial=None), Continuation(step_rule=Adaptive(), seed=1))
    np.testing.assert_array_equal(solution.control.coefficients, alone.control.coefficients)


def test_a_good_start_needs_no_other(problem):
    def none():
        raise AssertionError("no executor is needed")

    solution = planning.solve(problem, MultiStart(Continuation(step_rule=Adaptive()), 8, none))
    assert solution.converged
    assert len(solution.details["tried"]) == 1


def test_if_none_reaches_the_goal_the_nearest_is_kept(problem):
    solver = MultiStart(Continuation(step_rule=Adaptive(), max_iterations=1), 3, one_thread)
    solution = planning.solve(problem, solver)
    assert solution.outcome is Outcome.ITERATION_LIMIT
    errors = [entry["error"] for entry in solution.details["tried"]]
    assert len(errors) == 3
    assert solution.final_error == min(errors)
    assert sum(entry["evaluations"] for entry in solution.details["tried"]) == solution.evaluations


def test_starts_in_a_file():
    text = """
nhpocp: 1
system: {model: three_upu}
start: {position: [0, 0, 25], orientation: {rpy: [0, 0, -pi/6]}}
goal: {position: [-0.4, -0.2, 35], orientation: {rpy: [0, 0, -pi/2]}}
solvers: {jacobian: {starts: 3, step_rule: adaptive}}
"""
    solver = parse_problem(text).solvers["jacobian"]
    assert isinstance(solver, MultiStart)
    assert solver.settings()["starts"] == 3


def test_the_times_are_those_of_all_starts(monkeypatch):
    """Whatever the winner took alone: the clock of the whole, building included."""
    clock = iter([100.0, 107.5])
    monkeypatch.setattr(multi_start, "perf_counter", lambda: next(clock))
    problem = paper_problem(initial=np.zeros((3, 5)))
    solution = MultiStart(Continuation(step_rule=Adaptive()), 3, one_thread).solve(problem)
    assert len(solution.details["tried"]) == 2
    assert solution.timing["build_s"] + solution.timing["solve_s"] == pytest.approx(7.5)


@dataclass(frozen=True)
class Watched(Ipopt):
    """IPOPT, with a note of what each of its solves took."""

    seen: list[tuple[int, float]] = field(default_factory=list)

    def solve(self, *arguments):
        began = perf_counter()
        optimum = super().solve(*arguments)
        self.seen.append((optimum.evaluations, perf_counter() - began))
        return optimum


def test_the_starts_of_the_nlp_are_counted_together(problem):
    solver = MultipleShooting(intervals=6, starts=3, optimizer=Watched())
    solution = solver.solve(problem)
    evaluations, seconds = np.sum(solver.optimizer.seen, axis=0)
    assert len(solver.optimizer.seen) >= 3
    assert solution.evaluations == evaluations
    assert solution.timing["solve_s"] >= seconds
