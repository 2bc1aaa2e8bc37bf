"""Many goals at once: the same plans as one by one, in order, here or in other processes."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from goals import reachable_goals

import nhpocp
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from tests.conftest import paper_problem


@pytest.fixture(scope="module")
def task():
    problem = paper_problem()
    return problem, reachable_goals(problem, 5)


def test_plans_are_those_of_single_solves_and_verify(task):
    problem, goals = task
    solver = Continuation(step_rule=Adaptive())
    plans = list(nhpocp.plan_many(problem, goals, solver))
    for goal, plan in zip(goals, plans, strict=True):
        single = nhpocp.solve(replace(problem, goal=goal), solver)
        assert plan.outcome is single.outcome is Outcome.CONVERGED
        assert single.converged
        assert plan.evaluations == single.evaluations
        assert plan.message == single.message
        np.testing.assert_allclose(plan.control.coefficients, single.control.coefficients, atol=1e-9)


def test_processes_give_the_same_in_the_same_order(task):
    problem, goals = task
    here = list(nhpocp.plan_many(problem, goals))
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        elsewhere = list(nhpocp.plan_many(problem, goals, executor=pool, together=2))
    for one, other in zip(here, elsewhere, strict=True):
        assert one.outcome is other.outcome
        np.testing.assert_allclose(one.control.coefficients, other.control.coefficients, atol=1e-9)


@pytest.mark.parametrize("together", [1, 3])
def test_goals_are_planned_as_they_are_asked_for(task, together):
    problem, goals = task
    asked = []

    def endless():
        while True:
            asked.append(1)
            yield goals[0]

    plans = nhpocp.plan_many(problem, endless(), Continuation(step_rule=Adaptive()), together=together)
    assert next(plans).outcome is Outcome.CONVERGED
    assert len(asked) == together


def test_a_goal_across_a_singular_surface_is_refused_among_the_others(task):
    problem, goals = task
    turned = {**goals[0], "orientation": np.diag([1.0, -1.0, -1.0])}
    plans = list(nhpocp.plan_many(problem, [goals[0], turned], Continuation(step_rule=Adaptive())))
    assert [plan.outcome for plan in plans] == [Outcome.CONVERGED, Outcome.OTHER_COMPONENT]


def test_no_goal_at_all_is_an_error_that_says_so(task):
    problem, goals = task
    plans = nhpocp.plan_many(problem, [goals[0], {"place": [0, 0, 1]}, goals[1]])
    assert next(plans).outcome is Outcome.CONVERGED
    with pytest.raises(nhpocp.InvalidProblemError, match="goal"):
        next(plans)


@pytest.mark.parametrize("where", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_plans_before_a_bad_goal_are_given_wherever_they_are_made(task, where):
    problem, goals = task
    solver = Continuation(step_rule=Adaptive())
    series = [*goals[:5], {"place": [0, 0, 1]}, goals[0]]
    context = {"mp_context": multiprocessing.get_context("spawn")} if where is ProcessPoolExecutor else {}
    with where(1, **context) if where else nullcontext() as executor:
        plans = nhpocp.plan_many(problem, series, solver, executor=executor)
        for _ in range(5):
            assert next(plans).outcome is Outcome.CONVERGED
        with pytest.raises(nhpocp.InvalidProblemError, match="goal") as caught:
            next(plans)
    assert "place" in str(caught.value)


def test_none_together_is_refused(task):
    problem, goals = task
    with pytest.raises(nhpocp.InvalidProblemError, match="together is 0"):
        next(nhpocp.plan_many(problem, goals, together=0))


def test_an_interrupted_series_ends_as_interrupted(task, monkeypatch):
    problem, goals = task
    plans = nhpocp.plan_many(problem, goals, Continuation(step_rule=Adaptive()), together=1)
    assert next(plans).outcome is Outcome.CONVERGED
    monkeypatch.setattr(
        "nhpocp.interruption.Interruption.check",
        lambda self: (_ for _ in ()).throw(KeyboardInterrupt),
    )
    with pytest.raises(KeyboardInterrupt):
        next(plans)
