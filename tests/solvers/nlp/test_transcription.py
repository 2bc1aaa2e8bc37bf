"""The sparse matrices filled from interval blocks are the derivatives that CasADi makes of the whole programme."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from nhpocp.constraints.bound import Bound, bound_rows
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.flow.simulation import simulate
from nhpocp.horizon import Horizon
from nhpocp.solvers.nlp.guesses import ProblemGuess, follow, make_guess
from nhpocp.solvers.nlp.single_shooting import SingleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from nhpocp.solvers.nlp.transcription import Guess
from nhpocp.systems.numeric import NumericSystem
from nhpocp.via import Via
from tests.conftest import paper_problem, yaw

INTERVALS = 3
INTERPRETED = Interpreted()
POSITION = {"position": [0, 0, 30]}
POSE = {**POSITION, "orientation": yaw(-1.0)}
OUTPUTS = {"leg_lengths": [38, 39, 40], "platform_normal": [0.1, -0.1, 1]}
BOUNDS = {
    "leg_length": Bound("leg_length", "leg_lengths", 20.0, 60.0),
    "leg_speed": Bound("leg_speed", "u", -200.0, 200.0),
    "leg_acceleration": Bound("leg_acceleration", "leg_accelerations", -200.0, 200.0),
    "control": Bound("control", "v", [-1.0, -2.0, -np.inf], [1.0, np.inf, 3.0]),
    "sigma_s": Bound("clearance", "sigma_s", 0.05),
    "sigma_w": Bound("clearance", "sigma_w", 0.05),
    "state": Bound("state.position", "position", [-10, -10, 15], [10, 10, 45]),
}
ALL = [name for name in BOUNDS if name != "leg_acceleration"]  # which takes a basis without jumps
FAMILY = [
    {"bounds": ALL},
    {"bounds": ALL, "basis": Fourier(1), "steps": 2},
    {"bounds": ["leg_length", "leg_speed"], "steps": 6},
    {"basis": Fourier(2)},
    {"basis": Fourier(1), "bounds": ["leg_acceleration"], "via": [Via(0.4, POSITION)], "steps": 2},
    {"basis": BSpline(1, 2), "bounds": ["leg_acceleration", "control"], "horizon": Horizon(1.5, 0.5, 3.0)},
    {"objective": "leg_effort", "steps": 2},
    {"objective": "path_length", "basis": Fourier(1)},
    {"objective": "time", "horizon": Horizon(1.0, 0.5, 3.0), "bounds": ["control"]},
    {"horizon": Horizon(None, 0.5, 3.0), "basis": Fourier(2), "bounds": ["leg_speed"], "steps": 2},
    {"horizon": Horizon(1.5, 0.5, None), "objective": "leg_effort"},
    {"form": "original", "steps": 2, "bounds": ["leg_length"]},
    {"form": "original", "basis": Fourier(1), "objective": "path_length"},
    {"goal": {"position": [-0.4, -0.2, 35]}, "bounds": ["leg_length", "state"]},
    {"via": [Via(0.5, POSE)], "bounds": ["leg_speed"]},
    {"via": [Via(0.2, POSE), Via(1 / 3, POSITION)], "basis": Fourier(1), "steps": 2},
    {"via": [Via(0.4, POSITION), Via(0.45, OUTPUTS)], "horizon": Horizon(1.5, 0.5, None)},
    {"goal": OUTPUTS, "bounds": ["leg_length"]},
    {"goal": {**POSITION, "platform_normal": [0.1, 0, 1]}, "basis": Fourier(1), "via": [Via(2 / 3, OUTPUTS)]},
]


def transcribed(case, kind=StagedTranscription, way=INTERPRETED):
    """A programme of the family, and a vector near its guess."""
    case = dict(case)
    basis, steps = case.pop("basis", None), case.pop("steps", 1)
    bounds = [BOUNDS[name] for name in case.pop("bounds", [])]
    if case.get("form") == "original":
        case["initial"] = [[8.0, 3, 0, 1, 0], [10.0, 0, 2, 0, 0], [9.0, 1, 0, 0, 2]]  # leg speeds
    problem = paper_problem(**case)
    guess = make_guess(ProblemGuess(), problem, basis, INTERVALS, 0)
    programme = kind(problem, guess, basis, INTERVALS, steps, bounds, way)
    start = programme.pack(guess)
    return programme, guess, start + 0.01 * np.random.default_rng(0).normal(size=len(start))


def relative_gap(found, exact):
    found, exact = np.array(ca.densify(found)), np.array(ca.densify(exact))
    return np.abs(found - exact).max() / max(1.0, np.abs(exact).max())


@pytest.mark.parametrize("case", FAMILY, ids=str)
def test_the_filled_matrices_are_the_derivatives(case):
    programme, _, x = transcribed(case)
    functions, symbol, p = programme.functions, ca.MX.sym("x", programme.size), ca.MX(0, 1)
    multipliers = np.random.default_rng(1).normal(size=len(programme.rows))
    weights = ca.MX.sym("lam", len(multipliers))
    f, g = functions["nlp"](symbol, p)
    gradient, jacobian = ca.gradient(f, symbol), ca.jacobian(g, symbol)
    hessian = ca.triu(ca.hessian(0.7 * f + ca.dot(weights, g), symbol)[0])
    exact = ca.Function("exact", [symbol, weights], [f, g, gradient, jacobian, hessian])(x, multipliers)
    value, mine = functions["grad_f"](x, [])
    assert relative_gap(value, exact[0]) < 1e-12
    assert relative_gap(mine, exact[2]) < 1e-12
    values, matrix = functions["jac_g"](x, [])
    assert relative_gap(values, exact[1]) < 1e-12
    assert relative_gap(matrix, exact[3]) < 1e-12
    assert relative_gap(functions["hess_lag"](x, [], 0.7, multipliers), exact[4]) < 1e-12


@pytest.mark.parametrize("case", FAMILY, ids=str)
@pytest.mark.parametrize("kind", [StagedTranscription, SingleShooting])
def test_vectors_and_plans_turn_into_one_another(kind, case):
    programme, guess, x = transcribed(case, kind)
    once = programme.pack(programme.unpack(x))  # a plan has one set of coefficients, x one at every node
    np.testing.assert_allclose(programme.pack(programme.unpack(once)), once, atol=1e-10)
    plan = programme.unpack(programme.pack(guess))
    np.testing.assert_allclose(plan.control.coefficients, guess.control.coefficients, atol=1e-12)
    assert plan.control.horizon == pytest.approx(guess.control.horizon)
    if kind is StagedTranscription:
        np.testing.assert_allclose(plan.states, guess.states, atol=1e-5)  # the guess leaves SO(3)
        assert len(programme.lower) == len(programme.upper) == len(programme.rows)
        assert sum(programme.structure["ng"]) + sum(programme.structure["nx"][1:]) == len(programme.rows)


@pytest.mark.parametrize("basis", [None, Fourier(2)])
def test_a_followed_path_leaves_no_gap(basis):
    """The continuity rows are the RK4 that everybody else uses."""
    problem = paper_problem()
    guess = make_guess(ProblemGuess(), problem, basis, 20, 0)
    guess = Guess(follow(problem, guess.control, 20, 2), guess.control)
    programme = StagedTranscription(problem, guess, basis, 20, 2, [], INTERPRETED)
    _, constraints = programme.functions["nlp"](programme.pack(guess), [])
    gaps = np.array(constraints).ravel()[: -len(programme.terminal)]
    assert np.abs(gaps).max() < 1e-7  # the packed rotation leaves SO(3) by as much


def test_rows_are_named_with_their_times():
    programme, guess, _ = transcribed({"bounds": ["leg_length", "leg_speed"], "steps": 2})
    x = programme.pack(guess)
    values = np.array(programme.functions["nlp"](x, [])[1]).ravel()
    path = follow(programme.problem, guess.control, INTERVALS, 8)
    numeric = NumericSystem(programme.problem.system)
    for i, row in enumerate(programme.rows):
        node = row.time * INTERVALS
        if row.stated and row.name.startswith("leg_length") and abs(node - round(node)) < 1e-9:
            lengths = numeric.outputs(path[[round(node)]], np.zeros((1, 3)))["leg_lengths"][0]
            assert values[i] == pytest.approx(lengths[int(row.name[-2])], rel=1e-3)
    shares = sorted({row.time for row in programme.rows if row.name == "leg_speed[0]"})
    np.testing.assert_allclose(shares, np.arange(7) / 6)  # the control jumps: also where an interval starts
    assert min(row.time for row in programme.rows if row.name == "leg_length[0]") > 0
    names = {row.name for row in programme.rows if not row.stated}
    assert {"continuity of position[2] at node 3", "start of position[0]", "goal of orientation[2]"} <= names


@pytest.mark.parametrize(
    ("steps", "seen"), [(4, [0.25, 0.5, 0.75, 1]), (5, [0.4, 0.8, 1]), (16, [0.25, 0.5, 0.75, 1])]
)
def test_many_steps_do_not_make_many_rows(steps, seen):
    """Distances from obstacles at each of 16 steps took four fifths of an iteration."""
    programme, _, _ = transcribed({"bounds": ["leg_length"], "steps": steps})
    rows = {row.time * INTERVALS for row in programme.rows if row.name == "leg_length[0]"}
    np.testing.assert_allclose([time for time in sorted(rows) if time < 1.1], seen)


@pytest.mark.parametrize(
    ("basis", "horizon"),
    [(Fourier(2), Horizon(0.8)), (BSpline(2, 3), Horizon(0.8, 0.5, 3.0))],
    ids=["fixed", "free"],
)
def test_accelerations_of_legs_are_those_of_the_motion(basis, horizon):
    bound = BOUNDS["leg_acceleration"]
    problem = paper_problem(basis=basis, initial=None, horizon=horizon, bounds=[bound])
    random = np.random.default_rng(0)
    control = Control(basis, 0.5 * random.normal(size=(3, basis.size)), 0.8)
    guess = Guess(follow(problem, control, INTERVALS, 40), control)
    programme = StagedTranscription(problem, guess, basis, INTERVALS, 3, problem.bounds, INTERPRETED)
    values = np.array(programme.functions["nlp"](programme.pack(guess), [])[1]).ravel()
    motion = simulate(problem.with_(samples=INTERVALS + 1), control).trajectory["leg_accelerations"]
    rows = [
        (i, row) for i, row in enumerate(programme.rows) if row.stated and row.name.startswith(bound.label)
    ]
    seen = [(i, row) for i, row in rows if abs(row.time * INTERVALS - round(row.time * INTERVALS)) < 1e-9]
    assert {row.name for _, row in seen} == {f"leg_acceleration[{leg}]" for leg in range(3)}
    assert {round(row.time * INTERVALS) for _, row in seen} == {0, 1, 2, 3}
    for i, row in seen:
        there = motion[round(row.time * INTERVALS), int(row.name[-2])]
        assert values[i] * row.unit == pytest.approx(there, rel=1e-3, abs=1e-2)


def test_rows_that_the_goal_fixes_are_free():
    """Else lo = hi would stand twice among the equations at the goal."""
    equal = Bound("state.position", "position", [0.0, -10, 15], [0.0, 10, 45])
    problem = paper_problem(goal={"position": [0, 0, 35], "orientation": np.eye(3)})
    guess = make_guess(ProblemGuess(), problem, None, INTERVALS, 0)
    for kind in (StagedTranscription, SingleShooting):
        programme = kind(problem, guess, None, INTERVALS, 2, [equal], INTERPRETED)
        equal_rows = [row for row in programme.rows if row.name == "state.position[0]"]
        assert [row.time for row in equal_rows] == pytest.approx([1 / 3, 2 / 3, 1])  # not within an interval
        assert [(row.lower, row.upper) for row in equal_rows] == [(0, 0), (0, 0), (-np.inf, np.inf)]


def test_statics_are_carried_along():
    programme, guess, _ = transcribed({"basis": Fourier(1), "horizon": Horizon(2.0, 0.5, 3.0)})
    assert programme.interval.nodes == 6 + 9 + 1
    assert programme.unpack(programme.pack(guess)).control.horizon == 2.0
    assert programme.structure["nu"] == [0] * (INTERVALS + 1)


def test_a_control_over_another_grid_is_sampled_at_the_middles():
    programme, guess, _ = transcribed({})
    other = Control(PiecewiseConstant(1), [[1.0], [2.0], [3.0]], 1.0)
    plan = programme.unpack(programme.pack(Guess(guess.states, other)))
    np.testing.assert_allclose(plan.control.coefficients, np.array([[1.0], [2], [3]]) * np.ones(INTERVALS))


# --- clearance ----------------------------------------------------------------------------------------------


class Matrix:
    """A stand-in for a system whose regularity matrix is its state."""

    def __init__(self, size):
        self.size = size

    def regularity(self, state):
        return {"m": state}

    def column_scales(self, name, length_scale):
        return [1.0] * (self.size // 2) + [length_scale] * (self.size - self.size // 2)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3, 6]), st.floats(0.01, 2.0), st.floats(0.2, 5.0))
def test_leading_minors_say_whether_the_least_singular_value_is_large_enough(seed, size, clearance, scale):
    system = Matrix(size)
    matrix = np.random.default_rng(seed).normal(size=(size, size)) * 2
    least = np.linalg.svd(matrix / system.column_scales("m", scale), compute_uv=False)[-1]
    assume(abs(least - clearance) > 1e-4 * clearance)
    rows = bound_rows(Bound("clearance", "sigma_m", clearance), system, ca.DM(matrix), ca.DM(1, 1), scale)
    assert len(rows) == size
    assert all(float(minor) >= low for _, minor, low, _ in rows) == (least >= clearance)
