"""Replays of controls that jump, and the places where a determinant changes its sign."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import DOP853

import nhpocp.verification.replay as module
from nhpocp import planning
from nhpocp.arrays import namespace
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.controls.sequence import SequenceBasis
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.state_space import StateSpace, scalar
from nhpocp.systems.free_nilpotent_36 import FreeNilpotent36
from nhpocp.systems.heisenberg import Heisenberg
from nhpocp.systems.numeric import NumericSystem, numeric_system
from nhpocp.systems.rolling_sphere import RollingSphere
from nhpocp.systems.system import System
from nhpocp.systems.three_upu import ThreeUPU
from nhpocp.systems.unicycle import Unicycle
from nhpocp.verification.crossings import TOUCH, sign_changes, touches
from nhpocp.verification.fast_function import FastFunction
from nhpocp.verification.pieces import NODES, PROBES, in_pieces
from nhpocp.verification.replay import integrate, replay, sample
from tests.conftest import PAPER_START, paper_problem

X, U = ca.SX.sym("x"), ca.SX.sym("u")
INPUT = ca.Function("rate", [X, U], [U])


class Jump(Fourier):
    """-1 before t = 0.3, then 5 (1 + 0 t): two constants."""

    def __init__(self):
        super().__init__(0)

    def breakpoints(self, horizon):
        return np.array([0.3])

    def table(self, times, horizon, side="right"):
        times = np.asarray(times)
        return np.where((times > 0.3) | ((times == 0.3) & (side == "right")), 5.0, -1.0)[:, None]


class JumpingRamp(Jump):
    """-1 before t = 0.3, then 5 t."""

    def table(self, times, horizon, side="right"):
        table = super().table(times, horizon, side)
        return np.where(table > 0, table * np.asarray(times)[:, None], table)


@pytest.mark.parametrize(("basis", "end"), [(Jump(), 3.2), (JumpingRamp(), 1.975)])
def test_nothing_straddles_a_discontinuity(basis, end):
    """A control that jumps is integrated exactly, whether it is constant between the jumps or not."""
    path = integrate(INPUT, Control(basis, [[1.0]]), np.zeros(1))
    np.testing.assert_allclose(path([0.15, 0.3, 1.0])[:, 0], [-0.15, -0.3, end], atol=1e-14)
    assert path.at(0.3) == pytest.approx(-0.3, abs=1e-14)


def test_sampling_gives_both_sides_of_a_breakpoint():
    control = Control(Jump(), [[1.0]])
    samples = sample(integrate(INPUT, control, np.zeros(1)), control, 11)
    at_jump = samples.times == 0.3
    assert samples.controls[at_jump, 0].tolist() == [-1.0, 5.0]


BASES = [
    *(Fourier(0), Fourier(1), Fourier(30), PiecewiseConstant(1), PiecewiseConstant(7), JumpingRamp()),
    *(Legendre(7), Legendre(8), BSpline(1, 4), BSpline(3, 1), BSpline(3, 9), BSpline(9, 3)),
    SequenceBasis((Fourier(2), BSpline(2, 3)), (0.3, 0.7)),
]


@pytest.mark.parametrize("basis", BASES, ids=lambda basis: f"{type(basis).__name__} {basis.size}")
@pytest.mark.parametrize("horizon", [0.4, 1.0, 3.0])
def test_inputs_on_a_piece_are_the_controls(basis, horizon):
    coefficients = np.random.default_rng(0).normal(size=(2, basis.size))
    control = Control(basis, coefficients, horizon)
    pieces = next(in_pieces(control))
    assert pieces.ends.tolist() == np.unique([0.0, *control.breakpoints, horizon]).tolist()
    for k, (first, last) in enumerate(pairwise(pieces.ends)):
        inputs = pieces.inputs(k)
        times = np.linspace(first, last, 12)
        expected = np.vstack([control(times[:-1]), control(times[-1:], "left")])
        np.testing.assert_allclose(inputs(times), expected, atol=1e-14)


@pytest.mark.parametrize("kind", [PiecewiseConstant, partial(BSpline, 3)], ids=["constants", "splines"])
def test_a_polynomial_piece_is_tabulated_once(kind):
    """The law of what a replay costs, in place of a stopwatch."""
    looked = []
    basis = kind(intervals=20)

    class Counting(type(basis)):
        def local_table(self, times, horizon, side="right"):
            looked.append(len(times))
            return super().local_table(times, horizon, side)

    problem, counted = paper_problem(), Counting(**basis.parameters())
    control = Control(counted, project(Control(Fourier(2), PAPER_START), basis).coefficients)
    replay(NumericSystem(problem.system), control, problem.start_point)
    assert looked == [20 * (len(NODES) + len(PROBES))]


def _unicycle():
    return PlanningProblem(system=Unicycle(), start=Unicycle.example["start"], goal=Unicycle.example["goal"])


@pytest.mark.parametrize(("problem", "jolt"), [(_unicycle, 1e4), (paper_problem, 1e3)])
def test_many_short_pieces_lead_where_dop853_does_one_by_one(problem, jolt, monkeypatch):
    """In between too; no table is as wide as the control is long."""
    basis = PiecewiseConstant(1100)

    def forbidden(*arguments):
        raise AssertionError("a full table of a control of many pieces")

    monkeypatch.setattr(PiecewiseConstant, "table", forbidden)
    times, found = (np.arange(1100) + 0.5) / 1100, problem()
    values = [0.3 * np.sin(5 * times + k) for k in range(found.system.input_space.size)]
    values[-1][700] *= jolt  # a piece that takes more than a step
    control, numeric = Control(basis, values), NumericSystem(found.system)
    together = replay(numeric, control, found.start_point)
    monkeypatch.setattr(module, "MANY", 2000)
    one_by_one = replay(numeric, control, found.start_point)
    assert len(one_by_one.times) == len(together.times) > 1101
    assert together.reached == one_by_one.reached == control.horizon
    inside = np.linspace(0.0, 1.0, 777)
    np.testing.assert_allclose(together(inside), one_by_one(inside), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    "basis", [PiecewiseConstant(200), Fourier(40), Fourier(1)], ids=lambda basis: basis.kind
)
def test_a_path_of_many_steps_is_followed_to_its_end(basis, monkeypatch):
    """However many pieces a control has, and however fast it turns: both add to what is allowed."""
    monkeypatch.setattr(module, "MOST_STEPS", 50)
    coefficients = np.zeros((1, basis.size))
    coefficients[0, -2:] = 1.0
    path = integrate(INPUT, Control(basis, coefficients), np.zeros(1))
    assert path.stopped is None
    assert path.reached == 1.0
    expected = Control(basis, coefficients)((np.arange(4000) + 0.5) / 4000).mean(
        axis=0
    )  # exact for each of these
    np.testing.assert_allclose(path.at(1.0), expected, atol=1e-9)


@pytest.mark.parametrize("basis", [Fourier(2), Legendre(40), PiecewiseConstant(3)], ids=lambda b: b.kind)
@pytest.mark.parametrize("problem", [_unicycle, paper_problem])
def test_every_step_is_scipys(problem, basis):
    """Their number, where they end, as far as what rounds in estimates of 1e-12 lets it, and the states between."""
    found = problem()
    size = found.system.input_space.size, basis.size
    control = Control(basis, 0.3 * np.random.default_rng(3).normal(size=size))
    numeric, begin = NumericSystem(found.system), found.start_point
    path = replay(numeric, control, begin)
    assert path.reached == 1.0
    rate, state, taken = FastFunction(numeric.rate_function), begin, 0
    for first, last in pairwise([0.0, *control.breakpoints, 1.0]):
        inputs = lambda t, end=last: control([min(t, end)], "left" if t >= end else "right")[0]  # noqa: E731
        slope = lambda t, x, inputs=inputs: rate(x, inputs(t))  # noqa: E731
        step = min(last - first, module.FIRST_STEP)
        solver = DOP853(slope, first, state, last, rtol=module.RTOL, atol=module.ATOL, first_step=step)
        while solver.status == "running":
            solver.step()
            taken += 1
            assert path.times[taken] == pytest.approx(solver.t, abs=0.01 * solver.step_size)
            between = solver.t_old + np.array([0.2, 0.7, 1.0]) * solver.step_size
            expected = solver.dense_output()(between).T
            np.testing.assert_allclose(path(between), expected, rtol=1e-11, atol=1e-14)
        state = solver.y
    assert len(path.times) == taken + 1


def test_a_path_that_needs_too_many_steps_is_said_to():
    """ẋ = cos(1e6 t) has no step that is too short, only too many."""
    state = ca.SX.sym("x", 2)  # whose second number is the time
    rate = ca.Function("rate", [state, U], [ca.vertcat(ca.cos(1e6 * state[1]), 1)])
    path = integrate(rate, Control(Fourier(0), [[0.0]]), np.zeros(2))
    assert path.stopped == "5020 steps were not enough for the smooth piece from t=0 to 1"
    assert 0 < path.reached < 1


def test_equal_pieces_lead_where_one_constant_does():
    problem, constant = paper_problem(), np.array([[0.2], [-0.1], [1.0]])
    numeric = NumericSystem(problem.system)
    controls = [Control(basis, np.tile(constant, basis.size)) for basis in (Fourier(0), PiecewiseConstant(9))]
    whole, parts = (replay(numeric, control, problem.start_point).at(1.0) for control in controls)
    np.testing.assert_allclose(parts, whole, atol=1e-11)


@pytest.mark.parametrize("zeros", [[0.123456789], [0.5], [0.501, 0.5013], [0.2, 0.7, 0.71]])
def test_sign_changes_are_found_to_nine_digits(zeros):
    def function(t):
        return float(np.prod([t - zero for zero in zeros]))

    times = np.linspace(0, 1, 101)  # 0.5 is a sample; 0.501 and 0.5013 fall between two
    found = sign_changes(function, times, np.array([function(t) for t in times]))
    np.testing.assert_allclose(found, zeros, atol=1e-9)


def test_touching_zero_is_no_change_of_sign():
    times = np.linspace(0, 1, 101)
    assert sign_changes(lambda t: (t - 0.503) ** 2 + 1e-9, times, (times - 0.503) ** 2 + 1e-9) == []


@pytest.mark.parametrize("zero", [0.0, 0.5, 0.50321, 0.505, 1.0])
@pytest.mark.parametrize("shape", [abs, np.square], ids=["corner", "parabola"])
def test_a_touch_is_found_once_wherever_it_lies(zero, shape):
    def function(t):
        return float(shape(3.0 * (t - zero)))

    times = np.linspace(0, 1, 101)
    values = np.array([function(t) for t in times])
    (found,) = touches(function, times, values)
    assert found == pytest.approx(zero, abs=1e-4 if shape is np.square else 3e-8)
    assert touches(function, times, values, crossed=[zero]) == []  # it is known by another name


@pytest.mark.parametrize("zero", [0.0, 0.5, 0.50321, 1.0])
@pytest.mark.parametrize("shape", [abs, np.square], ids=["corner", "parabola"])
def test_what_only_comes_near_is_no_touch(zero, shape):
    def function(t):
        return float(shape(3.0 * (t - zero))) + 1.01 * TOUCH

    times = np.linspace(0, 1, 101)
    assert touches(function, times, np.array([function(t) for t in times])) == []


def test_stretches_of_zeros_are_one_touch_each():
    def function(t):
        return max(0.0, abs(t - 0.2) - 0.1) * max(0.0, abs(t - 0.7) - 0.1)

    times = np.linspace(0, 1, 101)
    first, second = touches(function, times, np.array([function(t) for t in times]))
    assert 0.0999 < first < 0.3001
    assert 0.5999 < second < 0.8001
    assert len(touches(lambda t: 0.0, times, np.zeros(101))) == 1


# --- units of time ------------------------------------------------------------------------------------------


class DoubleIntegrator(System):
    """q̈ = u, which drifts."""

    model = "double_integrator"
    state_space = StateSpace([scalar("q"), scalar("rate")])
    input_space = StateSpace([scalar("u")])

    def vector_fields(self, state):
        return np.array([[0.0], [1.0]])

    def drift(self, state):
        return namespace(state).vector([state[1], 0.0 * state[0]])


def at_rest(system):
    """A state of zeros, as far as it can be one."""
    start = {block.name: np.zeros(block.shape) for block in system.state_space.blocks}
    for block in system.state_space.blocks:
        if block.kind == "rotation":
            start[block.name] = np.eye(3)
    if isinstance(system, ThreeUPU):
        start["position"] = np.array([0.0, 0.0, 25.0])
    return start


ALIKE = [Heisenberg(), Unicycle(), FreeNilpotent36(), RollingSphere(), ThreeUPU(), DoubleIntegrator()]


@pytest.mark.parametrize("basis", [Fourier(2), PiecewiseConstant(20)], ids=["smooth", "pieces"])
@pytest.mark.parametrize("system", ALIKE, ids=lambda system: system.model)
def test_the_end_does_not_depend_on_the_unit_of_time(system, basis):
    """u(t/T)/T ends where u(t) does, from 1e-6 to 1e8; with drift, u(t/T)/T² with rates that are 1/T."""
    coefficients = 0.5 * np.random.default_rng(1).normal(size=(system.input_space.size, basis.size))
    start, ends, power = at_rest(system), [], 1 if system.driftless else 2
    for horizon in (1.0, 1e-6, 1e-3, 1e5, 1e8):
        problem = PlanningProblem(system=system, start=start, goal=start, horizon=Horizon(horizon))
        control = Control(basis, coefficients / horizon**power, horizon)
        path = replay(numeric_system(system), control, problem.start_point, problem.scales.points)
        assert path.stopped is None
        ends.append(path.at(horizon) * ([1.0, horizon] if power == 2 else 1.0))
    np.testing.assert_allclose(ends[1:], [ends[0]] * 4, rtol=0, atol=1e-11)


@pytest.mark.parametrize("horizon", [1e-6, 1e5, 1e8])
@pytest.mark.parametrize("system", [Heisenberg(), Unicycle()], ids=lambda system: system.model)
def test_a_plan_is_confirmed_in_every_unit_of_time(system, horizon):
    start = at_rest(system)
    goal = {**start, system.state_space.names[1]: 0.5}
    initial = np.array([[0.5, 0.0, -2.0], [0.0, 3.0, 0.0]]) / horizon
    problem = PlanningProblem(
        system=system, start=start, goal=goal, basis=Fourier(1), initial=initial, horizon=Horizon(horizon)
    )
    solution = planning.solve(problem)
    assert solution.converged, (solution.message, solution.verdict.reasons)


def test_crossings_are_found_in_every_unit_of_time():
    for horizon in (1e-6, 1.0, 1e8):
        times = horizon * np.linspace(0, 1, 11)
        function = lambda t, T=horizon: (t / T - 0.72) ** 2 - 1e-6  # noqa: E731
        zeros = np.array(sign_changes(function, times, np.array([function(t) for t in times])))
        np.testing.assert_allclose(zeros / horizon, [0.719, 0.721], rtol=1e-9)
