"""`step_rule: auto`: what it tries, in order, and what it says of it."""

import re
import signal
from dataclasses import replace

import goals
import numpy as np
import pytest

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.projection import project
from nhpocp.controls.sequence import retimed
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solution_folder import load_solution, save_solution
from nhpocp.solvers.continuation import auto, cheapest, confirmation, geodesic
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.confirmation import confirmed, missed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.views.records import own_records
from tests.conftest import PAPER_START, paper_problem, robot, yaw

CHEAP = Auto(Continuation(step_rule=Adaptive(), objective="effort"))


def task(name, **changes):
    """`goals.paper_task`, on the robots that all tests share."""
    shared = {"system": robot(name)} if name in ThreeUPU.presets else {}
    return goals.paper_task(name, **{**shared, **changes})


def workspace(seed, **changes):
    problem = task("default", **changes)
    return task("default", goal=goals.workspace_goal(problem, seed), **changes)


def test_the_direct_way_is_enough_for_the_paper(problem):
    solution = planning.solve(problem, Auto())
    assert solution.converged
    assert solution.evaluations <= 8
    assert [entry["way"] for entry in solution.details["tried"]] == ["the given start"]
    assert solution.settings["step_rule"] == "auto"


def test_a_start_without_rank_is_left_for_a_seeded_one():
    """Λ0 = 0 moves the end point in three directions only."""
    solution = planning.solve(paper_problem(initial=np.zeros((3, 5))), Auto())
    assert solution.converged
    tried = solution.details["tried"]
    assert tried[0]["outcome"] == "rank_deficient"
    assert tried[-1]["way"].startswith("seeded start")
    assert "after 1 other way" in solution.message
    assert {record["attempt"] for record in solution.iterations} == {0, 1}
    assert sum(entry["evaluations"] for entry in tried) == solution.evaluations == len(solution.iterations)


@pytest.mark.parametrize("name", goals.ROBOTS)
def test_goals_that_are_reachable_by_construction_are_reached(name):
    """`scripts/benchmark_goals.py` tries a hundred of them."""
    problem = task(name)
    for goal in goals.reachable_goals(problem, 3):
        solution = planning.solve(task(name, goal=goal), Auto())
        assert solution.converged, solution.message


def test_generated_goals_are_reproducible_and_clear():
    problem = task("normal75")
    first, again = (goals.reachable_goals(problem, 2) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one["position"], other["position"])
        np.testing.assert_allclose(one["orientation"] @ one["orientation"].T, np.eye(3), atol=1e-14)
    assert not np.allclose(first[0]["position"], first[1]["position"])


def test_a_far_goal_is_reached_by_manoeuvres_that_are_stored_as_one(tmp_path):
    """A workspace pose that no start of one basis leads to: two plans, one after the other."""
    solution = planning.solve(workspace(45), Auto())
    assert solution.converged, solution.message
    control = solution.control
    assert control.basis.kind == "sequence"
    assert len(control.basis.bases) == 2
    assert control.horizon == 1.0
    assert "2 manoeuvres in sequence" in solution.message
    back = load_solution(save_solution(solution, tmp_path / "sequence"))
    assert back.converged
    times = np.linspace(0, 1, 11)
    np.testing.assert_allclose(back.control(times), control(times), atol=1e-12)


def test_retimed_manoeuvres_go_the_same_way_and_cost_what_time_scaling_says(problem):
    control = problem.control(problem.initial)
    slow = retimed(control, 2.5)
    rate = numeric_system(problem.system).rate_function
    ends = [
        RungeKutta4(200).flow(Dynamics(rate), c.basis, c.horizon).end(problem.start_point, c.coefficients)
        for c in (control, slow)
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
    assert slow.effort == pytest.approx(control.effort / 2.5)


def test_a_claim_that_finer_steps_refute_is_corrected(problem):
    """Ten steps of RK4 are wrong by more than the tolerance; the confirmed control is not."""
    coarse = Continuation(step_rule=Adaptive(), integrator=RungeKutta4(10), tolerance=1e-6)
    assert coarse.find(problem).outcome is Outcome.CONVERGED
    assert not planning.solve(problem, coarse).converged
    found = confirmed(coarse, problem)
    assert found.outcome is Outcome.CONVERGED
    rate = numeric_system(problem.system).rate_function
    flow = RungeKutta4(1000).flow(Dynamics(rate), problem.basis, 1.0)
    assert problem.goal_error(flow.end(problem.start_point, found.control.coefficients)) < 2e-6


STEPS = (1, 2, 3, 5)  # of RK4 over the whole path: nearly every claim is refuted, some three times
OVER = (Fourier(2), Fourier(5), Fourier(10), Legendre(5), BSpline(3, 6))


@pytest.mark.parametrize("basis", OVER, ids=lambda basis: f"{basis.kind}-{basis.size}")
@pytest.mark.parametrize("steps", STEPS)
def test_the_last_word_on_a_claim_is_that_of_the_confirmation(basis, steps, monkeypatch):
    """A single correction often is enough here, and its claim is held against a finer simulation as well."""
    problem, said = paper_problem(), []
    start = project(problem.control(problem.initial), basis)
    problem = replace(problem, basis=basis, initial=start.coefficients)

    def noted(problem, control, integrator):
        said.append((control, missed(problem, control, integrator)))
        return said[-1][1]

    monkeypatch.setattr(confirmation, "CORRECTIONS", 1)
    monkeypatch.setattr(confirmation, "missed", noted)
    found = confirmed(Continuation(step_rule=Adaptive(), integrator=RungeKutta4(steps)), problem)
    held = any(control is found.control and error <= 1e-3 for control, error in said)
    refuted = any(control is found.control and error > 1e-3 for control, error in said)
    assert (found.outcome is Outcome.CONVERGED) == held, found.message
    assert (found.outcome is Outcome.NOT_VERIFIED) == refuted, found.message  # else it was no claim


def test_a_claim_that_is_refuted_to_the_last_says_by_how_much(problem, monkeypatch):
    monkeypatch.setattr(confirmation, "CORRECTIONS", 0)
    coarse = Continuation(step_rule=Adaptive(), integrator=RungeKutta4(10), tolerance=1e-6)
    found = confirmed(coarse, problem)
    assert found.outcome is Outcome.NOT_VERIFIED
    assert "a simulation with 40 steps misses by E = " in found.message


def test_what_is_not_reached_is_said_with_everything_tried(monkeypatch):
    """Two steps of γ = 0.001 reach nothing; no try may claim it."""
    for name, value in {"SEEDS": 2, "HALVINGS": 2}.items():
        monkeypatch.setattr(geodesic, name, value)
    lame = Auto(Continuation(step_rule=Euler(1e-3), max_iterations=2), restarts=1, route="never")
    solution = planning.solve(paper_problem(), lame)
    assert solution.outcome is Outcome.NOT_REACHED
    for way in (
        "the given start: iteration_limit",
        "seeded start 1: iteration_limit",
        "walking the goal",
        "stuck",
    ):
        assert way in solution.message
    assert solution.verdict.error > 1


def test_no_new_try_begins_when_the_budget_is_spent(monkeypatch):
    monkeypatch.setattr(auto, "BUDGET", 10)
    goal = {"position": [0, 0, 500], "orientation": yaw(-np.pi / 2)}
    solution = planning.solve(task("default", goal=goal), Auto())
    assert solution.outcome is Outcome.NOT_REACHED
    assert "Given up after" in solution.message
    assert solution.evaluations < 60
    assert "unreachable" not in solution.message


def test_least_effort_of_the_winner():
    plain, cheap = (
        planning.solve(workspace(4), Auto(Continuation(step_rule=Adaptive(), objective=name)))
        for name in ("none", "effort")
    )
    assert plain.converged
    assert cheap.converged
    assert cheap.control.effort < 0.7 * plain.control.effort
    assert isinstance(cheap.control, Control)
    assert isinstance(cheap.control.basis, Fourier)


def lifted(angle, **changes):
    """`default` from z = 25 to 30 without a turn."""
    start, goal = ({"position": [0, 0, z], "orientation": yaw(angle)} for z in (25, 30))
    return paper_problem(start=start, goal=goal, **changes)


@pytest.mark.parametrize("angle", [0.0, -np.pi / 6])
@pytest.mark.parametrize("initial", [None, PAPER_START], ids=["seeded", "given"])
def test_a_lift_is_planned_by_default(angle, initial):
    assert planning.solve(lifted(angle, initial=initial)).converged


@pytest.fixture(scope="module")
def turned_lift():
    """At the least effort; six starts agree soon."""
    return planning.solve(lifted(-np.pi / 6), CHEAP)


@pytest.fixture(scope="module")
def straight_lift():
    """At the least effort; of 32 starts, which share their seeds whatever the first is, the best are among 18."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cheapest, "STARTS", 18)
        return planning.solve(lifted(0.0, initial=None), CHEAP)


@pytest.mark.parametrize(("lift", "least"), [("straight_lift", 5.34329), ("turned_lift", 8.67753)])
def test_a_lift_is_planned_at_the_least_effort(lift, least, request):
    """One start leads to 20.9 and 8.68; 5.34 and 8.68 are the least that hundreds of starts found over this basis."""
    cheap = request.getfixturevalue(lift)
    assert cheap.converged
    assert cheap.control.effort == pytest.approx(least, rel=1e-4)
    assert "the least of" in cheap.message
    assert cheap.details["costs_of_starts"][0] == pytest.approx(cheap.control.effort, rel=1e-6)
    errors = [record["error"] for record in own_records(cheap)]
    assert errors[-1] == cheap.final_error  # pictures show the plan's own try


def test_a_plan_that_may_be_poor_says_so(monkeypatch, turned_lift):
    """Not at a stationary point, or much less than the next start's."""
    alone = planning.solve(lifted(0.0), replace(CHEAP.continuation, max_iterations=40))
    assert alone.converged
    assert any("where it still falls; try `step_rule: auto`" in warning for warning in alone.warnings)
    monkeypatch.setattr(cheapest, "STARTS", 9)
    compared = planning.solve(lifted(0.0), CHEAP)
    least, following = compared.details["costs_of_starts"][:2]
    assert following > 1.1 * least
    assert any("the next costs" in warning for warning in compared.warnings)
    assert turned_lift.warnings == []


def test_a_stop_while_starts_are_compared_keeps_the_least_so_far():
    def stop(record):
        if "for less" in (record.get("way") or ""):
            raise KeyboardInterrupt

    solution = planning.solve(lifted(-np.pi / 6), CHEAP, stop)
    assert solution.outcome is Outcome.INTERRUPTED
    assert solution.verdict.error < 1e-3
    assert "best so far: E = " in solution.message


def test_a_stop_before_anything_was_tried_keeps_the_start():
    def stop(record):
        if record.get("stage") == "looking for a route":
            signal.raise_signal(signal.SIGINT)

    solution = planning.solve(paper_problem(), Auto(route="always"), stop)
    assert solution.outcome is Outcome.INTERRUPTED
    assert [entry["way"] for entry in solution.details["tried"]] == ["the given start"]
    np.testing.assert_array_equal(solution.control.coefficients, solution.problem.initial)


def test_the_nearest_start_goes_on_to_max_iterations_where_all_else_failed(monkeypatch):
    monkeypatch.setattr(geodesic, "SEEDS", 0)
    monkeypatch.setattr(geodesic, "HALVINGS", 0)
    patient = Auto(Continuation(step_rule=Euler(0.1), max_iterations=100), restarts=0, route="never")
    solution = planning.solve(paper_problem(), patient)
    assert solution.converged
    assert solution.details["tried"][-1]["way"] == "the nearest start, to the end"
    short = planning.solve(
        paper_problem(), replace(patient, continuation=replace(patient.continuation, max_iterations=30))
    )
    assert short.outcome is Outcome.NOT_REACHED


def test_more_starts_are_tried_where_all_else_failed(monkeypatch):
    """A goal beside det W = 0, which one start of six leads to; manoeuvres get stuck before it."""
    monkeypatch.setattr(geodesic, "SEEDS", 0)
    monkeypatch.setattr(geodesic, "HALVINGS", 0)
    problem = task("paper_conjecture")
    problem = replace(problem, goal=goals.near_goal(problem, 34))
    solution = planning.solve(problem, Auto(route="never"))
    assert solution.converged
    assert "after 12 other ways" in solution.message
    assert solution.details["tried"][-1]["way"] == "seeded start 10"


@pytest.mark.parametrize("objective", ["none", "effort"])
@pytest.mark.parametrize("strategy", [lambda continuation: continuation, Auto], ids=["alone", "auto"])
@pytest.mark.parametrize("bounded", [False, True])
def test_the_message_speaks_of_the_control_that_is_returned(objective, strategy, bounded):
    """The second phase, least cost or bounds, makes another control than the one that first reached the goal."""
    bounds = [Bound("control", "v", -1.7, 1.7)] if bounded else []
    problem = paper_problem(bounds=bounds)
    solver = strategy(Continuation(step_rule=Adaptive(), objective=objective))
    solution = solver.solve(problem)
    assert solution.outcome is Outcome.CONVERGED
    error, updates = re.match(r"E = (\S+) after (\d+) updates", solution.message).groups()
    assert error == f"{solution.final_error:.3g}"
    accepted = [record["k"] for record in solution.iterations if record["accepted"]]
    assert int(updates) == accepted[-1]
    if objective != "none" or bounded:
        assert int(updates) > 1
