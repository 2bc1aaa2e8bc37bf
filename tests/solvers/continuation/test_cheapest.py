"""Of several plans the cheapest: along other routes, from other starts, and on the side that a route keeps to."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from nhpocp.controls.fourier import Fourier
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.cheapest import ALONG, ROUTES, cheapest
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.systems.unicycle import Unicycle
from tests.conftest import paper_problem

SOLVER = Continuation(step_rule=Adaptive(), objective="effort")


@dataclass
class Scripted:
    """A search whose starts come to nothing, or to one plan."""

    problem: PlanningProblem
    start: object = None
    base: Continuation = SOLVER
    records: list = field(default_factory=list)
    tried: list = field(default_factory=list)
    way: str = ""

    def note(self, way, outcome, error):
        self.tried.append({"way": way, "outcome": outcome, "error": error, "evaluations": 0})

    def attempt(self, problem, seed):
        return replace(self.start, outcome=Outcome.CONVERGED) if self.start else self.missed

    def finished(self, first, solver):
        return first

    missed = None


@pytest.fixture(scope="module")
def plan():
    problem = PlanningProblem(
        system=Unicycle(),
        start={"x": 0.0, "y": 0.0, "theta": 0.0},
        goal={"x": 1.0, "y": 0.0, "theta": 0.0},
        basis=Fourier(1),
        initial=np.array([[0.9, 0.0, 0.0], [0.0, 0.1, 0.0]]),
        pictures=False,
    )
    found = Continuation(step_rule=Adaptive()).find(problem)
    assert found.outcome is Outcome.CONVERGED
    return problem, found


def priced(plan, cost, outcome=Outcome.CONVERGED):
    return replace(plan, outcome=outcome, details={"objective_value": cost})


def search_after(problem, plan, way):
    search = Scripted(problem)
    search.missed = replace(plan, outcome=Outcome.STAGNATED)
    search.note(way, "converged", 0.0)
    return search


def test_plans_along_other_routes_are_compared_up_to_a_few(plan):
    problem, found = plan
    search = search_after(problem, found, f"9 manoeuvres in sequence {ALONG}")
    costs = iter([*range(ROUTES + 1, 2, -1), 1.0])
    routes = ((f"manoeuvres {ALONG}", priced(found, cost)) for cost in costs)
    least = cheapest(search, priced(found, 9.0), routes)
    assert least.details["objective_value"] == 3.0
    assert least.details["costs_of_starts"] == [*range(3, ROUTES + 2), 9.0][:ROUTES]
    assert next(costs) == 1.0  # not asked for
    assert least.message.endswith(f"the least of {ROUTES} plans")


def test_what_fails_along_a_route_counts_for_nothing(plan):
    problem, found = plan
    search = search_after(problem, found, f"9 manoeuvres in sequence {ALONG}")
    routes = iter([(f"manoeuvres {ALONG}", priced(found, 1.0, Outcome.STAGNATED))])
    assert cheapest(search, priced(found, 9.0), routes).details["objective_value"] == 9.0


def test_ctrl_c_leaves_the_least_so_far(plan):
    problem, found = plan
    search = search_after(problem, found, f"9 manoeuvres in sequence {ALONG}")

    def routes():
        yield f"manoeuvres {ALONG}", priced(found, 4.0)
        raise KeyboardInterrupt

    least = cheapest(search, priced(found, 9.0), routes())
    assert (least.outcome, least.details["objective_value"]) == (Outcome.INTERRUPTED, 4.0)
    assert "best so far" in least.message


def test_no_route_is_followed_after_a_plan_that_came_without(plan):
    problem, found = plan
    search = search_after(problem, found, "the given start")

    def routes():
        raise AssertionError
        yield

    assert cheapest(search, priced(found, 9.0), routes()).details["objective_value"] == 9.0


@pytest.mark.parametrize(("way", "crosses"), [(f"2 manoeuvres {ALONG}", False), ("the given start", True)])
def test_cheaper_plans_beyond_a_surface_count_only_where_no_route_was_followed(way, crosses):
    """Λ₀ made four times as large leads through det W = 0."""
    problem = paper_problem()
    found = SOLVER.find(paper_problem(objective="effort"))
    assert found.outcome is Outcome.CONVERGED
    wide = replace(found.control, coefficients=4.0 * np.asarray(problem.initial))
    search = search_after(problem, found, way)
    search.start = priced(replace(found, control=wide), 1.0)
    least = cheapest(search, priced(found, 9.0), iter(()))
    assert (least.details["objective_value"] == 1.0) is crosses
