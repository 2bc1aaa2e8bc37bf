"""Laws of every system: those of the registry join by themselves, with the problem of the library as a place to stand.

A new system's line here is one in `VARIANTS`, for parameters that change its equations.
"""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nhpocp import provenance
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled import kernel_build
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import load_problem, parse_problem, starter
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.systems.numeric import _least_along, numeric_system
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.verification import geometry
from nhpocp.verification.replay import replay
from nhpocp.views.drawing import split_name
from tests.conftest import Turntable
from tests.ferry import Ferry

LIBRARY = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
VARIANTS: dict[str, dict[str, Any]] = {
    "three_upu": {"form": "original"},
    "heisenberg": {"scale": -0.5},
    "rolling_sphere": {"contact": "marble", "radius": 2.0},
    "parallel_robot": ParallelRobot.presets["braced"],  # a bar, so that five of six dimensions can be reached
    "orienting_platform": {"joint": "suslov", "r": [0.2, -0.1, 1.0], "height": 15.0},
}
DRIFTING = {
    "a ferry": (Ferry(), {"position": [0.3, -0.2], "theta": 0.4}),
    "a turntable": (Turntable(), {"angle": 0.2, "orientation": np.eye(3)}),
}
CASES = [*SYSTEMS, *(f"{model}, other parameters" for model in VARIANTS), *DRIFTING]
DRIFTLESS = [case for case in CASES if case not in DRIFTING]
BASIS = Fourier(2)


@cache
def library() -> dict[str, PlanningProblem]:
    """A problem of the library for each model that has one."""
    found: dict[str, PlanningProblem] = {}
    for file in LIBRARY:
        problem = load_problem(file)
        found.setdefault(problem.system.model, problem)
    return found


@cache
def problem_of(case: str) -> PlanningProblem:
    """Where a case stands: start and size of the library's problem, with the basis of these tests."""
    if case in DRIFTING:
        system, start = DRIFTING[case]
        return PlanningProblem(system=system, start=start, goal=start, basis=BASIS)
    model, _, other = case.partition(",")
    known = library()[model]
    system = system_class(model)(**VARIANTS[model]) if other else known.system
    held = system.invariants(known.start_point)
    goal = {k: v for k, v in known.start.items() if k == "position"} if held else known.start
    return PlanningProblem(system=system, start=known.start, goal=goal, basis=BASIS)


@pytest.fixture(params=CASES)
def problem(request) -> PlanningProblem:
    return problem_of(request.param)


def random_state(problem: PlanningProblem, seed: int) -> np.ndarray:
    """A point around the start: the mechanism's own length and 0.3 rad apart in every direction."""
    space, random = problem.system.state_space, np.random.default_rng(seed)
    scales = np.where(np.array(space.tangent_units) == "length", 0.2 * problem.scale, 0.3)
    return np.asarray(space.retract(problem.start_point, scales * random.standard_normal(space.dimension)))


def random_control(problem: PlanningProblem, seed: int, horizon: float = 1.0) -> Control:
    return Control(BASIS, drawn(problem, np.random.default_rng(seed)), horizon)


def exact(problem: PlanningProblem, control: Any, horizon: float, start: Any = None) -> np.ndarray:
    """x(T) by SciPy; ``control``: t ↦ u."""
    rate = numeric_system(problem.system).rate_function
    start = problem.start_point if start is None else start
    found = solve_ivp(
        lambda t, x: np.array(rate(x, control(t))).ravel(),
        (0.0, horizon),
        start,
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    return found.y[:, -1]


def at(control: Control) -> Any:
    return lambda t: control(np.array([t]))[0]


def apart(found: Any, expected: Any, scale: float = 1.0) -> float:
    return float(np.abs(np.asarray(found) - np.asarray(expected)).max()) / max(
        scale, float(np.abs(np.asarray(expected)).max())
    )


# --- what a system declares -------------------------------------------------------------------------------------------


def test_every_model_has_a_problem_in_the_library():
    assert set(library()) == set(SYSTEMS)


def test_names_and_parameters_come_without_casadi():
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from nhpocp.problem_file import systems, starter, json_schema; "
            "[starter(model) for model in systems()]; json_schema(); "
            "print([name for name in ('casadi', 'scipy') if name in sys.modules])",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("model", SYSTEMS)
def test_declarations_fit_the_class(model):
    cls = system_class(model)
    system = cls()
    assert cls.model == model
    assert set(system.parameters()) <= set(cls.declared)
    assert parse_problem(starter(model)).system.parameters() == system.parameters()


def test_parameters_make_the_same_system(problem):
    system = problem.system
    again = type(system)(**system.parameters())
    assert again.parameters() == system.parameters()
    state, control = random_state(problem, 1), random_control(problem, 1)(np.array([0.3]))[0]
    np.testing.assert_array_equal(again.velocity(state, control), system.velocity(state, control))


def test_outputs_are_those_declared(problem):
    system, state = problem.system, random_state(problem, 2)
    outputs = system.outputs(state, np.ones(system.input_space.size))
    assert set(outputs) == set(system.known_outputs or ())
    for block in system.output_blocks or ():
        assert np.shape(outputs[block.name]) == block.shape
    for block in system.pose_outputs:
        assert (
            apart(system.output(block.name, state, np.zeros(system.input_space.size)), outputs[block.name])
            == 0
        )


def test_drawings_are_plain_arrays_of_one_dimension(problem):
    drawn_here = problem.system.drawing(random_state(problem, 3))
    items = [*drawn_here["lines"].values(), *drawn_here["points"].values()]
    for name, solid in drawn_here.get("solids", {}).items():
        items.append(np.reshape(solid["ends"] if "ends" in solid else [solid["centre"]], (-1, 3)))
        assert solid["radius"] > 0, name
        if "rotation" in solid:
            np.testing.assert_allclose(solid["rotation"].T @ solid["rotation"], np.eye(3), atol=1e-12)
        kinds = {split_name(other)[0] for other in (*drawn_here["lines"], *drawn_here["points"])}
        assert set(solid["replaces"]) <= kinds | {"spheres", "universal joints"}
    trace = drawn_here.get("trace")
    items += [np.reshape(trace, (1, -1))] if trace is not None else []
    assert {np.shape(item)[1] for item in items} <= {2, 3}
    assert len({np.shape(item)[1] for item in items}) <= 1
    assert all(np.isfinite(np.asarray(item, dtype=float)).all() for item in items)


# --- the equations ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_numbers_and_symbols_move_alike(problem, seed):
    """ẋ = f + G u, by NumPy and by CasADi."""
    system, state = problem.system, random_state(problem, seed)
    control = random_control(problem, seed)(np.array([0.2]))[0]
    velocity = system.velocity(state, control)
    affine = system.drift(state) + system.vector_fields(state) @ control
    size = np.abs(velocity).max()
    assert apart(affine, velocity, size) < 1e-12
    rate = numeric_system(system).rate_function(state, control).full().ravel()
    assert apart(rate, system.state_space.lift(state, velocity), size) < 1e-12
    assert system.driftless == (not np.any(system.drift(state)))


@pytest.mark.parametrize("seed", [0, 1])
def test_linearised_is_the_derivative(problem, seed):
    numeric, n = numeric_system(problem.system), problem.system.state_space.size
    state, control = random_state(problem, seed), random_control(problem, seed)(np.array([0.4]))[0]
    point = np.concatenate([state, control])
    jacobian = numeric.linearised_function(state, control).full()
    step = 1e-3 * max(1.0, problem.scale / 15)

    def rate(values: np.ndarray) -> np.ndarray:
        return numeric.rate_function(values[:n], values[n:]).full().ravel()

    for column, direction in enumerate(np.eye(len(point))):
        weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}  # eighth-order central difference
        difference = sum(
            w * (rate(point + k * step * direction) - rate(point - k * step * direction))
            for k, w in weights.items()
        )
        assert apart(jacobian[:, column], difference / step, np.abs(jacobian).max()) < 1e-8


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_motions_keep_the_constraints(problem, seed):
    """The path is differenced, and what geometry says of its velocity has to vanish: G is not asked."""
    system, space = problem.system, problem.system.state_space
    control = random_control(problem, seed)
    path = replay(numeric_system(system), control, problem.start_point)
    times = np.linspace(0.05, 0.95, 19)
    if geometry.has_legs(system):
        rolling, rates = geometry.residuals(numeric_system(system), path(times), control(times))
        assert max(rolling.max(), rates.max()) < 1e-8
        return
    rows = np.shape(system.constraints(problem.start_point, np.zeros(space.dimension)))[0]
    assert rows == space.dimension - system.input_space.size
    step = 2e-3
    for time in times:
        here = path(np.array([time]))[0]
        moved = {
            k: np.asarray(space.difference(path(np.array([time + k * step]))[0], here))
            for k in (-2, -1, 1, 2)
        }
        velocity = (8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * step)
        residual = np.abs(system.constraints(here, velocity)).max()
        assert residual < 1e-7 * np.linalg.norm(velocity) * (1 + np.abs(here).max())


def test_motions_leave_the_invariants(problem):
    system, control = problem.system, random_control(problem, 11)
    start = {name: value for name, (value, _) in system.invariants(problem.start_point).items()}
    end = system.invariants(exact(problem, at(control), 1.0))
    assert set(end) == set(start)
    assert all(abs(value - start[name]) < 1e-9 * problem.scale for name, (value, _) in end.items())


@pytest.mark.parametrize("case", CASES)
def test_the_constraints_can_be_broken(case):
    """A residual that is always zero would prove nothing."""
    problem = problem_of(case)
    system, space = problem.system, problem.system.state_space
    if geometry.has_legs(system):
        return  # tests/test_geometry.py breaks it
    state, random = random_state(problem, 4), np.random.default_rng(4)
    assert np.abs(system.constraints(state, random.standard_normal(space.dimension))).min() > 1e-3


@pytest.mark.parametrize("case", DRIFTLESS)
def test_time_may_be_scaled(case):
    problem = problem_of(case)
    control = random_control(problem, 5)
    slow = Control(BASIS, np.asarray(control.coefficients) / 2.5, 2.5)
    end = exact(problem, at(control), 1.0)
    assert apart(exact(problem, at(slow), 2.5), end) < 1e-9


@pytest.mark.parametrize("case", DRIFTLESS)
def test_motions_run_backwards(case):
    problem = problem_of(case)
    forth = at(random_control(problem, 6))
    end = exact(problem, forth, 1.0)
    back = exact(problem, lambda t: -forth(1.0 - t), 1.0, end)
    assert apart(back, problem.start_point) < 1e-9
    still = np.zeros(problem.system.input_space.size)
    np.testing.assert_array_equal(exact(problem, lambda t: still, 1.0), problem.start_point)


@pytest.mark.parametrize("case", DRIFTING)
def test_drift_moves_without_control_and_forbids_what_driftless_systems_may(case):
    problem = problem_of(case)
    assert not problem.system.driftless
    still = np.zeros(problem.system.input_space.size)
    assert apart(exact(problem, lambda t: still, 1.0), problem.start_point) > 0.01
    forth = at(random_control(problem, 6))
    back = exact(problem, lambda t: -forth(1.0 - t), 1.0, exact(problem, forth, 1.0))
    assert apart(back, problem.start_point) > 0.01


# --- the end point ----------------------------------------------------------------------------------------------------

WAYS = {
    "variational": (VariationalEndPointMap, RungeKutta4(200)),
    "cvodes": (DifferentiatedEndPointMap, Cvodes(steps=2)),
    "rk": (DifferentiatedEndPointMap, CasadiRungeKutta(steps=200)),
}


def test_the_end_points_jacobian_comes_alike_from_every_way(problem):
    coefficients = 0.6 * np.asarray(random_control(problem, 7).coefficients)
    own = DifferentiatedEndPointMap(problem.system, BASIS, 1.0, problem.start_point, RungeKutta4(200))(
        coefficients
    )
    for name, (factory, integrator) in WAYS.items():
        other = factory(problem.system, BASIS, 1.0, problem.start_point, integrator)(coefficients)
        assert apart(other.state, own.state) < 1e-6, name
        assert apart(other.jacobian, own.jacobian, np.abs(own.jacobian).max()) < 1e-6, name


def test_runge_kutta_has_order_four(problem):
    """Away from the period's end, where quadrature of a Fourier sum would be exact."""
    control = Control(
        BASIS, 0.6 * np.asarray(random_control(problem, 8).coefficients), 1.0
    )  # far from det W = 0
    rate, last = numeric_system(problem.system).rate_function, 0.61
    ends = [
        RungeKutta4()
        .flow(Dynamics(rate), BASIS, 1.0, np.linspace(0.0, last, steps + 1))
        .end(problem.start_point, np.asarray(control.coefficients))
        for steps in (20, 40, 80)
    ]
    end = exact(problem, at(control), last)
    errors = [np.abs(found - end).max() for found in ends]
    assert errors[0] > errors[1] > errors[2] > 1e-11
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.35)


@pytest.mark.skipif(not provenance.c_compiler(), reason="no C compiler")
def test_a_compiled_kernel_gives_the_same_numbers(problem, monkeypatch):
    monkeypatch.setattr(kernel_build, "FLAGS", (("-O0", "-fPIC", "-shared"),))  # optimised: test_kernels
    coefficients = 0.3 * random_control(problem, 9).coefficients  # singularities would magnify rounding
    ends = [
        DifferentiatedEndPointMap(
            problem.system, BASIS, 1.0, problem.start_point, RungeKutta4(30, kernels=kernels)
        )(coefficients)
        for kernels in (Compiled(), Interpreted())
    ]
    assert apart(ends[0].path, ends[1].path) < 1e-9
    assert apart(ends[0].jacobian, ends[1].jacobian) < 1e-9


# --- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "parameters", "path", "words"),
    [
        ("heisenberg", {"scale": 0}, "system.scale", "0 leaves z where it is"),
        ("heisenberg", {"scale": float("nan")}, "system.scale", "finite"),
        ("heisenberg", {"scale": "1"}, "system.scale", "expected a number, got the text"),
        ("rolling_sphere", {"radius": -1}, "system.radius", "> 0"),
        ("rolling_sphere", {"contact": "glue"}, "system.contact", "none of rubber, marble"),
        ("unicycle", {"wheel": 1}, "system.wheel", "unicycle has none"),
    ],
)
def test_parameters_are_checked(model, parameters, path, words):
    with pytest.raises(InvalidProblemError, match=words) as caught:
        system_class(model)(**parameters)
    assert caught.value.path == path


@pytest.mark.parametrize("kind", ["regular", "alike", "singular", "huge", "partly not finite"])
def test_the_least_singular_value_along_a_path_is_that_of_all(kind):
    matrices = np.random.default_rng(2).normal(size=(40, 6, 6))
    if kind == "alike":
        matrices = matrices[:1] * (1.0 + 1e-13 * np.arange(40))[::-1, None, None]
    elif kind == "singular":
        matrices[7, 2] = matrices[7, 3]
    elif kind == "huge":
        matrices[3] *= 1e200
    elif kind == "partly not finite":
        matrices[5, 0, 0] = np.nan
    finite = matrices[np.isfinite(matrices).all(axis=(1, 2))]
    values = np.linalg.svd(finite, compute_uv=False)[:, -1]
    assert _least_along(matrices) == pytest.approx(values.min(), rel=1e-14, abs=1e-15)
    assert _least_along(np.full((2, 3, 3), np.inf)) is None
