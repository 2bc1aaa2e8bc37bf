"""The same robot and task in other units of length and time: the Jacobian method's plan is the same."""

from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
import pytest

from nhpocp import planning, so3
from nhpocp.constraints.bound import Bound
from nhpocp.controls.fourier import Fourier
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.generalized_inverses import Lagrangian
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler, Ode
from nhpocp.solvers.metrics import L2Metric
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.orienting_platform import OrientingPlatform
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.rolling_sphere import RollingSphere
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.systems.unicycle import Unicycle
from nhpocp.verification import verify
from nhpocp.via import Via
from tests.conftest import PAPER_START, yaw

UNITS = [pair for pair in product((1.0, 1e-3, 1e3), repeat=2) if pair != (1.0, 1.0)]
FAR = [(1e-3, 1e3), (1e3, 1e-3)]


@lru_cache
def geometry(s):
    return ThreeUPU(base_radius=30.0 * s, platform_radius=15.0 * s)


def robot(s=1.0, tau=1.0):
    return PlanningProblem(
        system=geometry(s),
        start={"position": [0, 0, 25 * s], "orientation": yaw(-np.pi / 6)},
        goal={"position": [-0.4 * s, -0.2 * s, 35 * s], "orientation": yaw(-np.pi / 2)},
        horizon=Horizon(tau),
        initial=PAPER_START / tau,
        error_length=s,
    )


def via(s=1.0, tau=1.0):
    return replace(robot(s, tau), via=[Via(0.37, {"position": [0, 0, 30 * s]})])


def drawn(s=1.0, tau=1.0):
    return replace(robot(s, tau), initial=None)


def unicycle(s=1.0, tau=1.0):
    """No length of its own, and inputs of two units."""
    initial = np.array([[0.5 * s, 0.0, -2.0 * s], [0.0, 3.0, 0.0]]) / tau
    return PlanningProblem(
        system=Unicycle(),
        start={"x": 1000.0 * s, "y": 0.0, "theta": 0.0},
        goal={"x": 1000.5 * s, "y": 2.0 * s, "theta": 0.3},
        basis=Fourier(1),
        initial=initial,
        horizon=Horizon(tau),
        error_length=s,
    )


def sphere(s=1.0, tau=1.0, contact="rubber"):
    return PlanningProblem(
        system=RollingSphere(radius=s, contact=contact),
        start={"position": [0, 0], "orientation": np.eye(3)},
        goal={"position": [s, 0.5 * s], "orientation": so3.from_rpy(np.array([0.3, 0.2, 0.8]))},
        horizon=Horizon(tau),
        error_length=s,
    )


def marble(s=1.0, tau=1.0):
    return sphere(s, tau, "marble")


def wrist(s=1.0, tau=1.0):
    sizes = {
        name: OrientingPlatform.declared[name].default
        for name in ("base_radius", "platform_radius", "height")
    }
    return PlanningProblem(
        system=OrientingPlatform(**{name: s * size for name, size in sizes.items()}),
        start={"orientation": np.eye(3)},
        goal={"orientation": so3.from_rpy(np.array([0.1, 0.1, 0.3]))},
        horizon=Horizon(tau),
        error_length=s,
    )


def mixed_legs(s=1.0, tau=1.0):
    places, given = ("base", "platform"), ParallelRobot.presets["mixed"]["legs"]
    legs = [leg | {place: s * np.array(leg[place]) for place in places if place in leg} for leg in given]
    return PlanningProblem(
        system=ParallelRobot(legs),
        start={"position": [0, 0, 25 * s], "orientation": yaw(-np.pi / 6)},
        goal={"position": [-0.4 * s, -0.2 * s, 30 * s], "orientation": yaw(-np.pi / 3)},
        horizon=Horizon(tau),
        error_length=s,
    )


def heisenberg(s=1.0, tau=1.0):
    """Numbers without a unit: only the time's changes."""
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    return PlanningProblem(system=Heisenberg(), start=zero, goal=zero | {"z": 1.0}, horizon=Horizon(tau))


BOUNDS = {
    "leg_speed": lambda s, tau: Bound("leg_speed", "u", -33.0 * s / tau, 33.0 * s / tau),
    "at zero": lambda s, tau: Bound("state.position", "position", -np.inf, [np.inf, 0.0, np.inf]),
    "control": lambda s, tau: Bound("control", "v", -1.4 / tau, 1.4 / tau),
}


def size_of_inputs(problem, tau):
    lengths = np.array(problem.system.input_space.tangent_units) == "length"
    return np.where(lengths, problem.scales.length, 1.0)[:, None] / tau


def plans(make, solver, units):
    """The control's coefficients, dimensionless, and the solution, in these units."""
    for s, tau in units:
        problem = make(s, tau)
        solution = solver.solve(problem)
        yield solution.control.coefficients / size_of_inputs(problem, tau), solution


def assert_the_same(make, solver, units):
    (plan, first), *others = plans(make, solver, [(1.0, 1.0), *units])
    assert first.outcome is Outcome.CONVERGED, first.message
    for other, solution in others:
        assert solution.outcome is first.outcome, solution.message
        assert abs(solution.evaluations - first.evaluations) <= 2
        np.testing.assert_allclose(other, plan, rtol=0, atol=1e-6 * np.abs(plan).max())
        assert solution.final_error == pytest.approx(first.final_error, rel=1e-4, abs=1e-9)
    return first, others[-1][1]


RULES = {
    "euler": Continuation(step_rule=Euler(0.5)),
    "adaptive": Continuation(step_rule=Adaptive()),
    "auto": Auto(),
}
OTHERS = {
    "l2": Continuation(step_rule=Adaptive(), metric=L2Metric()),
    "lagrangian": Continuation(step_rule=Euler(0.5), inverse=Lagrangian()),
}


@pytest.mark.parametrize("solver", RULES.values(), ids=RULES)
def test_the_continuation_takes_the_same_steps(solver):
    assert_the_same(robot, solver, UNITS)


@pytest.mark.parametrize("solver", OTHERS.values(), ids=OTHERS)
def test_other_metrics_and_inverses_do(solver):
    assert_the_same(robot, solver, FAR[:1])


@pytest.mark.parametrize("make", [via, drawn, unicycle, sphere, marble, wrist, mixed_legs, heisenberg])
def test_of_other_tasks_too(make):
    assert_the_same(make, Auto(), FAR[:1])


def test_the_ode_takes_the_same_steps():
    assert_the_same(robot, Continuation(step_rule=Ode(gamma=1.0, tolerance=1e-6)), FAR[:1])


@pytest.mark.parametrize("objective", ["effort", "leg_effort", "path_length"])
def test_the_null_space_ends_at_the_same_least_cost(objective):
    solver = Continuation(step_rule=Adaptive(), objective=objective)
    if objective == "effort":
        solver = Auto(solver)  # compares starts, whatever they cost
    first, last = assert_the_same(robot, solver, FAR)
    s, tau = FAR[-1]
    unit = {"effort": 1 / tau, "leg_effort": s**2 / tau, "path_length": s}[objective]
    assert last.details["objective_value"] == pytest.approx(unit * first.details["objective_value"], rel=1e-9)


def test_the_shortest_path_is_the_same_where_inputs_have_two_units():
    """(∫|u|² would be another cost in other units.)"""
    assert_the_same(marble, Continuation(step_rule=Adaptive(), objective="path_length"), FAR[:1])


@pytest.mark.parametrize("kind", BOUNDS.values(), ids=BOUNDS)
def test_bounds_are_kept_in_the_same_way(kind):
    def make(s=1.0, tau=1.0):
        return replace(robot(s, tau), bounds=[kind(s, tau)])

    first, last = assert_the_same(make, Continuation(step_rule=Adaptive(), objective="effort"), FAR[:1])
    reports = [verify(solution).bounds[0] for solution in (first, last)]
    assert all(report.ok for report in reports)
    scale = make(*FAR[0]).bounds[0].scale / make().bounds[0].scale
    assert reports[1].allowed == pytest.approx(scale * reports[0].allowed, rel=1e-6)


@pytest.mark.parametrize("s", [1e-4, 1.0, 1e3])
def test_a_bound_at_zero_is_kept_by_a_robot_of_any_size(s):
    """A free plan goes to 0.35 s; of a robot of 3 mm, in metres, that was within 1e-3 of 1."""
    free = planning.solve(robot(s), Continuation(step_rule=Adaptive()))
    assert free.converged
    beyond = float(free.trajectory["position"][:, 1].max())
    assert beyond > 0.05 * s
    problem = replace(robot(s), bounds=[BOUNDS["at zero"](s, 1.0)])
    verdict = verify(replace(free, problem=problem))
    assert not verdict.ok
    (report,) = verdict.bounds
    assert report.allowed == pytest.approx(1e-3 * 15 * s)
    assert f"more than the {report.allowed:.3g} allowed" in verdict.reasons[0]


def test_an_error_length_that_is_too_long_is_said():
    solution = planning.solve(replace(robot(1e-3), error_length=1.0))
    (warning,) = solution.warnings
    assert "the motion is 0.01; write error_length: 0.01" in warning
    assert "error_length: 1 is the length that counts as much as one radian" in warning
    assert not planning.solve(robot(1e-3)).warnings
