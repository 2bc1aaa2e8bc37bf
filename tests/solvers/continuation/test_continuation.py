"""The continuation: the paper's figures, exponential decay, and a test for every ending."""

from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.end_point_map import VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4
from nhpocp.flow.simulation import simulate
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import MISSED
from nhpocp.solvers.continuation.generalized_inverses import Damped, Transpose
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler, Ode
from nhpocp.solvers.metrics import CoefficientMetric, L2Metric
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import PAPER_START, Integrators, Runaway, paper_problem, yaw

FINAL = np.array(  # [physics §2], default preset, γ = .1
    [
        [0.03936, 0.62835, 0.79417, -0.56243, -0.29366],
        [-0.01976, 0.4729, -0.90043, -0.81548, 0.09843],
        [0.97118, -0.12044, 1.01225, 0.00946, -0.21296],
    ]
)


@pytest.mark.parametrize(
    ("preset", "first", "evaluations"),
    [
        ("default", 1.3376783, {0.1: 70, 0.5: 12, 1: 5}),
        ("normal75", 1.3292, {0.1: 70, 0.5: 12, 1: 6}),
        ("paper_conjecture", 1.2846, {0.1: 70, 0.5: 12, 1: 4}),
        ("vertical_equal", None, {0.1: 80}),
    ],
)
def test_known_evaluations(preset, first, evaluations):
    for gamma, expected in evaluations.items():
        solution = Continuation(step_rule=Euler(gamma)).solve(paper_problem(preset))
        assert solution.outcome is Outcome.CONVERGED
        assert solution.evaluations == expected == len(solution.iterations)
        assert solution.iterations[-1]["k"] == expected - 1
        if first:
            assert solution.iterations[0]["error"] == pytest.approx(first, rel=4e-5)


@pytest.mark.parametrize(
    "solver",
    [
        Continuation(),
        Continuation(sensitivity=VariationalEndPointMap),
    ],
    ids=["rk4", "variational"],
)
def test_the_known_control(solver, problem):
    solution = solver.solve(problem)
    assert (solution.outcome, solution.evaluations) == (Outcome.CONVERGED, 70)
    np.testing.assert_allclose(solution.control.coefficients, FINAL, atol=6e-6)
    assert solution.control.effort == pytest.approx(3.0560, abs=5e-5)
    lengths = solution.trajectory["leg_lengths"]
    assert (lengths.min(), lengths.max()) == (pytest.approx(31.15, abs=5e-3), pytest.approx(48.79, abs=5e-3))


@pytest.mark.parametrize("integrator", [CasadiRungeKutta(), Cvodes()], ids=["rk", "cvodes"])
def test_every_integrator_finds_the_same_control(integrator, problem):
    solver = Continuation(step_rule=Euler(0.5))
    known, solution = solver.solve(problem), replace(solver, integrator=integrator).solve(problem)
    assert (solution.outcome, solution.evaluations) == (Outcome.CONVERGED, 12)
    np.testing.assert_allclose(solution.control.coefficients, known.control.coefficients, atol=6e-6)


@pytest.mark.parametrize("gamma", [0.1, 0.5])
@pytest.mark.parametrize("preset", ["default", "normal75", "paper_conjecture"])
def test_error_ratio_tends_to_one_minus_gamma(preset, gamma):
    errors = [
        r["error"] for r in Continuation(step_rule=Euler(gamma)).solve(paper_problem(preset)).iterations
    ]
    assert errors[-1] / errors[-2] == pytest.approx(1 - gamma, abs=2e-3)


def test_euler_steps_tend_to_the_exponential_flow(problem):
    """(16) has e(θ) = e^{-γθ} e(0); Euler's θ = γk approaches it in first order."""
    gaps = []
    for gamma in (0.1, 0.05):
        records = Continuation(step_rule=Euler(gamma), tolerance=0.3).solve(problem).iterations
        ratio = np.array([r["error"] for r in records]) / records[0]["error"]
        gaps.append(np.abs(np.log(ratio) + gamma * np.arange(len(records))).max())
    assert gaps[1] == pytest.approx(gaps[0] / 2, rel=0.2)


def test_l2_metric_takes_another_way_to_the_same_goal(problem):
    solution = Continuation(metric=L2Metric()).solve(problem)
    assert solution.outcome is Outcome.CONVERGED
    assert np.abs(solution.control.coefficients - FINAL).max() > 1e-4


def test_free_orientation_and_error_length():
    free = paper_problem(goal={"position": [-0.4, -0.2, 35]})
    solution = Continuation(step_rule=Euler(1.0)).solve(free)
    assert solution.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(solution.trajectory["position"][-1], [-0.4, -0.2, 35], atol=1e-3)
    scaled = Continuation().solve(paper_problem(error_length=10.0))
    assert scaled.iterations[0]["error"] < 0.5  # the same pose error, lengths counting a tenth
    assert scaled.evaluations < 70


def test_seeded_start_is_reproducible_and_reaches_the_goal():
    problem = paper_problem(initial=None)
    first, second = (Continuation(step_rule=Euler(0.5), seed=1).solve(problem) for _ in range(2))
    np.testing.assert_array_equal(first.control.coefficients, second.control.coefficients)
    assert first.outcome is Outcome.CONVERGED
    other = Continuation(step_rule=Euler(0.5), seed=2).solve(problem)
    assert other.iterations[0]["error"] != first.iterations[0]["error"]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_units_of_length_do_not_matter(scale):
    """The robot in millimetres or kilometres, E scaled along: the same number of updates."""
    robot = ThreeUPU(30 * scale, 15 * scale)
    task = {
        "system": robot,
        "start": {"position": np.array([0, 0, 25]) * scale, "orientation": yaw(-np.pi / 6)},
        "goal": {"position": np.array([-0.4, -0.2, 35]) * scale, "orientation": yaw(-np.pi / 2)},
        "error_length": scale,
    }
    assert Continuation(step_rule=Euler(0.5)).solve(paper_problem(**task)).evaluations == 12
    seeded = Continuation(step_rule=Euler(0.5)).solve(paper_problem(**task, initial=None))
    assert seeded.outcome is Outcome.CONVERGED


@pytest.mark.parametrize("error_length", [1e-6, 1e6])
def test_error_length_weighs_the_error_only(error_length):
    """It never makes a good Jacobian look singular."""
    for initial in (PAPER_START, None):
        solution = Continuation(max_iterations=2).solve(
            paper_problem(error_length=error_length, initial=initial)
        )
        assert solution.outcome is not Outcome.RANK_DEFICIENT


def test_a_free_orientation_may_be_anything():
    """Half a turn away from the start, where an error of orientation would have no direction."""
    turn = np.zeros((3, 5))
    turn[2, 0] = np.pi
    free = paper_problem(goal={"position": [-0.4, -0.2, 35]}, initial=turn)
    solution = Continuation(max_iterations=0, integrator=RungeKutta4(1000)).solve(free)
    assert np.isfinite(solution.final_error)


# --- step rules ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_rule", [Euler(), Adaptive(), Ode()], ids=lambda rule: rule.kind)
def test_every_step_rule_reaches_the_goal_from_a_seeded_start(step_rule):
    """`max_iterations` counts updates: those of `Ode` take 13 evaluations each."""
    solution = planning.solve(paper_problem(initial=None), Continuation(step_rule=step_rule))
    assert solution.converged


def test_ode_keeps_the_error_on_its_exponential(problem):
    """[Paper] eq. (9): log e(θ) is straight with slope -γ, to 1e-6."""
    solution = Continuation(step_rule=Ode(0.1)).solve(problem)
    assert solution.outcome is Outcome.CONVERGED
    accepted = [record for record in solution.iterations if record["accepted"]]
    theta = np.cumsum([record["gamma"] for record in accepted]) / 0.1
    logs = np.log([record["error"] for record in accepted])
    np.testing.assert_allclose(logs, logs[0] - 0.1 * theta, atol=1e-6)


@pytest.mark.parametrize(
    ("preset", "most"), [("default", 10), ("normal75", 8), ("paper_conjecture", 6), ("vertical_equal", 10)]
)
def test_adaptive_needs_few_evaluations(preset, most):
    solution = Continuation(step_rule=Adaptive()).solve(paper_problem(preset))
    assert solution.outcome is Outcome.CONVERGED
    assert solution.evaluations <= most
    accepted = [record["error"] for record in solution.iterations if record["accepted"]]
    assert accepted[-1] < 1e-2 * accepted[0]
    assert solution.iterations[-1]["k"] == len(accepted) - 1


def test_adaptive_refuses_trials_that_cross_det_s():
    """Newton's first step from Λ0 leaves the robot's side of det S = 0; Euler with γ = 1 ends there."""
    assert (
        Continuation(step_rule=Euler(1.0)).solve(paper_problem("vertical_equal")).outcome
        is Outcome.SINGULAR_S
    )
    solution = Continuation(step_rule=Adaptive(first_radius=1e6)).solve(paper_problem("vertical_equal"))
    assert solution.outcome is Outcome.CONVERGED
    assert not all(record["accepted"] for record in solution.iterations)


def test_adaptive_stops_where_no_step_helps(problem):
    solution = Continuation(step_rule=Adaptive(), tolerance=1e-18).solve(problem)
    assert solution.outcome is Outcome.STAGNATED
    assert min(record["error"] for record in solution.iterations) < 1e-11


@pytest.mark.parametrize("inverse", [Damped(), Transpose()], ids=lambda inverse: inverse.kind)
@pytest.mark.parametrize("metric", [CoefficientMetric(), L2Metric()], ids=lambda metric: metric.kind)
def test_other_inverses_reach_the_goal(inverse, metric):
    """Steepest descent crawls where J is badly conditioned (κ = 300 for the whole pose): there, position only."""
    goal = {"position": [-0.4, -0.2, 35]} if isinstance(inverse, Transpose) else paper_problem().goal
    solver = Continuation(step_rule=Adaptive(), inverse=inverse, metric=metric)
    assert solver.solve(paper_problem(goal=goal)).outcome is Outcome.CONVERGED


# --- endings ------------------------------------------------------------------------------------------------


def solved(problem, **settings):
    solution = planning.solve(problem, Continuation(**settings))
    assert not solution.converged
    assert solution.outcome.advice in solution.message
    assert ("`step_rule: auto`" in solution.message) == (solution.outcome in MISSED)
    assert len(solution.trajectory["t"]) == problem.samples
    return solution


def test_ends_converged(problem):
    solution = planning.solve(problem, Continuation(step_rule=Euler(1.0)))
    assert (solution.outcome, solution.converged) == (Outcome.CONVERGED, True)
    unverified = Continuation(step_rule=Euler(1.0)).solve(problem)
    assert (unverified.outcome, unverified.converged, unverified.verdict) == (Outcome.CONVERGED, False, None)


def test_ends_not_verified_when_the_integration_was_too_coarse(problem):
    solution = solved(problem, integrator=RungeKutta4(10), step_rule=Euler(1.0), tolerance=1e-6)
    assert solution.outcome is Outcome.NOT_VERIFIED
    assert solution.verdict.error > 1.01 * solution.tolerance > solution.final_error


def test_ends_constraint_violated(problem):
    bounds = [Bound("leg_speed", "u", -20.0, 20.0)]
    solution = solved(paper_problem(bounds=bounds), step_rule=Euler(1.0), max_iterations=40)
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED
    assert "leg_speed[" in solution.message


def test_ends_iteration_limit(problem):
    solution = solved(problem, max_iterations=5)
    assert (solution.outcome, solution.evaluations) == (Outcome.ITERATION_LIMIT, 6)


def test_ends_stagnated_where_rounding_stops_it(problem):
    solution = solved(problem, step_rule=Euler(1.0), tolerance=1e-17)
    assert solution.outcome is Outcome.STAGNATED
    assert min(r["error"] for r in solution.iterations) < 1e-12


def test_ends_diverged():
    """On a linear system Euler multiplies the error by 1 - γ."""
    linear = PlanningProblem(
        system=Integrators(), start={"x": 0.0, "y": 0.0}, goal={"x": 1.0, "y": 2.0}, initial=np.zeros((2, 5))
    )
    solution = solved(linear, step_rule=Euler(2.6))
    assert solution.outcome is Outcome.DIVERGED
    errors = [record["error"] for record in solution.iterations]
    np.testing.assert_allclose(np.array(errors[1:]) / errors[:-1], 1.6)


def test_ends_rank_deficient_when_no_seeded_start_is_good():
    """Three functions cannot move six numbers."""
    solution = solved(paper_problem(initial=None, basis=Fourier(0)))
    assert solution.outcome is Outcome.RANK_DEFICIENT
    assert "no control of full rank" in solution.message


def test_ends_singular_s_where_the_start_is_undefined():
    """Equal triangles, w4 normal, no yaw: every leg stands along its own w4."""
    upright = {"position": [0, 0, 25], "orientation": yaw(0.0)}
    robot = ThreeUPU(10.0, 10.0, np.pi / 2, "normal")
    for initial in (PAPER_START, None):
        solution = solved(paper_problem(system=robot, start=upright, initial=initial))
        assert solution.outcome in (Outcome.SINGULAR_S, Outcome.RANK_DEFICIENT)
    assert "det S vanishes at the start" in solved(paper_problem(system=robot, start=upright)).message


@pytest.mark.parametrize(("coefficients", "rank"), [(np.zeros((3, 5)), 3), (np.eye(3, 5, -2), 5)])
def test_ends_rank_deficient(coefficients, rank):
    solution = solved(paper_problem(initial=coefficients))
    assert solution.outcome is Outcome.RANK_DEFICIENT
    assert f"rank {rank} of 6" in solution.message
    assert solution.iterations[0]["rank"] == rank


def test_ends_singular_s_and_says_when():
    solution = solved(paper_problem("vertical_equal"), step_rule=Euler(1.0))
    assert solution.outcome is Outcome.SINGULAR_S
    assert "det S" in solution.message
    assert "t = 0.9" in solution.message


def test_ends_singular_w_in_the_original_form():
    """The leg speeds of a path of (7) through det W = 0, given to (3), which cannot pass there."""
    feedback = paper_problem("paper_conjecture")
    motion = simulate(feedback, feedback.control(PAPER_START)).trajectory
    speeds = np.linalg.lstsq(feedback.basis.table(motion["t"], 1.0), motion["u"], rcond=None)[0].T
    solution = solved(paper_problem("paper_conjecture", form="original", initial=speeds))
    assert solution.outcome is Outcome.SINGULAR_W


def test_ends_orientation_at_pi():
    turn = np.zeros((3, 5))
    turn[2, 0] = 1.0
    half = {"position": [0, 0, 30], "orientation": yaw(-np.pi / 6 - 1 + np.pi)}
    solution = Continuation().solve(
        paper_problem(initial=turn, goal=half)
    )  # `planning` would see det W first
    assert solution.outcome is Outcome.ORIENTATION_AT_PI


def test_ends_not_finite():
    problem = PlanningProblem(
        system=Runaway(), start={"x": 1.0}, goal={"x": 2.0}, initial=[[5.0, 0, 0, 0, 0]]
    )
    solution = solved(problem)
    assert solution.outcome is Outcome.NOT_FINITE
    assert "t = 0.2" in solution.message  # x = 1/(1 - 5t)


def test_ends_other_component():
    """Folding the legs of the robot through to the other side of the base."""
    below = {"position": [0.3, 0.2, -35], "orientation": yaw(-np.pi / 6)}
    solution = solved(paper_problem(goal=below))
    assert solution.outcome is Outcome.OTHER_COMPONENT
    assert solution.evaluations == 0
    assert "det" in solution.message


def test_a_start_on_a_singular_surface_is_no_other_component():
    """det W is rounding there, of either sign."""
    flat = {"position": [0, 0, 0], "orientation": yaw(-np.pi / 6)}
    solution = planning.solve(paper_problem(start=flat), Continuation())
    assert solution.outcome is not Outcome.OTHER_COMPONENT


def test_ends_interrupted_with_what_was_found(problem):
    def stop(record):
        if record["k"] == 3:
            raise KeyboardInterrupt

    solution = planning.solve(problem, Continuation(), stop)
    assert solution.outcome is Outcome.INTERRUPTED
    assert solution.evaluations == 4
    assert not np.array_equal(solution.control.coefficients, PAPER_START)
    assert solution.verdict.error == pytest.approx(solution.final_error, abs=1e-6)


def test_ends_solver_error(problem):
    """An integrator that may not take enough steps."""
    lame = Cvodes(options=(("max_num_steps", 2),))
    solution = solved(problem, integrator=lame)
    assert solution.outcome is Outcome.SOLVER_ERROR
    assert "CasADi failed" in solution.message


def test_free_horizon_without_initial_is_refused():
    problem = paper_problem(horizon=Horizon(None, 0.5, 3.0))
    with pytest.raises(InvalidProblemError, match="initial: 1"):
        Continuation().solve(problem)
    held = Continuation(step_rule=Euler(1.0)).solve(paper_problem(horizon=Horizon(2.0, 0.5, 3.0)))
    assert held.control.horizon == 2.0
