"""Goals planned side by side: the plans of the solver itself, and what is left to it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nhpocp.constraints.bound import Bound
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.lockstep import reached_together
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.continuation.trust_region import next_radius, within_radius
from nhpocp.solvers.metrics import L2Metric
from tests.conftest import LIBRARY, library_problem, paper_problem

# one goal at a time, or none: an abnormal extremal, an impossible task, an arm's tip, a truck at rest
ALONE = {"cartan_line", "equal_spheres", "mobile_manipulator", "truck_docking"}
ADAPTIVE = Continuation(step_rule=Adaptive(), max_iterations=40)


class Lazy(Adaptive):
    """A rule of somebody's own."""

    def updates(self, here, evaluate):
        return iter(())


class Own(Continuation):
    """A solver of somebody's own."""


def bare(name):
    """A problem of the library without its bounds and via poses, with a control to begin with."""
    problem = library_problem(name)
    shape = problem.system.input_space.size, problem.basis.size
    initial = problem.initial
    if initial is None:
        initial = np.random.default_rng(3).normal(0.0, 0.5, shape) * problem.scale**0.5
    return replace(problem, bounds=(), via=(), initial=initial, objective="effort")


def perturbed_goals(problem, count):
    """End points of the start's control plus noise, one of them far away."""
    random, space, found = np.random.default_rng(1), problem.system.state_space, []
    walk = flow_through(problem.system, problem.basis, problem.horizon.fixed, RungeKutta4(50), ())
    for k in range(count):
        noise = random.normal(0.0, 0.3 if k else 4.0, np.shape(problem.initial))
        end = walk.end(problem.start_point, problem.initial + noise)
        values = space.unpack(space.nearest(end)) if np.isfinite(end).all() else problem.goal
        found.append({name: values.get(name, problem.goal.get(name)) for name in problem.goal})
    return found


@pytest.mark.parametrize("name", LIBRARY)
def test_the_plans_are_the_solvers_own(name):
    problem = bare(name)
    problems = [problem.towards(goal) for goal in perturbed_goals(problem, 6)]
    together = reached_together(ADAPTIVE, problems)
    reached = 0
    for one, plan in zip(problems, together, strict=True):
        if plan is None:
            continue
        alone = ADAPTIVE.find(one)
        reached += 1
        assert alone.outcome is Outcome.CONVERGED
        assert (plan.updates, plan.evaluations) == (alone.records[-1]["k"], len(alone.records))
        assert plan.message == alone.message
        size = np.abs(alone.control.coefficients).max()
        np.testing.assert_allclose(plan.coefficients, alone.control.coefficients, atol=1e-8 * size)
    assert reached >= (0 if name in ALONE else 3)


def test_every_metric_and_a_goal_in_some_coordinates():
    problem = paper_problem(goal={"position": [-0.4, -0.2, 35]})
    solver = replace(ADAPTIVE, metric=L2Metric())
    (plan,) = reached_together(solver, [problem])
    alone = solver.find(problem)
    assert plan.evaluations == len(alone.records)
    np.testing.assert_allclose(plan.coefficients, alone.control.coefficients, atol=1e-10)


def test_auto_keeps_what_finer_steps_confirm(monkeypatch):
    problem = paper_problem()
    assert reached_together(Auto(), [problem])[0] is not None
    monkeypatch.setattr("nhpocp.solvers.continuation.confirmation.finer", lambda integrator: RungeKutta4(3))
    assert reached_together(Auto(), [problem]) == [None]
    assert reached_together(ADAPTIVE, [problem])[0] is not None  # claims, as the solver itself does


@pytest.mark.parametrize(
    ("solver", "changes"),
    [
        (Continuation(step_rule=Euler(1.0)), {}),
        (replace(ADAPTIVE, objective="effort"), {}),
        (ADAPTIVE, {"initial": None}),
        (ADAPTIVE, {"initial": np.zeros((3, 5))}),  # rank 3
        (ADAPTIVE, {"bounds": [Bound("leg_length", "leg_lengths", 0.0, 100.0)]}),
        (replace(ADAPTIVE, max_iterations=1), {}),
        (ADAPTIVE, {"goal": {"leg_lengths": [33.0, 34.0, 35.0]}}),
        (replace(ADAPTIVE, step_rule=Lazy()), {}),
        (Own(step_rule=Adaptive()), {}),
    ],
    ids=["euler", "objective", "no start", "no rank", "bounds", "limit", "outputs", "own rule", "own solver"],
)
def test_the_unusual_is_left_to_the_solver(solver, changes):
    assert reached_together(solver, [paper_problem(**changes)]) == [None]


def test_goals_beyond_a_singular_surface_do_not_hold_up_the_others():
    problem = paper_problem()
    beyond = problem.towards({**problem.goal, "orientation": np.diag([1.0, -1.0, -1.0])})
    found = reached_together(ADAPTIVE, [problem, beyond, problem])
    assert [plan is None for plan in found] == [False, True, False]
    np.testing.assert_array_equal(found[0].coefficients, found[2].coefficients)


def test_goals_in_different_coordinates_are_each_planned_to():
    problem = paper_problem()
    position = problem.towards({"position": problem.goal["position"]})
    lengths = problem.towards({"leg_lengths": [33.0, 34.0, 35.0]})
    found = reached_together(ADAPTIVE, [lengths, problem, position, problem])
    assert [plan is None for plan in found] == [True, False, False, False]
    assert found[1].evaluations != found[2].evaluations or not np.allclose(
        found[1].coefficients, found[2].coefficients
    )


def test_a_failure_of_the_linear_algebra_is_left_to_the_solver(monkeypatch):
    def fails(*arguments, **options):
        raise np.linalg.LinAlgError("SVD did not converge")

    problem = paper_problem()
    monkeypatch.setattr(np.linalg, "svd", fails)
    assert reached_together(ADAPTIVE, [problem, problem]) == [None, None]


def test_ctrl_c_ends_a_search(monkeypatch):
    def stopped(self):
        raise KeyboardInterrupt

    monkeypatch.setattr("nhpocp.interruption.Interruption.check", stopped)
    with pytest.raises(KeyboardInterrupt):
        reached_together(ADAPTIVE, [paper_problem()])


def test_no_problems_make_no_plans():
    assert reached_together(ADAPTIVE, []) == []


numbers = st.floats(0.01, 10.0)


@given(
    arrays(float, (4, 6), elements=numbers),
    arrays(float, (4, 6), elements=st.floats(-5.0, 5.0)),
    arrays(float, 4, elements=numbers),
)
def test_the_trust_region_of_many_is_that_of_each(values, error, radius):
    together = within_radius(values, error, radius)
    for k in range(4):
        np.testing.assert_allclose(together[k], within_radius(values[k], error[k], radius[k]), rtol=1e-12)
    lengths, full = np.linalg.norm(together, axis=1), np.linalg.norm(error / values, axis=1)
    assert (lengths <= np.minimum(radius * 1.0011, full * (1 + 1e-12))).all()
    assert (lengths >= np.minimum(radius, full) * (1 - 1e-3)).all()


@pytest.mark.parametrize(
    ("kept", "expected"), [(-np.inf, 0.25), (-1.0, 0.25), (0.1, 0.5), (0.5, 2.0), (0.9, 2.5), (0.25, 2.0)]
)
def test_the_radius_follows_the_share_of_the_promise_that_was_kept(kept, expected):
    assert next_radius(2.0, 1.0, kept) == expected
    np.testing.assert_array_equal(next_radius(np.full(3, 2.0), np.ones(3), np.full(3, kept)), expected)
