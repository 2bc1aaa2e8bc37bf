"""Every constraint of the problem file, made active at the unconstrained solution, is honoured by both solvers."""

from functools import lru_cache
from itertools import cycle

import numpy as np
import pytest

from nhpocp import planning, so3
from nhpocp.constraints.bound import Bound
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.least_cost.between_samples import around, dips_of, lowest_between
from nhpocp.solvers.least_cost.path_rows import PathRows
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.numeric import numeric_system
from nhpocp.verification.replay import replay, sample
from tests.conftest import PAPER_START, paper_problem

# a goal on the way to which everything leaves the range between its values at the ends
GOAL = {"position": [-0.4, -0.2, 28], "orientation": so3.from_rpy(np.radians([10.0, -10, -60]))}
PRESETS = ["default", "normal75"]
NLP = MultipleShooting(intervals=30, optimizer=Ipopt(tolerance=1e-4))  # which asks for few steps


def cut(values, share=0.5):
    """The greatest value, moved towards the greatest at the ends by a share of what is between."""
    return values.max(0) - share * (values.max(0) - values[[0, -1]].max(0))


def leg_length(free):
    return [Bound("leg_length", "leg_lengths", -cut(-free["leg_lengths"].min(1)), 60.0)]


def leg_speed(free):
    limit = 0.9 * np.abs(free["u"]).max()
    return [Bound("leg_speed", "u", -limit, limit)]


def control(free):
    limit = 0.9 * np.abs(free["v"]).max()
    return [Bound("control", "v", -limit, limit)]


def control_of_each_input(free):
    lower, upper = free["v"].min(0) - 0.1, free["v"].max(0)
    upper[0] *= 0.9
    return [Bound("control", "v", lower, upper)]


def clearance(free):
    least = min(-cut(-free[name]) for name in ("sigma_s", "sigma_w"))
    return [Bound(f"clearance.{name}", name, least) for name in ("sigma_s", "sigma_w")]


def state_box(free):
    lower, upper = free["position"].min(0) - 1, free["position"].max(0) + 1
    upper[1] = cut(free["position"], 0.2)[1]
    return [Bound("state.position", "position", lower, upper)]


def output_bound(free):
    limits = np.full((3, 4), np.inf)
    limits[:, 2] = cut(free["joint_angles"], 0.3)[:, 2]
    return [Bound("state.joint_angles", "joint_angles", -np.inf, limits)]


def leg_acceleration(free):
    limit = 0.9 * np.abs(free["leg_accelerations"]).max()
    return [Bound("leg_acceleration", "leg_accelerations", -limit, limit)]


KINDS = [leg_length, leg_speed, control, control_of_each_input, clearance, state_box, output_bound]


def solver(objective="none", **settings):
    return Continuation(step_rule=Adaptive(), objective=objective, **settings)


@lru_cache
def free_trajectory(preset, method):
    """Without constraints; ``method``: an objective of the Jacobian method, or nlp."""
    used = NLP if method == "nlp" else solver(method)
    solution = planning.solve(paper_problem(preset, goal=GOAL), used)
    assert solution.converged
    return solution.trajectory


def bounded_problem(kind, preset, method):
    return paper_problem(preset, goal=GOAL, bounds=kind(free_trajectory(preset, method)))


def excess_on_1000_points(solution):
    """The worst relative excess over any bound on a grid that is neither a solver's nor the verdict's."""
    problem, numeric = solution.problem, numeric_system(solution.problem.system)
    samples = sample(replay(numeric, solution.control, problem.start_point), solution.control, 1013)
    trajectory = numeric.trajectory(samples.states, samples.controls, problem.scale, samples.control_rates)
    return max(bound.relative_excess(trajectory[bound.quantity]).max() for bound in problem.bounds)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("preset", "objective"), [("default", "none"), ("normal75", "effort")])
def test_the_jacobian_method_honours_every_constraint(kind, preset, objective):
    problem = bounded_problem(kind, preset, objective)
    free = free_trajectory(preset, objective)
    assert max(bound.relative_excess(free[bound.quantity]).max() for bound in problem.bounds) > 1e-3
    solution = planning.solve(problem, solver(objective))
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert solution.details["constraints"]["violation"] <= 1e-6
    assert all(report.worst <= 1e-5 for report in solution.verdict.bounds)
    assert excess_on_1000_points(solution) <= 1e-5


@pytest.mark.parametrize(("kind", "preset"), list(zip(KINDS, cycle(PRESETS), strict=False)))
def test_the_nlp_honours_every_constraint(kind, preset):
    problem = bounded_problem(kind, preset, "nlp")
    free = free_trajectory(preset, "nlp")
    assert max(bound.relative_excess(free[bound.quantity]).max() for bound in problem.bounds) > 1e-3
    solution = planning.solve(problem, NLP)
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert all(report.ok for report in solution.verdict.bounds)
    assert excess_on_1000_points(solution) <= 1e-3


def test_the_jacobian_method_honours_accelerations():
    free = planning.solve(
        paper_problem(goal=GOAL, bounds=[Bound("wide", "leg_accelerations", -1e6)]), solver()
    )
    problem = paper_problem(goal=GOAL, bounds=leg_acceleration(free.trajectory))
    solution = planning.solve(problem, solver())
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert excess_on_1000_points(solution) <= 1e-5
    (limit,) = {bound.upper for bound in problem.bounds}
    assert np.abs(solution.trajectory["leg_accelerations"]).max() == pytest.approx(limit, rel=1e-2)


def test_the_least_effort_within_bounds_is_the_nlp_s_over_the_same_basis():
    problem = bounded_problem(leg_speed, "default", "effort")
    ours = solver("effort").solve(problem)
    nlp = MultipleShooting(over_basis=True, intervals=12, steps_per_interval=6).solve(problem)
    assert ours.control.effort == pytest.approx(nlp.details["objective_value"], rel=2e-3)
    assert "at a stationary point" in ours.message


def test_bounds_that_hold_already_change_nothing():
    problem = paper_problem(bounds=[Bound("leg_length", "leg_lengths", 20, 60)])
    bounded, free = solver().solve(problem), solver().solve(paper_problem())
    assert np.array_equal(bounded.control.coefficients, free.control.coefficients)
    assert bounded.evaluations == free.evaluations
    bounded, free = solver("effort").solve(problem), solver("effort").solve(paper_problem())
    assert np.array_equal(bounded.control.coefficients, free.control.coefficients)


def test_a_bound_that_no_control_keeps_is_named_and_the_goal_is_not_lost():
    problem = paper_problem(bounds=[Bound("control", "v", -0.5, 0.5)])
    solution = planning.solve(problem, solver(max_iterations=60))
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED
    assert "outside [-0.5, 0.5]" in solution.message
    assert "more harmonics" in solution.message
    assert solution.verdict.error <= solution.tolerance


def test_an_equation_as_a_box():
    """lo = hi: without turning about z the platform still comes to its place."""
    bound = Bound("control", "v", [-9, -9, 0], [9, 9, 0])
    problem = paper_problem(goal={"position": [-0.4, -0.2, 28]}, bounds=[bound])
    solution = planning.solve(problem, solver())
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert np.abs(solution.trajectory["v"][:, 2]).max() <= 1e-3


def test_the_reached_control_is_kept_when_the_search_is_cut_short():
    problem = paper_problem(bounds=[Bound("leg_speed", "u", -32, 32)])
    solution = planning.solve(problem, solver("effort", max_iterations=8))
    assert solution.outcome is Outcome.CONSTRAINT_VIOLATED
    assert "max_iterations" in solution.message
    assert solution.verdict.error <= 1.01 * solution.tolerance


def test_clearance_leads_back_across_a_singular_surface():
    """The way to this goal crosses det W = 0 twice; with clearance it goes round."""
    free = planning.solve(paper_problem("paper_conjecture"), solver())
    assert len(free.verdict.crossings) == 2
    bounds = [Bound(f"clearance.{name}", name, 0.02) for name in ("sigma_s", "sigma_w")]
    solution = planning.solve(paper_problem("paper_conjecture", bounds=bounds), solver())
    assert solution.converged
    assert not solution.verdict.crossings
    assert solution.trajectory["sigma_w"].min() >= 0.02 * (1 - 1e-6)
    assert solution.verdict.original.ok


def test_controls_that_jump_are_bounded_on_both_sides_of_a_breakpoint():
    basis = PiecewiseConstant(20)
    start = np.random.default_rng(0).normal(size=(3, 20))
    problem = paper_problem(basis=basis, initial=start, bounds=[Bound("leg_speed", "u", -40, 40)])
    solution = planning.solve(problem, solver())
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert excess_on_1000_points(solution) <= 1e-5


def test_control_bounds_of_the_original_form_are_leg_speeds():
    problem = paper_problem(form="original", initial=None, bounds=[Bound("control", "u", -32, 32)])
    solution = planning.solve(problem, solver())
    assert solution.outcome is Outcome.CONVERGED, solution.message
    assert np.abs(solution.trajectory["u"]).max() <= 32 * (1 + 1e-6)


ALL = [
    Bound("leg_length", "leg_lengths", 31.2, 48),
    Bound("leg_speed", "u", -30, 30),
    Bound("control", "v", [-1, -np.inf, 0], [1, 1, 1]),
    Bound("clearance.sigma_s", "sigma_s", 0.8),
    Bound("clearance.sigma_w", "sigma_w", 0.7),
    Bound("state.position", "position", [-1, -1, 20], [1, 1, 40]),
    Bound("state.joint_angles", "joint_angles", -1, [[1, 1, 1, np.inf]] * 3),
]


ACCELERATED = [*ALL, Bound("leg_acceleration", "leg_accelerations", -150, 100)]


@pytest.mark.parametrize("preset", [*PRESETS, "paper_conjecture"])
@pytest.mark.parametrize(
    ("basis", "bounds"),
    [(Fourier(2), ALL), (PiecewiseConstant(7), ALL), (BSpline(1, 3), ACCELERATED)],
    ids=lambda part: part.kind if isinstance(part, ControlBasis) else len(part),
)
def test_rows_are_the_relative_excess_and_their_derivatives_are_right(preset, basis, bounds):
    random = np.random.default_rng(3)
    start = 0.7 * random.normal(size=(3, basis.size))
    problem = paper_problem(preset, bounds=bounds, basis=basis, initial=start)
    integrator = RungeKutta4(50)
    times = integrator.grid(basis, 1.0)
    rows = PathRows(problem, basis, 1.0, times)
    flow = integrator.flow(Dynamics(numeric_system(problem.system).rate_function), basis, 1.0)

    def values(coefficients):
        return rows.values(flow.states(problem.start_point, coefficients), coefficients)

    # the rows that look at a sample say what the bounds say there, but for how far inside they are meant to be
    control = problem.control(start)
    trajectory = numeric_system(problem.system).trajectory(
        flow.states(problem.start_point, start), control(times), problem.scale, control.derivative(times)
    )
    worst = max(bound.relative_excess(trajectory[bound.quantity]).max() for bound in bounds)
    signs = np.sign(trajectory["det_w"] * trajectory["det_w"][0])
    if (signs > 0).all():  # beyond det W = 0 the rows go on growing, the excess does not
        assert -values(start).min() == pytest.approx(worst, abs=5e-3)
    slopes, step = rows.derivatives(start), 1e-6
    for direction in random.normal(size=(3, *start.shape)):
        measured = (values(start + step * direction) - values(start - step * direction)) / (2 * step)
        np.testing.assert_allclose(slopes @ direction.ravel(), measured, atol=1e-5 * np.abs(measured).max())


def test_between_samples_is_what_a_fine_path_finds():
    """Coarse samples (10 steps) see the control's peaks 2 % too low; `between` does not."""
    problem = paper_problem(bounds=[Bound("control", "v", -1, 1)])
    times = np.linspace(0, 1, 11)
    rows = PathRows(problem, problem.basis, 1.0, times)
    peak = np.abs(problem.control(PAPER_START)(np.linspace(0, 1, 100_001))).max()
    assert -rows.between(PAPER_START).min() == pytest.approx(peak - 1, abs=2e-5)


def test_what_passes_a_corner_is_nearest_between_two_samples():
    """At speed 10 and distance 0.04 the nearest of 2000 samples is up to 8e-5 too far: twice what is forgiven."""
    times = np.linspace(0, 1, 2001)
    for nearest in np.linspace(0.5, 0.5005, 7):
        distances = np.hypot(0.04, 10 * (times - nearest))[:, None] / 0.04  # in units of the limit
        assert lowest_between(times, distances).min() == pytest.approx(1.0, abs=1.5e-4)
    assert np.hypot(0.04, 10 * (times - 0.50025)).min() > 0.04 + 7e-5


def test_between_samples_nothing_is_lower_where_values_jump_or_peak():
    times = np.array([0, 1, 2, 2, 3, 4.0])
    jump, peak = np.array([2, 1, 0, 2, 1, 2.0]), np.array([0, 1, 3, 3, 1, 0.0])
    lowest = lowest_between(times, np.column_stack([jump, peak]))
    np.testing.assert_array_equal(lowest[:, 1], peak)
    np.testing.assert_array_equal(lowest[:, 0], jump)


def test_between_samples_a_kink_is_looked_at_again():
    """Of two corners that are passed the nearer one changes between two samples: |t - 0.50026| + 0.03."""
    times = np.linspace(0.0, 1.0, 2001)
    states = np.column_stack([times, np.sin(times)])
    values = 0.03 + np.abs(states[:, :1] - 0.50026)
    (place,) = dips = dips_of(times, values)
    assert values.min() > 0.03 + 2e-4
    when, near = around(dips, times, states)
    np.testing.assert_allclose(near, np.column_stack([when, np.sin(when)]), atol=1e-12)
    assert (when >= times[place - 1]).all()
    assert (when < times[place + 1]).all()
    assert (0.03 + np.abs(near[:, 0] - 0.50026)).min() < 0.03 + 4e-5
    assert not len(dips_of(times, values + 1.0))  # far from the bound
    uneven = np.delete(times, place + 2)
    assert not len(dips_of(uneven, np.delete(values, place + 2, axis=0)))  # a step too wide
