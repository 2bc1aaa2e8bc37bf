"""An NLP that begins with another solver's plan never ends with a dearer one, and says whose plan it hands back."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import FOLLOWED, following, path_error, settled_path
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp import first_plan, guesses
from nhpocp.solvers.nlp.first_plan import LoweredGuess, brought, cost_of, dearer, over, reaches
from nhpocp.solvers.nlp.guesses import SolverGuess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting, _uncertified
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.unicycle import Unicycle
from tests.conftest import paper_problem
from tests.solvers.nlp.pretending import Pretending

ADAPTIVE = Auto(Continuation(step_rule=Adaptive()))
CHEAP = Auto(Continuation(step_rule=Adaptive(), objective="effort", tolerance=1e-6))
ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}


def turning(height, **settings):
    """Heisenberg's system up its z axis, over a circle: 2π of effort at height 1."""
    return PlanningProblem(
        system=Heisenberg(),
        start=ORIGIN,
        goal={**ORIGIN, "z": height},
        initial=[[0, 0, 1, 0, 0], [0, 1, 0, 0, 0]],
        **settings,
    )


def parking():
    return PlanningProblem(
        system=Unicycle(),
        start={"x": 0.0, "y": 0.0, "theta": 0.0},
        goal={"x": 0.0, "y": 1.0, "theta": 0.0},
        initial=[[1, 0, 1, 0, 0], [0, 1, 0, 0, 0]],
    )


def lying(claim=Outcome.STAGNATED):
    return Pretending(claim, aside=0.1)


def warm(solver=ADAPTIVE, **settings):
    return MultipleShooting(
        **{"intervals": 12, "kernels": Interpreted(), "guess": SolverGuess(solver), **settings}
    )


@pytest.mark.parametrize(
    ("problem", "optimizer"),
    [
        (turning(1.0), {}),
        (turning(-0.2), {"optimizer": lying()}),
        (parking(), {}),
        (parking(), {"optimizer": lying()}),
        (paper_problem(), {}),
    ],
    ids=["turning", "turning, failing", "parking", "parking, failing", "paper"],
)
def test_nothing_is_dearer_than_the_plan_it_began_with(problem, optimizer):
    plan = brought(ADAPTIVE.solve(problem), 1e-6)
    solution = planning.solve(problem, warm(**optimizer))
    assert solution.converged, solution.message
    assert solution.solver == "nlp"
    assert solution.details["objective_value"] == pytest.approx(cost_of(solution))
    assert cost_of(solution) <= cost_of(plan) * (1 + 1e-9)
    assert "handed_back" in solution.details or not optimizer


def test_an_optimum_that_costs_more_than_the_plan_is_not_taken():
    """Over four intervals the least is 8, over a circle 2π."""
    solution = planning.solve(turning(1.0), warm(CHEAP, intervals=4))
    assert solution.converged, solution.message
    assert cost_of(solution) == pytest.approx(2 * np.pi, rel=1e-6)
    assert "the plan it began with is handed back: the NLP's optimum costs effort 8" in solution.message
    assert solution.details["certified"] is False
    assert "optimality" not in solution.details


@pytest.mark.parametrize("claim", [Outcome.STAGNATED, Outcome.ITERATION_LIMIT, Outcome.NOT_FINITE])
def test_a_plan_is_handed_back_with_its_own_numbers_and_words(claim):
    solution = planning.solve(turning(1.0), warm(CHEAP, optimizer=lying(claim)))
    assert solution.converged, solution.message
    assert solution.message.startswith(
        "Reached; optimality is not certified; the plan it began with is handed"
    )
    assert f"the NLP ended as {claim.value}" in solution.message
    assert any("handed back" in words for words in solution.warnings)
    assert not {"costates", "optimality", "feasible"} & set(solution.details)
    assert solution.final_error <= solution.tolerance == 1e-6
    assert solution.details["status"] == "Word"


def test_where_an_optimizer_stalls_is_a_plan_only_if_steps_follow_it():
    """One of a car jumped across a pole, to where it was right again, and through an obstacle."""
    solution = planning.solve(turning(1.0), MultipleShooting(intervals=12, kernels=Interpreted()))
    assert solution.details["path_error"] <= FOLLOWED
    stalled = replace(solution, outcome=Outcome.STAGNATED)
    assert _uncertified([stalled]) is not None
    jumping = replace(stalled, details={**stalled.details, "path_error": 0.5})
    assert _uncertified([jumping]) is None


def test_what_is_stopped_keeps_the_plan():
    problem = turning(1.0)
    solution = planning.solve(problem, warm(CHEAP, optimizer=lying(Outcome.INTERRUPTED)))
    assert solution.outcome is Outcome.INTERRUPTED
    assert "the Jacobian method's plan is kept, of effort 6.28" in solution.message
    assert solution.verdict.ok
    assert solution.verdict.error < 1e-6


class Stopped:
    """A solver that is stopped when it has come to its plan."""

    name = "jacobian"

    def solve(self, problem, progress=None):
        return replace(ADAPTIVE.solve(problem), outcome=Outcome.INTERRUPTED, message="stopped by hand.")


def test_what_a_guess_had_come_to_when_it_was_stopped_is_kept():
    problem = turning(1.0)
    half = Stopped().solve(problem)
    solution = planning.solve(problem, warm(Stopped()))
    assert solution.outcome is Outcome.INTERRUPTED
    assert "what the jacobian solver had come to is kept: stopped by hand" in solution.message
    assert solution.control == half.control
    assert (solution.evaluations, solution.final_error) == (half.evaluations, half.final_error)
    assert solution.verdict.ok


def test_a_plan_within_the_bounds_is_handed_back_within_them():
    limit = 0.95 * np.sqrt(2 * np.pi)  # of the circle's speed
    problem = turning(1.0, bounds=[Bound("control", "u2", -limit, limit)])
    solution = planning.solve(problem, warm(intervals=5, optimizer=lying()))
    assert solution.converged, solution.message
    assert "handed back" in solution.message
    assert np.abs(solution.trajectory["u2"]).max() <= limit * (1 + 1e-3)


def test_a_plan_that_does_not_reach_the_goal_is_not_handed_back():
    short = Continuation(step_rule=Adaptive(), max_iterations=0)
    solution = planning.solve(turning(1.0), warm(short, optimizer=lying()))
    assert "handed_back" not in solution.details
    assert not solution.converged


@pytest.mark.parametrize("nearer", [True, False], ids=["brought nearer", "as near as it is"])
def test_a_plan_that_no_nlp_can_begin_with_is_handed_back(nearer, monkeypatch):
    """Nor can it be brought nearer to the goal, if it is of manoeuvres that multiply errors; then that is said."""
    monkeypatch.setattr(guesses, "follow", lambda problem, control, intervals, steps: np.array([[np.nan]]))
    if not nearer:
        search = first_plan._search
        monkeypatch.setattr(
            first_plan, "_search", lambda *asked: replace(search(*asked), outcome=Outcome.STAGNATED)
        )
    solution = planning.solve(turning(1.0), warm())
    assert solution.converged, solution.message
    assert "the plan it began with is handed back: the NLP ended as not_finite" in solution.message
    assert solution.tolerance == (1e-6 if nearer else 1e-3)
    assert (
        "it is within E = 0.001 of the goal, and could not be brought to 1e-06" in solution.message
    ) != nearer


def test_a_plan_comes_nearer_to_the_goal_and_fits_another_basis():
    problem = paper_problem()
    loose = ADAPTIVE.solve(problem)
    assert loose.final_error > 1e-6
    plan = brought(loose, 1e-6)
    assert reaches(plan, 1e-6)
    assert cost_of(plan) == pytest.approx(cost_of(loose), rel=1e-2)
    basis = PiecewiseConstant(20)
    control = over(problem, plan.control, basis, 1e-6)
    assert control.basis == basis
    assert control.effort == pytest.approx(plan.control.effort, rel=0.05)
    assert over(problem, plan.control, PiecewiseConstant(1), 1e-6) is None


def test_a_plan_that_takes_more_steps_is_followed_with_more():
    """With the usual ones it would seem to lead elsewhere, and be given up."""
    fast = np.array([[0.5, 0.0, 0.4, 0.0, 0.0], [0.0, 300.0, 0.0, 0.0, 400.0]])
    problem = replace(parking(), initial=fast)
    control = problem.control(fast)
    ended = settled_path(problem, control, 20_000)[1][-1]
    problem = replace(problem, goal=problem.system.state_space.unpack(ended))
    few, steps = RungeKutta4(), following(problem, control)
    assert path_error(problem, control, few) > FOLLOWED >= path_error(problem, control, steps)
    plan = replace(
        ADAPTIVE.solve(problem), control=control, outcome=Outcome.CONVERGED, final_error=0.0, tolerance=1e-4
    )
    found = brought(plan, 1e-6)
    assert found.outcome is Outcome.CONVERGED
    assert found.tolerance == 1e-6
    np.testing.assert_allclose(found.control.coefficients, fast, rtol=1e-4, atol=1e-4)


def test_what_costs_less_is_still_a_plan():
    plan = brought(ADAPTIVE.solve(paper_problem()), 1e-6)
    guess = LoweredGuess(plan, PiecewiseConstant(20), 1e-6)
    assert dearer(plan, guess.least)
    assert reaches(guess.least, 1e-6)
    assert guess.control(plan.problem, 1.0, 0).basis == PiecewiseConstant(20)
    assert guess.evaluations > 0


def test_what_is_found_from_a_loose_plan_is_as_near_as_the_nlp_asks(monkeypatch):
    """And says so: it is told apart from a plan that could not be brought nearer."""
    wasteful = [[0, 0, 1, 0, 1.5], [0, 1, 0, 1.5, 0]]
    plan = ADAPTIVE.solve(replace(turning(1.0), initial=wasteful))
    guess = LoweredGuess(plan, PiecewiseConstant(20), 1e-6)
    assert plan.tolerance == 1e-3
    assert dearer(plan, guess.least)
    assert guess.least.tolerance == 1e-6
    monkeypatch.setattr(LoweredGuess, "_lowered", lambda guess, control: [])
    mended = LoweredGuess(plan, PiecewiseConstant(20), 1e-6).mended(CHEAP.solve(turning(1.0)))
    assert mended.plan.tolerance == 1e-6


def test_no_search_is_begun_that_takes_in_too_many_rows():
    """Of many pieces among obstacles: SLSQP would take minutes to a step. The plan is kept as it is."""
    bounds = [Bound("control", name, -9.0, 9.0) for name in ("u1", "u2")]
    plan = ADAPTIVE.solve(turning(1.0, bounds=bounds))
    small, large = PiecewiseConstant(12), PiecewiseConstant(600)
    assert LoweredGuess(plan, small, 1e-6).differs
    wide = replace(plan, control=project(plan.control, large))
    guess = LoweredGuess(wide, large, 1e-6)
    assert not guess.differs
    assert guess.least is wide
    assert guess.evaluations == 0
    assert guess.mended(wide) is None
