"""What ends a continuation, and the budget that it shares with the search for least cost."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp.outcome import Outcome
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation import auto
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.singularity_crossings import keeps_sign
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler, Ode, StepRule, full_step
from nhpocp.solvers.continuation.stop_criteria import below_tolerance, lost
from tests.conftest import PAPER_START, paper_problem


class Patient(StepRule):
    """Tries again what has failed, a number of times that no limit of evaluations knows of."""

    kind = "patient"

    def updates(self, here, evaluate):
        for _ in range(100):
            trial = evaluate(here.coefficients + 0.01 * full_step(here), 0.01)
            if trial.usable:
                here = trial
                yield here

    def settings(self):
        return {}


def test_a_budget_refuses_what_exceeds_it_until_it_is_extended():
    budget = Budget(2)
    assert [budget.take() for _ in range(3)] == [True, True, False]
    assert (budget.taken, budget.left, budget.refused) == (2, 0, True)
    budget.extend(1)
    assert not budget.refused
    assert budget.take()


@pytest.mark.parametrize(
    "rule", [Euler(0.01), Adaptive(1e-3), Ode(0.01), Patient()], ids=lambda rule: rule.kind
)
@pytest.mark.parametrize("most", [0, 1, 3])
def test_no_rule_evaluates_more_than_its_updates_may_take(rule, most):
    result = Continuation(step_rule=rule, max_iterations=most).find(paper_problem())
    assert result.outcome is Outcome.ITERATION_LIMIT
    assert len(result.records) == 1 + most * rule.evaluations
    accepted = [record for record in result.records if record["accepted"]]
    assert result.error == accepted[-1]["error"]
    assert result.updates == len(accepted) - 1


def test_the_search_for_least_cost_has_as_many_again_and_keeps_what_it_has():
    solver = Continuation(step_rule=Adaptive(), max_iterations=8, objective="effort")
    result = solver.find(paper_problem())
    first = Continuation(step_rule=Adaptive(), max_iterations=8).find(paper_problem())
    assert result.outcome is Outcome.CONVERGED
    assert result.message.endswith("not at a stationary point")
    assert result.control.effort < first.control.effort
    assert len(result.records) == 1 + 8 + 8 + 1


def test_auto_finishes_what_has_reached_the_goal_whatever_it_took(monkeypatch):
    monkeypatch.setattr(auto, "BUDGET", 1)
    solver = Auto(Continuation(step_rule=Adaptive(), objective="effort"))
    given = solver.solve(paper_problem())
    assert given.outcome is Outcome.CONVERGED
    assert given.control.effort < Auto().solve(paper_problem()).control.effort


def test_criteria_are_the_same_for_one_and_for_many():
    errors, first = np.array([1e-4, 1.0, 1e4]), np.array([1.0, 1.0, 1.0])
    assert list(below_tolerance(errors, 1e-3)) == [below_tolerance(e, 1e-3) for e in errors]
    assert list(lost(errors, first)) == [bool(lost(e, 1.0)) for e in errors] == [False, False, True]


@pytest.mark.parametrize(
    ("determinants", "kept"),
    [
        ([1.0, 2.0, 0.1], True),
        ([-1.0, -2.0], True),
        ([1.0, -1.0], False),
        ([1.0, 0.0], False),
        ([1.0, np.nan], False),
    ],
)
def test_a_sign_is_kept_along_the_whole_path(determinants, kept):
    along = np.array(determinants)
    assert bool(keeps_sign(along)) is kept
    np.testing.assert_array_equal(keeps_sign(np.stack([along, np.ones_like(along)])), [kept, True])


def test_a_loop_without_a_further_step_names_the_error_of_its_control():
    """Whatever the last trial led to, even to no end at all."""
    solver = Continuation(step_rule=Adaptive(), tolerance=1e-18)
    result = solver.find(replace(paper_problem(), initial=PAPER_START))
    assert result.outcome is Outcome.STAGNATED
    assert result.message.startswith(f"E = {result.error:.3g}")
