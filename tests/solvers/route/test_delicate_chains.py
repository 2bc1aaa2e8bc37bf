"""Manoeuvres that multiply errors: how they are chosen, given up, and joined."""

from dataclasses import replace
from types import SimpleNamespace

import goals
import numpy as np
import pytest

from nhpocp.controls.control import Control
from nhpocp.controls.sequence import join, retimed
from nhpocp.flow import step_error
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation import delicate_chain
from nhpocp.solvers.continuation.along_routes import ATTEMPTS, AlongRoutes
from nhpocp.solvers.continuation.confirmation import begun_from, confirmed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.delicate_chain import joined_by_steps
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.solvers.continuation.pieces import pieces_of
from nhpocp.solvers.continuation.route_manoeuvres import DELICATE, FRUGAL, RouteManoeuvres
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.route.find_route import find_route

SOLVER = Continuation(step_rule=Adaptive(), objective="none")
SIZE, WIDER = 0.2, 3.0  # of what is drawn


@pytest.fixture(scope="module")
def problem():
    """Towards a pose beside the start."""
    task = goals.random_robot_task(13)
    return task.towards(goals.near_goal(task, 0))


@pytest.fixture(scope="module")
def manoeuvres(problem):
    found = find_route(problem, 60.0, 0)
    return RouteManoeuvres(problem, SOLVER, found.route, found.checks, 0)


@pytest.fixture(scope="module")
def chain(problem):
    """Three manoeuvres from the start."""
    random = np.random.default_rng(0)
    return [Control(problem.basis, drawn(problem, random, SIZE)) for _ in range(3)]


@pytest.fixture(scope="module")
def to_its_end(problem, chain):
    return towards_the_end_of(problem, join(chain), 1000)


def towards_the_end_of(problem, control, steps):
    flow = flow_through(problem.system, control.basis, control.horizon, RungeKutta4(steps), ())
    end = problem.system.state_space.nearest(flow.end(problem.start_point, control.coefficients))
    return problem.towards(problem.system.state_space.unpack(end))


def solved(solver, problem):
    return solver.find(problem)


def test_what_the_whole_chain_multiplies_counts_not_what_the_last_does(manoeuvres, monkeypatch):
    monkeypatch.setattr(manoeuvres, "_along", [np.diag([100.0, 1, 1, 1, 1, 1])])
    shrinks, grows = np.diag([0.1, 4, 1, 1, 1, 1]), np.diag([2.0, 1, 1, 1, 1, 1])
    assert np.linalg.norm(shrinks, 2) > np.linalg.norm(grows, 2)
    assert manoeuvres._grown(shrinks) == pytest.approx(10.0)
    assert manoeuvres._grown(grows) == pytest.approx(200.0)


def test_what_the_chain_multiplies_is_known_whatever_is_chosen_by(problem, manoeuvres):
    frugal = RouteManoeuvres(problem, SOLVER, manoeuvres.route, manoeuvres.checks, 0, FRUGAL)
    for _ in frugal.walk():
        pass
    whole = np.eye(len(problem.scales.states))
    here = problem.start_point
    for control in frugal.controls:
        flow = flow_through(problem.system, control.basis, 1.0, RungeKutta4(160), ())
        whole = delicate_chain.end_by_start(problem, flow, here, control) @ whole
        here = flow.end(here, control.coefficients)
    assert frugal.growth >= 0.9 * np.linalg.norm(whole, 2)


def test_delicate_manoeuvres_are_not_walked_on(manoeuvres, monkeypatch):
    monkeypatch.setattr(manoeuvres, "growth", 2 * DELICATE)
    assert list(manoeuvres.walk()) == []
    assert not manoeuvres.controls


class Walked:
    """Manoeuvres that take more than there is patience for, and arrive in the end or do not."""

    controls, growth, steps, here = [None] * 30, 1.0, 640, None
    arrived = delicate = False

    def __init__(self, part, arrives):
        self.part, self._arrives = part, arrives
        self.whole = SimpleNamespace(waypoints=np.full((2, 1), part))

    def walk(self, patience):
        self.arrived = self._arrives and patience == np.inf
        yield self.part


class Search:
    """What `AlongRoutes` tells."""

    base = SOLVER

    def __init__(self, problem):
        self.problem, self.notes = replace(problem), []

    def telling(self, way):
        pass

    def note(self, way, outcome, error):
        self.notes.append(way)


def test_every_slow_route_is_followed_to_its_end_the_farthest_first(problem, monkeypatch):
    search = Search(problem)
    monkeypatch.setattr(type(problem), "goal_error", lambda *_: 1.0)
    walked = [Walked(0.9, False), Walked(0.5, True), *(Walked(0.1, False) for _ in range(ATTEMPTS - 2))]
    along = AlongRoutes(search, 1.0, required=False)
    monkeypatch.setattr(along, "_manoeuvres", lambda seed, _: walked[seed - SOLVER.seed])
    (way,) = along.ways()
    assert way.controls is walked[1].controls
    assert way.sketch == {"route": [[0.5], [0.5]]}  # not of the last that was found
    assert "90%" in search.notes[0]


def test_a_chain_is_corrected_by_its_last_manoeuvre_alone(to_its_end, chain, monkeypatch):
    monkeypatch.setattr(delicate_chain, "MOST", 600)
    spoilt = [*chain[:-1], replace(chain[-1], coefficients=1.01 * chain[-1].coefficients)]
    result = joined_by_steps(to_its_end, spoilt, SOLVER, solved)
    assert result.outcome is Outcome.CONVERGED
    for piece, control in zip(pieces_of(result.control)[:-1], chain[:-1], strict=True):
        kept = retimed(piece, 1.0).coefficients
        np.testing.assert_allclose(kept, control.coefficients, rtol=1e-12)


def test_what_needs_more_steps_gets_more_time(to_its_end, chain):
    wild = replace(chain[1], coefficients=WIDER * chain[1].coefficients)
    calm, wilder, _ = delicate_chain._steps_needed(to_its_end, [chain[0], wild, chain[2]])
    assert wilder > calm > 0


def test_what_no_steps_lead_through_is_said_to_be_so(to_its_end, chain):
    lost = replace(chain[1], coefficients=300.0 * chain[1].coefficients)
    controls = [chain[0], lost, chain[2]]
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(delicate_chain._steps_needed(to_its_end, controls), 1.0)
        assert joined_by_steps(to_its_end, controls, SOLVER, solved).outcome is not Outcome.CONVERGED


@pytest.mark.parametrize(
    ("tolerance", "outcome"),
    [(1e-2, Outcome.CONVERGED), (1e-7, Outcome.NOT_VERIFIED)],
    ids=["fine", "coarse"],
)
def test_a_claim_that_no_more_steps_could_refute_is_held_against_fewer(
    problem, chain, monkeypatch, tolerance, outcome
):
    control, steps = replace(chain[0], coefficients=WIDER * chain[0].coefficients), 40
    coarse = begun_from(towards_the_end_of(problem, control, steps), control)
    solver = replace(SOLVER, integrator=RungeKutta4(steps=steps), tolerance=tolerance)
    monkeypatch.setattr(step_error, "MOST", steps)
    result = confirmed(solver, coarse)
    assert result.outcome is outcome
    assert (f"{steps} steps may be wrong by" in result.message) is (outcome is Outcome.NOT_VERIFIED)
