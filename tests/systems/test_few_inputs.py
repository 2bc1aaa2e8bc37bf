"""Systems with one input, with none and with one state, through every solver, kernel, file and picture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

import nhpocp
from nhpocp.arrays import namespace
from nhpocp.constraints.bound import Bound
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import control_from_json, registry
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.single_shooting import SingleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from nhpocp.state_space import StateSpace, rotation, scalar
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.system import Parameter, System
from nhpocp.views.animation import animate_runs
from nhpocp.views.figures import write_pictures
from tests.conftest import yaw


class Cart(System):
    """q̈ = u, the double integrator."""

    model: ClassVar[str] = "cart"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([scalar("q", "length"), scalar("s", "length")])
    input_space = StateSpace([scalar("u", "length")])

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).matrix([[0.0], [1.0]])

    def drift(self, state: Any) -> Any:
        return namespace(state).vector([state[1], 0.0])


class Slider(System):
    """q̇ = u: one state, one input, no drift."""

    model: ClassVar[str] = "slider"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([scalar("q")])
    input_space = StateSpace([scalar("u")])

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).matrix([[1.0]])


class Spinner(System):
    """ω = (u, 0, 1): a rotation under drift with one input."""

    model: ClassVar[str] = "spinner"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([rotation("orientation")])
    input_space = StateSpace([scalar("u", "angle")])

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).matrix([[1.0], [0.0], [0.0]])

    def drift(self, state: Any) -> Any:
        return namespace(state).vector([0.0, 0.0, 1.0])


class Stone(Cart):
    """q̈ = -1: no input."""

    model: ClassVar[str] = "stone"
    input_space = StateSpace([])

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).array(np.zeros((2, 0)))

    def drift(self, state: Any) -> Any:
        return namespace(state).vector([state[1], -1.0])


class Clock(System):
    """q̇ = 1: one state, no input."""

    model: ClassVar[str] = "clock"
    declared: ClassVar[Mapping[str, Parameter]] = {}
    state_space = StateSpace([scalar("q")])
    input_space = StateSpace([])

    def vector_fields(self, state: Any) -> Any:
        return namespace(state).array(np.zeros((1, 0)))

    def drift(self, state: Any) -> Any:
        return namespace(state).vector([1.0])


def problem(system: System, start: Any, goal: Any, **changes: Any) -> PlanningProblem:
    return PlanningProblem(system=system, start=start, goal=goal, **{"pictures": False, **changes})


AT_REST = {"q": 0.0, "s": 0.0}
TURN = nhpocp.so3.from_rpy(np.array([0.3, 0.2, 0.9]))
# every one with its least effort for T = 1; no state's value can be had for less
ONE_INPUT = {
    "cart": (Cart(), {"q": -1.0, "s": 0.0}, AT_REST, 12.0),
    "slider": (Slider(), {"q": 0.0}, {"q": 2.0}, 4.0),
    "spinner": (Spinner(), {"orientation": np.eye(3)}, {"orientation": TURN}, None),
}
NO_INPUT = {  # at the goal after T = 1
    "stone": (Stone(), AT_REST, {"q": -0.5, "s": -1.0}),
    "clock": (Clock(), {"q": 0.0}, {"q": 1.0}),
}
NLPS = {
    f"{kind.__name__} {optimizer.kind}{' over the basis' if over_basis else ''}": MultipleShooting(
        intervals=8, transcription=kind, optimizer=optimizer, over_basis=over_basis
    )
    for kind in (StagedTranscription, SingleShooting)
    for optimizer in (Ipopt(), Fatrop())
    for over_basis in (False, True)
    if not (kind is SingleShooting and optimizer.kind == "fatrop")
}
JACOBIANS = {
    rule: build_solver("jacobian", {"step_rule": rule, "objective": "effort"})
    for rule in ("auto", "adaptive")
}
SOLVERS = {**NLPS, **JACOBIANS}


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("model", ONE_INPUT)
def test_one_input_is_enough(model, name):
    system, start, goal, least = ONE_INPUT[model]
    solution = nhpocp.solve(problem(system, start, goal, basis=PiecewiseConstant(8)), SOLVERS[name])
    assert solution.converged, solution.message
    if least:  # 8 values cost O(1/64) more than the best control
        assert least - 1e-6 <= solution.costs["effort"] <= 1.02 * least


FINE = {  # 100 values of the control
    "nlp": build_solver("nlp", {"intervals": 100}),
    "single shooting": build_solver("nlp", {"intervals": 100, "shooting": "single"}),
    "fatrop": build_solver("nlp", {"intervals": 100, "plugin": "fatrop"}),
    "jacobian": build_solver("jacobian", {"step_rule": "auto", "objective": "effort"}),
}


@pytest.mark.parametrize("name", FINE)
def test_least_efforts_of_the_double_integrator(name):
    """∫ u² = 12 to rest; Bryson and Denham's problem with q ≤ 1/9 costs 4/(9 q) · 2 = 8. [Bryson, Ho, §3.11]"""
    system, start, goal, _ = ONE_INPUT["cart"]
    basis = PiecewiseConstant(100)
    free = nhpocp.solve(problem(system, start, goal, basis=basis), FINE[name])
    assert free.converged, free.message
    assert free.costs["effort"] == pytest.approx(12.0, rel=2e-3)
    bounds = [Bound("state.q", "q", upper=1 / 9)]
    there_and_back = problem(system, {"q": 0, "s": 1}, {"q": 0, "s": -1}, basis=basis, bounds=bounds)
    bounded = nhpocp.solve(there_and_back, FINE[name])
    assert bounded.converged, bounded.message
    assert bounded.costs["effort"] == pytest.approx(8.0, rel=2e-3)


def test_one_motor_moves_a_platform_along_a_curve():
    """Two of three legs are bars: J has one column of use, and a goal beside the curve is not reached, in words."""
    start = {"position": np.array([0.0, 0.0, 25.0]), "orientation": yaw(-np.pi / 6)}
    prismatic, *others = ParallelRobot.presets["mixed"]["legs"]
    bars = [{**leg, "length": length_of(leg, start)} for leg in others]
    machine = ParallelRobot([prismatic, *bars])
    assert machine.input_space.size == 1
    basis, first = PiecewiseConstant(4), np.full((1, 4), 2.0)
    task = problem(machine, start, {"position": [0.0, 0.0, 26.0]}, basis=basis, initial=first)
    for solver, outcome in (AUTO, Outcome.NOT_REACHED), (EULER, Outcome.RANK_DEFICIENT):
        aside = nhpocp.solve(task, solver)
        assert aside.outcome is outcome, aside.message


AUTO = replace(build_solver("jacobian", {"step_rule": "auto", "max_iterations": 5, "steps": 10}), restarts=0)
EULER = build_solver("jacobian", {"step_rule": "euler", "steps": 10})


@pytest.mark.parametrize("basis", [Fourier(2), Legendre(3), BSpline(2, 4), PiecewiseConstant(3)])
def test_a_control_of_no_inputs_is_written_and_read(basis):
    control = Control(basis, np.zeros((0, basis.size)), 2.0)
    again = control_from_json(json.loads(json.dumps(control.to_json())))
    assert again(np.array([0.1, 1.9])).shape == (2, 0)
    assert again.to_json() == control.to_json()


def length_of(leg: Mapping[str, Any], pose: Mapping[str, Any]) -> float:
    """The distance of a leg's joints."""
    joint = pose["position"] + pose["orientation"] @ np.array(leg["platform"])
    return float(np.linalg.norm(joint - np.array(leg["base"])))


@pytest.mark.parametrize("name", NLPS)
@pytest.mark.parametrize("model", ["cart", "slider"])
def test_one_input_with_a_free_horizon_takes_all_the_time_it_may(model, name):
    system, start, goal, _ = ONE_INPUT[model]
    free = problem(
        system, start, goal, basis=Fourier(1), initial=np.ones((1, 3)), horizon=Horizon(1.0, 0.5, 2.0)
    )
    solution = nhpocp.solve(free, NLPS[name])
    assert solution.converged, solution.message
    assert solution.control.horizon == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("objective", ["time", "path_length"])
def test_one_input_under_bounds_for_other_objectives(objective):
    system, start, goal, _ = ONE_INPUT["cart"]
    bounds = [Bound("control", "u", -4.0, 4.0)]
    free = problem(system, start, goal, objective=objective, bounds=bounds, horizon=Horizon(1.5, 0.5, 2.0))
    solution = nhpocp.solve(free, MultipleShooting(intervals=20))
    assert solution.converged, solution.message
    if objective == "time":  # bang-bang: 2 √(1/4)
        assert solution.control.horizon == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("model", NO_INPUT)
def test_without_inputs_the_drift_decides(model, name):
    system, start, goal = NO_INPUT[model]
    solution = nhpocp.solve(problem(system, start, goal), SOLVERS[name])
    assert solution.converged, solution.message
    assert solution.costs["effort"] == 0
    elsewhere = nhpocp.solve(problem(system, start, {"q": 3.0}), SOLVERS[name])
    assert elsewhere.outcome is Outcome.NOT_REACHED
    assert f"{model} has no inputs" in elsewhere.message


@pytest.mark.parametrize("name", NLPS)
def test_without_inputs_the_time_may_be_chosen(name):
    solution = nhpocp.solve(
        problem(Stone(), AT_REST, {"q": -2.0, "s": -2.0}, horizon=Horizon(1.0, 0.5, 5.0)), NLPS[name]
    )
    assert solution.converged, solution.message
    assert solution.control.horizon == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("model", ["slider", "stone"])
def test_kernels_and_casadi_agree_on_few_inputs(model):
    system, start, goal, *_ = {**ONE_INPUT, **NO_INPUT}[model]
    task = problem(system, start, goal)
    efforts = [
        nhpocp.solve(task, MultipleShooting(intervals=6, steps_per_interval=1, kernels=kernels)).costs[
            "effort"
        ]
        for kernels in (Compiled(), Interpreted())
    ]
    assert efforts[0] == pytest.approx(efforts[1], rel=1e-9)


@pytest.mark.parametrize("model", ["slider", "stone"])
def test_few_inputs_are_kept_and_drawn(model, tmp_path, monkeypatch):
    system, start, goal, *_ = {**ONE_INPUT, **NO_INPUT}[model]
    monkeypatch.setitem(registry.SYSTEMS.lines, model, f"{__name__}:{type(system).__name__}")
    nlp = replace(NLPS["StagedTranscription ipopt"], intervals=4)
    task = problem(system, start, goal, samples=11, solvers={"jacobian": JACOBIANS["adaptive"], "nlp": nlp})
    compared = nhpocp.compare([task])
    for entry in compared.entries:
        folder = nhpocp.save_solution(entry.solution, tmp_path / entry.solution.solver)
        again = nhpocp.load_solution(folder)
        assert nhpocp.verify(again).ok == entry.solution.converged
        np.testing.assert_array_equal(again.control(0.3), entry.solution.control(0.3))
    written = write_pictures(entry.solution, tmp_path, ["svg"])
    assert {"controls", "robot"} <= {file.stem for file in written}
    assert nhpocp.write_report(compared, tmp_path / "report.html").stat().st_size > 1000
    assert animate_runs(compared.entries, tmp_path / "animation.html")
