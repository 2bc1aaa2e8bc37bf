"""Accelerations of the legs: against differences, in the replay, and where controls jump, which have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import nhpocp
from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.sequence import join
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.simulation import simulate
from nhpocp.outcome import Outcome
from nhpocp.pace import patient_horizon
from nhpocp.problem_file import read_text
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.claimed import claimed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp import multiple_shooting
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.orienting_platform import OrientingPlatform
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.verification.accelerations import second_differences
from nhpocp.verification.replay import replay, sample
from tests.conftest import PAPER_START, paper_problem

BOUND = Bound("leg_acceleration", "leg_accelerations", -120.0, 120.0)
SYSTEMS = [ThreeUPU(), ThreeUPU(form="original"), ParallelRobot(), OrientingPlatform()]
BASES = [Fourier(2), BSpline(1, 3), BSpline(3, 4)]


def moved(system, basis, horizon=0.7):
    """A path of a system under a small control, and the control."""
    asked = {"start": system.example["start"], "goal": system.example["goal"], "initial": None}
    problem = nhpocp.PlanningProblem(system=system, basis=basis, bounds=[BOUND], **asked)
    sizes = 0.2 * problem.scales.inputs[:, None]
    coefficients = sizes * np.random.default_rng(1).normal(size=(len(sizes), basis.size))
    control = Control(basis, coefficients, horizon)
    numeric = numeric_system(problem.system)
    return problem, control, replay(numeric, control, problem.start_point)


@pytest.mark.parametrize("basis", BASES, ids=lambda basis: f"{basis.kind} {basis.size}")
@pytest.mark.parametrize(
    "system", SYSTEMS, ids=lambda system: f"{system.model} {getattr(system, 'form', '')}"
)
def test_the_formula_is_what_differences_of_replayed_lengths_say(system, basis):
    problem, control, path = moved(system, basis)
    samples = sample(path, control, 101)
    trajectory = numeric_system(problem.system).trajectory(
        samples.states, samples.controls, problem.scale, samples.control_rates
    )
    exact = trajectory["leg_accelerations"]
    measured = second_differences(problem.system, path, samples.times, control)
    assert exact.shape == measured.shape
    np.testing.assert_allclose(measured, exact, atol=2e-6 * np.abs(exact).max())


def claim(control):
    """A plan of the paper's robot under a control, as a solver would hand it over."""
    problem = paper_problem(bounds=[BOUND])
    return claimed(problem, Continuation(), control, Outcome.CONVERGED, "", 0.0)


def test_a_jump_between_pieces_is_an_infinite_acceleration_and_refuted():
    half = Control(Fourier(2), PAPER_START, 0.5)
    back = Control(Fourier(2), -np.asarray(PAPER_START), 0.5)
    verdict = nhpocp.verify(claim(join([half, back])))
    assert any(
        "the legs' speeds jump at t=0.5, where leg_acceleration[" in reason for reason in verdict.reasons
    )
    (report,) = verdict.bounds
    assert not report.ok
    assert np.isinf(report.value)
    met = nhpocp.verify(claim(join([half, half])))  # a period after another
    assert np.isfinite(met.bounds[0].value)


def test_it_is_refused_in_words_where_controls_jump():
    text = (
        "nhpocp: 1\nsystem: {model: three_upu}\nstart: {position: [0, 0, 25], orientation: {rpy: [0, 0, 0]}}\n"
        "goal: {position: [0, 0, 35], orientation: {rpy: [0, 0, 1]}}\nconstraints: {leg_acceleration: 900}\n"
    )
    with pytest.raises(InvalidProblemError, match="piecewise_constant controls jump") as caught:
        read_text(text + "control: {basis: piecewise_constant}\n")
    assert caught.value.path == "constraints.leg_acceleration"
    with pytest.raises(InvalidProblemError, match="piecewise_constant controls jump"):
        nhpocp.solve(paper_problem(basis=PiecewiseConstant(4), initial=None, bounds=[BOUND]))
    with pytest.raises(InvalidProblemError, match="write control: basis"):
        nhpocp.solve(paper_problem(bounds=[BOUND]), build_solver("nlp", {"intervals": 5}))
    with pytest.raises(InvalidProblemError, match="the system unicycle has no legs"):
        read_text(
            "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\n"
            "goal: {x: 1, y: 1, theta: 0}\nconstraints: {leg_acceleration: 900}\n"
        )


def test_a_cure_is_found_for_a_bound_that_a_slower_motion_keeps():
    solution = replace(claim(paper_problem().control(PAPER_START)), outcome=Outcome.CONSTRAINT_VIOLATED)
    message = planning._with_a_cure(solution, None).message
    horizon = float(message.partition("keeps leg_acceleration was found for horizon: ")[2].rstrip("."))
    slower = planning.solve(solution.problem.with_(horizon=horizon), Continuation(step_rule=Adaptive()))
    assert slower.converged
    assert slower.verdict.bounds[0].ok


def test_a_guess_without_bounds_is_taken_over_only_where_it_keeps_them():
    solver, control = MultipleShooting(over_basis=True), paper_problem().control(PAPER_START)
    wide = paper_problem(bounds=[replace(BOUND, lower=-1e4, upper=1e4)])
    guess = claimed(paper_problem(), Continuation(), control, Outcome.CONVERGED, "", 0.0)
    failed = claimed(wide, solver, control, Outcome.STAGNATED, "", 1.0)
    taken = multiple_shooting._taken_over(failed, guess)
    assert taken.trajectory["leg_accelerations"].shape == (201, 3)
    narrow = paper_problem(bounds=[replace(BOUND, lower=-10.0, upper=10.0)])
    assert multiple_shooting._taken_over(replace(failed, problem=narrow), guess) is None
    jumping = replace(guess, control=join([replace(control, horizon=0.5), replace(control, horizon=0.5)]))
    assert multiple_shooting._taken_over(failed, jumping) is None


def test_the_pace_of_a_bound_on_accelerations_is_a_square_root():
    trajectory = {"t": np.array([0.0, 2.0]), "leg_accelerations": np.array([[480.0], [0.0]])}
    assert float(patient_horizon([BOUND], trajectory)) == pytest.approx(1.05 * 2 * 2, rel=1e-2)


def test_a_trajectory_names_them_where_they_are_bounded_and_nowhere_else(tmp_path):
    problem = paper_problem(bounds=[replace(BOUND, lower=-1e4, upper=1e4)], samples=11)
    solution = nhpocp.solve(problem, Continuation(step_rule=Adaptive()))
    assert solution.trajectory["leg_accelerations"].shape == (11, 3)
    nhpocp.save_solution(solution, tmp_path / "plan")
    read = nhpocp.load_solution(tmp_path / "plan")
    assert nhpocp.verify(read).ok
    assert "leg_accelerations_3,length per unit time²" in (tmp_path / "plan" / "columns.csv").read_text()
    assert "leg_accelerations" not in simulate(problem.with_(bounds=()), solution.control).trajectory
