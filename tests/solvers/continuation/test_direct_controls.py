"""Controls to a pose, many tried side by side: as they come, and the cheapest first."""

import goals
import numpy as np
import pytest

from nhpocp.controls.control import Control
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import resolving
from nhpocp.interruption import Interruption
from nhpocp.solvers.continuation import route_manoeuvres
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.direct_controls import arriving, cheapest_first
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.solvers.continuation.lockstep_search import Lockstep
from nhpocp.solvers.continuation.route_manoeuvres import FRUGAL, GENTLE, RouteManoeuvres
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.route.find_route import find_route

SOLVER = Continuation(step_rule=Adaptive(), integrator=RungeKutta4(40))
EVALUATIONS = 20


@pytest.fixture(scope="module")
def problem():
    task = goals.random_robot_task(13)
    return task.towards(goals.near_goal(task, 0))


@pytest.fixture(scope="module")
def starts(problem):
    random = np.random.default_rng(0)
    return [drawn(problem, random, width) for width in (0.3, 0.7, 1.2) * 4]


def all_that_arrive(problem, starts):
    with Interruption() as interruption:
        return list(arriving(SOLVER, problem, starts, EVALUATIONS, interruption))


def test_every_control_leads_to_the_goal_and_none_is_left_out(problem, starts):
    batches = all_that_arrive(problem, starts)
    steps = resolving(SOLVER.integrator, problem.basis)  # whether finer ones agree, who takes one finds out
    flow = flow_through(problem.system, problem.basis, problem.horizon.fixed, steps, ())
    controls = cheapest_first(batches)
    assert len(batches) <= EVALUATIONS
    assert len(controls) == sum(map(len, batches)) > 2
    assert [c.effort for c in controls] == sorted(c.effort for batch in batches for c in batch)
    for control in controls:
        assert problem.goal_error(flow.end(problem.start_point, control.coefficients)) <= SOLVER.tolerance


def test_who_takes_the_first_pays_for_no_later_ones(problem, starts, monkeypatch):
    rounds, evaluated = [], Lockstep._evaluated
    monkeypatch.setattr(Lockstep, "_evaluated", lambda *given: rounds.append(1) or evaluated(*given))
    arrivals = [len(batch) for batch in all_that_arrive(problem, starts)]
    whole, first = len(rounds), next(place for place, count in enumerate(arrivals) if count)
    rounds.clear()
    with Interruption() as interruption:
        next(filter(None, arriving(SOLVER, problem, starts, EVALUATIONS, interruption)))
    assert len(rounds) == first + 1 < whole


@pytest.mark.parametrize(("choice", "batches"), [(FRUGAL, 2), (GENTLE, 3)])
def test_of_what_is_drawn_a_frugal_walk_takes_the_first_and_a_gentle_one_compares_all(
    problem, monkeypatch, choice, batches
):
    found, seen = find_route(problem, 60.0, 0), []
    walk = RouteManoeuvres(problem, SOLVER, found.route, found.checks, 0, choice)
    control = Control(problem.basis, drawn(problem, np.random.default_rng(0), 0.1))

    def come(solver, part, starts, evaluations, interruption):
        if evaluations == route_manoeuvres.MANY:
            for batch in ([], [control], [control]):
                seen.append(batch)
                yield batch

    monkeypatch.setattr(route_manoeuvres, "arriving", come)
    monkeypatch.setattr(walk, "_best", lambda controls: bool(controls))
    with Interruption() as interruption:
        assert walk._manoeuvre(0.5 * found.route.length, interruption)
    assert len(seen) == batches


def test_a_walk_whose_last_manoeuvre_fails_has_not_arrived(problem, monkeypatch):
    found = find_route(problem, 60.0, 0)
    walk = RouteManoeuvres(problem, SOLVER, found.route, found.checks, 0)
    monkeypatch.setattr(walk, "_last", np.zeros((3, problem.basis.size)))  # its route ends beside the goal
    monkeypatch.setattr(walk, "walked", walk.route.length)
    monkeypatch.setattr(walk, "_best", lambda controls: False)
    for _ in range(2):
        assert list(walk.walk()) == []
        assert not walk.arrived
    monkeypatch.setattr(walk, "_best", lambda controls: True)
    assert list(walk.walk()) == []
    assert walk.arrived
