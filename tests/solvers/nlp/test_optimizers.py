"""IPOPT and fatrop on programmes of two unknowns, and the words they end with."""

import casadi as ca
import numpy as np
import pytest

from nhpocp.errors import InvalidProblemError
from nhpocp.installation import diagnose
from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.solvers.nlp.ipopt import ENDINGS, LINEAR_SOLVERS, Ipopt
from nhpocp.solvers.nlp.optimizer import failed


class Small:
    """min f(x) over x ∈ R², lower ≤ g(x) ≤ upper; one stage of one state and one control, and a last state-less one."""

    def __init__(self, f, g, lower, upper):
        x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 0)
        self.size = 2
        self.lower, self.upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
        self.functions = {
            "nlp": ca.Function("nlp", [x, p], [f(x), ca.vertcat(*g(x))], ["x", "p"], ["f", "g"]),
            "exact": True,
        }
        self.structure = None


def rosenbrock(x):
    return (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2


CIRCLE = Small(rosenbrock, lambda x: [ca.sumsqr(x)], [0.0], [1.0])
START = np.array([-0.5, 0.5])


def _without_check(linear_solver):
    """An `Ipopt` that has lost a linear solver since it was made."""
    ipopt = Ipopt()
    object.__setattr__(ipopt, "linear_solver", linear_solver)
    return ipopt


BEST = 0.0456748087  # Rosenbrock on the unit disk, at (.78641515, .61769831)


@pytest.mark.parametrize("linear_solver", LINEAR_SOLVERS)
def test_every_linear_solver_on_the_list_works(linear_solver, monkeypatch):
    monkeypatch.setenv("OMP_CANCELLATION", "TRUE")
    monkeypatch.setenv("OMP_PROC_BIND", "TRUE")
    optimum = Ipopt(linear_solver=linear_solver).solve(CIRCLE, START)
    if linear_solver == "spral" and optimum.outcome is Outcome.SOLVER_ERROR:
        pytest.skip("spral reads OMP_CANCELLATION before Python starts")
    assert (optimum.outcome, optimum.status) == (Outcome.CONVERGED, "Solve_Succeeded")
    np.testing.assert_allclose(optimum.x, [0.78641515, 0.61769831], atol=1e-6)
    assert optimum.objective == pytest.approx(BEST, abs=1e-8)


def test_what_comes_back_is_all_of_it():
    optimum = Ipopt().solve(CIRCLE, START)
    assert optimum.constraints == pytest.approx([1.0])
    gradient = ca.Function("d", [x := ca.MX.sym("x", 2)], [ca.gradient(rosenbrock(x), x)])(optimum.x)
    # L = f + λ g: ∇f = -λ ∇g with λ > 0 at an upper bound
    np.testing.assert_allclose(np.array(gradient).ravel(), -2 * optimum.multipliers * optimum.x, atol=1e-6)
    assert optimum.multipliers[0] > 0
    assert [record["k"] for record in optimum.iterations] == list(range(len(optimum.iterations)))
    assert optimum.iterations[-1]["objective"] == pytest.approx(optimum.objective)
    assert optimum.evaluations >= len(optimum.iterations)
    assert "Optimal Solution Found" in optimum.log
    assert optimum.cut_back == 0


def test_a_warm_start_saves_iterations():
    cold = Ipopt().solve(CIRCLE, START)
    warm = Ipopt().solve(CIRCLE, cold.x, cold.multipliers)
    assert len(warm.iterations) < len(cold.iterations) / 2


def test_a_limited_memory_hessian_where_there_is_no_exact_one():
    programme = Small(rosenbrock, lambda x: [ca.sumsqr(x)], [0.0], [1.0])
    del programme.functions["exact"]
    optimum = Ipopt().solve(programme, START)
    assert "Number of nonzeros in Lagrangian Hessian.............:        0" in optimum.log
    assert optimum.objective == pytest.approx(BEST, abs=1e-8)


ENDS = {
    "iteration limit": (Ipopt(max_iterations=2), CIRCLE, Outcome.ITERATION_LIMIT),
    "infeasible": (
        Ipopt(),
        Small(rosenbrock, lambda x: [ca.sumsqr(x), x[0]], [0.0, 2.0], [1.0, 3.0]),
        Outcome.INFEASIBLE,
    ),
    "more equations than unknowns": (
        Ipopt(),
        Small(rosenbrock, lambda x: [x[0], x[1], x[0] + x[1]], [0, 0, 1], [0, 0, 1]),
        Outcome.INFEASIBLE,
    ),
    "as many equations as unknowns": (
        Ipopt(),
        Small(rosenbrock, lambda x: [x[0], x[1]], [2, 3], [2, 3]),
        Outcome.CONVERGED,
    ),
    "unbounded": (
        Ipopt(),
        Small(lambda x: -(x[0] ** 2), lambda x: [x[1]], [-1], [1]),
        Outcome.DIVERGED,
    ),
    "undefined at the start": (
        Ipopt(),
        Small(lambda x: x[0] ** 2, lambda x: [ca.sqrt(x[0] - 3)], [0], [1]),
        Outcome.NOT_FINITE,
    ),
    "no such linear solver": (_without_check("ma27"), CIRCLE, Outcome.SOLVER_ERROR),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ENDS)
def test_endings(name, capfd):
    optimizer, programme, outcome = ENDS[name]
    optimum = optimizer.solve(programme, START)
    assert optimum.outcome is outcome, optimum.status
    assert optimum.iterations[-1]["k"] >= 0
    assert optimum.iterations[-1]["k"] < 3000
    exact = programme.functions["nlp"](optimum.x, [])[1]
    np.testing.assert_array_equal(optimum.constraints, np.array(exact).ravel())


@pytest.mark.parametrize(
    ("word", "outcome"),
    [
        ("Restoration_Failed", Outcome.INFEASIBLE),
        ("Search_Direction_Becomes_Too_Small", Outcome.STAGNATED),
        ("Solved_To_Acceptable_Level", Outcome.CONVERGED),  # to the tolerance that was asked for
        ("Maximum_CpuTime_Exceeded", Outcome.ITERATION_LIMIT),
        ("Invalid_Number_Detected", Outcome.NOT_FINITE),
        ("User_Requested_Stop", Outcome.INTERRUPTED),
    ],
)
def test_words_that_are_hard_to_provoke(word, outcome):
    assert ENDINGS[word] is outcome


def test_the_watch_sees_every_iteration_and_can_stop():
    seen = []

    def watch(k, objective, look):
        seen.append((k, objective, look() if k % 2 else look))  # at once, and when all is over
        return k == 3

    optimum = Ipopt().solve(CIRCLE, START, None, watch)
    assert optimum.outcome is Outcome.INTERRUPTED
    assert [k for k, _, _ in seen] == [0, 1, 2, 3]
    assert seen[0][1] == pytest.approx(float(rosenbrock(ca.DM(START))), rel=1e-2)
    assert [look if k % 2 else look() for k, _, look in seen] == optimum.iterations


def test_refused_trial_steps_are_counted():
    programme = Small(lambda x: ca.sumsqr(x), lambda x: [ca.log(x[0]) + x[1]], [-5], [-5])
    optimum = Ipopt().solve(programme, np.array([0.05, 0.0]))
    assert optimum.outcome is Outcome.CONVERGED
    assert optimum.cut_back == optimum.log.count("evaluation error")


def test_an_exception_becomes_an_ending():
    optimum = failed(CIRCLE, START, RuntimeError("first line\nwhat went wrong"))
    assert optimum.outcome is Outcome.SOLVER_ERROR
    assert "what went wrong" in optimum.status
    assert optimum.constraints == pytest.approx([0.5])


def test_settings_are_plain_data():
    assert Ipopt(1e-5, 7).settings() == {"plugin": "ipopt", "tolerance": 1e-5, "max_iterations": 7}
    assert Fatrop(1e-5, 7).settings() == {"plugin": "fatrop", "tolerance": 1e-5, "max_iterations": 7}


def test_linear_solvers_come_from_a_list_that_was_tried():
    """ma97 would crash the interpreter at its end."""
    with pytest.raises(InvalidProblemError, match="available: mumps, spral"):
        Ipopt(linear_solver="ma97")
    tried = diagnose()["linear solvers of ipopt"]  # spral wants OMP_CANCELLATION set before Python starts
    assert "mumps" in tried
    assert set(tried) <= set(LINEAR_SOLVERS)
