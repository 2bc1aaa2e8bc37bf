"""`path_length` through both solvers: at rest, along straight lines, and against plain scripts."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, radians, sin

import numpy as np
import pytest

import nhpocp
from nhpocp.constraints.bound import Bound
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.horizon import Horizon
from nhpocp.objectives.path_length import PathLength
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file.building import build_solver
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.solvers.nlp.guesses import ProblemGuess, make_guess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import Integrators, Turntable, paper_problem, yaw
from tests.ferry import Ferry

SOLVERS = {
    "nlp": build_solver("nlp", {"intervals": 12, "steps_per_interval": 1}),
    "single shooting": build_solver("nlp", {"intervals": 3, "steps_per_interval": 1, "shooting": "single"}),
    "over the basis": build_solver("nlp", {"intervals": 12, "steps_per_interval": 2, "control": "basis"}),
    "jacobian": build_solver("jacobian", {"step_rule": "auto", "objective": "path_length"}),
}
AT_REST = {"position": [0, 0, 25], "orientation": yaw(-np.pi / 6)}


def straight(**changes) -> PlanningProblem:
    values = {"start": {"x": 0, "y": 0}, "goal": {"x": 3, "y": 4}, "initial": np.zeros((2, 5))}
    return PlanningProblem(
        system=Integrators(), objective="path_length", pictures=False, **{**values, **changes}
    )


def still(initial) -> PlanningProblem:
    return paper_problem(goal=AT_REST, initial=initial, objective="path_length")


@pytest.mark.parametrize("system", [Turntable(), Ferry(), *(system_class(model)() for model in SYSTEMS)])
def test_what_a_search_takes_for_the_length_is_just_below_it(system):
    random = np.random.default_rng(1)
    space, rest = system.state_space, 0.05
    values = {
        b.name: np.eye(3) if b.kind == "rotation" else random.normal(size=b.shape) for b in space.blocks
    }
    if "position" in values and values["position"].shape == (3,):
        values["position"] = np.array([0.3, -0.2, 25.0])  # where the legs of a robot are
    state = space.pack(values)
    for size in (0.0, 1e-9, 1e-3, 1.0, 1e3):
        control = size * random.normal(size=system.input_space.size)
        speed, softened = (
            f(system, state, control, 2.0, *more)
            for f, more in ((PathLength().integrand, ()), (PathLength().searched, (rest,)))
        )
        assert max(0.0, speed - rest) <= softened <= speed
        assert softened == pytest.approx(np.hypot(speed, rest) - rest, rel=1e-6, abs=1e-15)


def test_its_derivatives_are_finite_at_rest():
    problem = still(np.zeros((3, 5)))
    value, gradient = cost_map("path_length", problem, problem.basis, 1.0, RungeKutta4(10))(np.zeros((3, 5)))
    assert value == 0
    np.testing.assert_array_equal(gradient, 0)
    guess = make_guess(ProblemGuess(), problem, None, 3, 0)
    programme = StagedTranscription(problem, guess, None, 3, 1, [], Interpreted())
    x = programme.pack(guess)
    hessian = programme.functions["hess_lag"](x, [], 1.0, np.zeros(len(programme.rows)))
    for values in (*programme.functions["grad_f"](x, []), hessian):
        assert np.isfinite(np.array(values)).all()


@pytest.mark.parametrize("name", SOLVERS)
def test_straight_lines_from_a_control_at_rest(name):
    solution = nhpocp.solve(straight(), SOLVERS[name])
    assert solution.converged, solution.message
    assert solution.costs["path_length"] == pytest.approx(5.0, rel=1e-6)
    assert solution.details["objective_value"] == pytest.approx(5.0, rel=1e-6)
    assert "not at a stationary point" not in solution.message


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("initial", [np.zeros((3, 5)), None], ids=["zero", "auto"])
def test_to_stay_costs_nothing(initial, name):
    solution = nhpocp.solve(still(initial), SOLVERS[name])
    assert solution.converged, solution.message
    assert solution.costs["path_length"] < 1e-6 * solution.problem.scale
    assert "not at a stationary point" not in solution.message


@pytest.mark.parametrize(("length", "time"), [(1e-3, 1.0), (1.0, 1e3), (1e3, 1e-3)])
def test_units_of_a_straight_line_do_not_matter(length, time):
    """The number of iterations depends on neither; the length is softened by a share of the problem's own."""
    counts = []
    for size, duration in ((1.0, 1.0), (length, time)):
        problem = straight(goal={"x": 3 * size, "y": 4 * size}, horizon=Horizon(duration))
        initial = np.array([[1.0, 2.0, 0, 0, 0], [0, 0, 1.0, 0, 0]]) * size / duration
        solution = nhpocp.solve(replace(problem, initial=initial), SOLVERS["nlp"])
        assert solution.costs["path_length"] == pytest.approx(5 * size, rel=1e-6)
        counts.append(len(solution.iterations))
    assert abs(counts[0] - counts[1]) <= 2


def test_a_horizon_that_costs_nothing_stays_where_it_was():
    for maximum in (None, 50.0):
        solution = nhpocp.solve(straight(horizon=Horizon(2.0, 0.5, maximum)), SOLVERS["nlp"])
        assert solution.converged, solution.message
        assert solution.control.horizon == pytest.approx(2.0, rel=0.05)


def test_bounds_on_the_pace_lengthen_no_path_that_need_not_be_longer():
    problem = straight(
        bounds=[Bound("control", "u", -3.1, 3.1)], initial=[[6.0, 0, 0, 0, 0], [4.0, 0, 0, 0, 0]]
    )
    for name in ("nlp", "jacobian"):
        solution = nhpocp.solve(problem, SOLVERS[name])
        assert solution.converged, solution.message
        assert solution.costs["path_length"] == pytest.approx(5.0, rel=1e-4)


def unequal_legs() -> ThreeUPU:
    legs = []
    for k, (base, platform, tilt) in enumerate([(30, 15, 75), (26, 12, 60), (34, 18, 80)]):
        c, s, beta = cos(2 * pi * k / 3), sin(2 * pi * k / 3), radians(tilt)
        r = (-sin(beta) * s, sin(beta) * c, cos(beta))
        legs.append(
            {
                "base": (base * c, base * s, 0),
                "platform": (platform * c, platform * s, 0),
                "r": r,
                "w4": (c, s, 0),
            }
        )
    return ThreeUPU(legs=legs)


@pytest.mark.parametrize(
    ("system", "intervals", "plain"),
    [
        (ThreeUPU(), 12, 25.158714),
        (ThreeUPU(), 50, 24.957090),
        (unequal_legs(), 12, 52.071212),
    ],
    ids=["default, 12", "default, 50", "unequal legs, 12"],
)
def test_the_nlp_meets_a_plain_script(system, intervals, plain):
    """Plain: six states, the same intervals, one RK4 step each, the length itself, IPOPT's defaults, the same guess."""
    problem = replace(paper_problem(objective="path_length"), system=system)
    solution = MultipleShooting(intervals=intervals, steps_per_interval=1).solve(problem)
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert solution.details["objective_value"] <= 1.001 * plain


def test_the_jacobian_method_meets_the_nlp_over_the_same_basis():
    found = nhpocp.solve(paper_problem(objective="path_length"), SOLVERS["jacobian"])
    assert found.converged, found.message
    assert found.costs["path_length"] == pytest.approx(24.98652, rel=1e-5)
