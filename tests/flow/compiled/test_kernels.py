"""Compiled kernels: the same numbers as without, whatever happens to compiler and cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nhpocp import provenance
from nhpocp.batch import plan_many
from nhpocp.constraints.bound import Bound
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import MissingDependencyError
from nhpocp.flow.compiled import kernel_build, kernel_cache, kernels, shot_source, sweep_source
from nhpocp.flow.compiled.c_functions import _accessed
from nhpocp.flow.compiled.kernel_cache import NotCompilableError, agree
from nhpocp.flow.compiled.kernels import Compiled, CompiledWhenReady, Interpreted
from nhpocp.flow.dynamics import Dynamics, dynamics
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.runge_kutta import Ends, scheme
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.horizon import Horizon
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import load_problem, parse_problem
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.problem_file.starters import starter
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp import interval
from nhpocp.solvers.nlp.guesses import ProblemGuess, make_guess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.three_upu import ThreeUPU
from tests.conftest import Integrators, paper_problem

needs_compiler = pytest.mark.skipif(not provenance.c_compiler(), reason="no C compiler")
QUICKLY = (  # to compile; what matters here is what is done with the result, which shall round otherwise than CasADi
    ("-O0", "-mfpmath=387", "-fPIC", "-shared"),
    ("-O0", "-fPIC", "-shared"),
)
PROBLEMS = Path(__file__).parents[3] / "problems"
BASES = [Fourier(2), Fourier(7), PiecewiseConstant(9)]
WORKER = """
import os, sys
cache = os.environ["NHPOCP_CACHE"]
sys.path.insert(0, sys.argv[1])
from tests import conftest
from tests.flow.compiled import test_kernels
conftest.swift = lambda system: system
os.environ["NHPOCP_CACHE"] = cache
from nhpocp.flow.compiled import kernel_build
from nhpocp.flow.compiled.kernels import Compiled
kernel_build.FLAGS = test_kernels.QUICKLY
for name in sys.argv[2:]:
    print(repr(getattr(test_kernels, name)(Compiled()).sum()))
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty cache, and a process that knows of no kernel."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("NHPOCP_CACHE", str(folder))
    forget()
    yield folder
    forget()


def forget() -> None:
    kernels._of_sweeps.cache_clear()
    kernels._of_shots.cache_clear()
    kernels._shared.cache_clear()
    interval._made.cache_clear()
    kernel_cache._said.clear()


def coefficients(basis) -> np.ndarray:
    return 0.3 * np.random.default_rng(4).standard_normal((3, basis.size)) / np.sqrt(basis.size)


def end_point(way, system=None, basis=BASES[0], shares=()):
    problem = paper_problem()
    system = system or problem.system
    integrator = RungeKutta4(30, way)
    found = DifferentiatedEndPointMap(system, basis, 1.0, problem.start_point, integrator, shares)
    return found(coefficients(basis))


def sweep(way) -> np.ndarray:
    """The numbers of a sweep."""
    return end_point(way).jacobian


def many(problem, number=11):
    """Controls near a problem's own size."""
    shape = number, problem.system.input_space.size, problem.basis.size
    return np.random.default_rng(5).normal(0.0, 0.3, shape) / np.sqrt(problem.basis.size)


def led(way, problem, steps=13, **choices) -> Ends:
    """Where they lead."""
    flow = RungeKutta4(steps, way).flow(dynamics(problem.system), problem.basis, 1.0)
    return flow.ends(problem.start_point, many(problem), **choices)


def ends(way) -> np.ndarray:
    """The numbers of a bundle."""
    return np.concatenate([np.ravel(part) for part in led(way, paper_problem())])


def values(programme, seed=0) -> list[np.ndarray]:
    """All functions of an NLP at a random point near its guess."""
    chance, guess = np.random.default_rng(seed), programme.pack(programme.guess)
    x, multipliers = guess + 0.01 * chance.normal(size=len(guess)), chance.normal(size=len(programme.rows))
    functions = programme.functions
    found = [functions[name](x, []) for name in ("nlp", "grad_f", "jac_g")]
    return [
        np.array(value).ravel()
        for value in [
            *(value for pair in found for value in pair),
            functions["hess_lag"](x, [], 0.7, multipliers),
        ]
    ]


def transcribed(problem, way, basis=None, steps=1, intervals=9) -> StagedTranscription:
    guess = make_guess(ProblemGuess(), problem, basis, intervals, 0)
    return StagedTranscription(problem, guess, basis, intervals, steps, problem.bounds, way)


LINEAR = PlanningProblem(
    system=Integrators(), start={"x": 0.0, "y": 0.0}, goal={"x": 1.0, "y": 2.0}, initial=np.ones((2, 5))
)


def shots(way) -> np.ndarray:
    """The numbers of an NLP."""
    return np.concatenate(values(transcribed(LINEAR, way)))


KINDS = pytest.mark.parametrize("numbers", [sweep, ends, shots])


def stored(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


@needs_compiler
@pytest.mark.parametrize("form", ["feedback", "original"])
@pytest.mark.parametrize("preset", ["default", "normal75", "vertical_equal"])
def test_a_kernel_says_what_casadi_says(preset, form, cache, monkeypatch):
    if preset != "default":
        monkeypatch.setattr(kernel_build, "FLAGS", QUICKLY)
    system = ThreeUPU.preset(preset, form=form)
    for basis in BASES:
        ours = end_point(Compiled(), system, basis, (0.37, 0.5))
        expected = end_point(Interpreted(), system, basis, (0.37, 0.5))
        scale = np.abs(expected.jacobians).max()
        np.testing.assert_allclose(ours.path, expected.path, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(ours.jacobians, expected.jacobians, atol=1e-12 * scale)
    assert len(stored(cache)) == 1  # neither basis nor steps enter


@needs_compiler
def test_other_systems_and_whole_derivatives(cache):
    numeric = NumericSystem(Integrators())
    flows = [
        RungeKutta4(13, way).flow(Dynamics(numeric.rate_function), Fourier(3), 2.0)
        for way in (Compiled(), Interpreted())
    ]
    (path, derivative, _), (_, expected, _) = (
        flow.sensitivity(np.array([1.0, 2.0]), np.arange(14.0).reshape(2, 7)) for flow in flows
    )
    np.testing.assert_allclose(derivative, expected, atol=1e-12)
    np.testing.assert_allclose(path[-1], [1.0, 2.0 + 14.0], atol=1e-12)
    assert len(stored(cache)) == 1


@needs_compiler
def test_one_kernel_serves_all_robots_of_a_kind(cache, quick):
    """Its text reads the numbers in which they differ; other rollers are another text."""
    robots = [ThreeUPU(base_radius=base, roller_tilt=tilt) for base, tilt in ((25.0, 0.9), (31.0, -1.3))]
    found = [end_point(Compiled(), robot) for robot in robots]
    for robot, ours in zip(robots, found, strict=True):
        expected = end_point(Interpreted(), robot)
        np.testing.assert_allclose(ours.path, expected.path, rtol=1e-12, atol=1e-12)
        scale = np.abs(expected.jacobian).max()
        np.testing.assert_allclose(ours.jacobian, expected.jacobian, atol=1e-12 * scale)
    assert np.abs(found[0].path - found[1].path).max() > 0.1
    assert len(stored(cache)) == 1
    end_point(Compiled(), ThreeUPU(platform_axis="normal"))
    assert len(stored(cache)) == 2


@needs_compiler
def test_a_path_that_runs_away_tells_nothing_of_a_kernel(cache, caplog, quick, monkeypatch):
    """What rounds beside a pole is multiplied by more than a nudge of the control shows."""
    made, problem = sweep_source.c_source, paper_problem()
    monkeypatch.setattr(
        sweep_source,
        "c_source",
        lambda scheme: made(scheme).replace("j] += g[", "j] += 1.001 * g["),
    )
    wild = np.random.default_rng(515).normal(0.0, 1.5, (1, 3, 5))
    flow = RungeKutta4(13, Compiled()).flow(dynamics(problem.system), problem.basis, 1.0)
    flow.ends(problem.start_point, wild)
    assert len(stored(cache)) == 1
    assert kernels._of_sweeps(scheme(dynamics(problem.system), CLASSICAL)).untried
    assert "disagrees" not in caplog.text
    flow.ends(problem.start_point, many(problem))
    assert "disagrees" in caplog.text


@needs_compiler
def test_a_path_that_runs_away_is_not_finite_either_way(quick):
    wild = 1e4 * np.ones((3, 5))
    problem = paper_problem()
    for way in (Compiled(), Interpreted()):
        integrator = RungeKutta4(20, way)
        found = DifferentiatedEndPointMap(
            problem.system, problem.basis, 1.0, problem.start_point, integrator
        )(wild)
        assert found.path.shape == (21, 12)
        assert not np.isfinite(found.jacobian).all() or np.abs(found.jacobian).max() > 1e6


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(kernel_build, "FLAGS", QUICKLY)


@needs_compiler
@KINDS
def test_a_damaged_kernel_is_built_anew(numbers, cache, caplog, quick):
    expected = numbers(Compiled())
    (file,) = stored(cache)
    half = file.read_bytes()[:1000]
    file.unlink()  # the loaded one stays as it is
    file.write_bytes(half)
    forget()
    np.testing.assert_array_equal(numbers(Compiled()), expected)
    assert "damaged" in caplog.text
    assert [path.stat().st_size for path in stored(cache)] != [1000]


@needs_compiler
@KINDS
def test_a_file_that_is_no_library_is_ignored(numbers, cache, caplog, quick):
    expected = numbers(Compiled())
    (file,) = stored(cache)
    file.unlink()
    key = file.stem.partition("-")[0]
    (cache / f"{key}-{kernel_build.digest(b'no library')}.so").write_bytes(b"no library")
    forget()
    np.testing.assert_allclose(numbers(Compiled()), expected, rtol=1e-9, atol=1e-9)
    assert len(caplog.records) == 1
    assert "cannot be loaded" in caplog.text


RIGHT_LANES, WRONG_LANES = "u[l * u_stride +", "u[(l ^ 1) * u_stride +"


@needs_compiler
@pytest.mark.parametrize(
    ("numbers", "module", "right", "wrong"),
    [
        (sweep, sweep_source, "now = before", "now = before, *now += 1e-3"),
        (sweep, sweep_source, "at[r * M + j] += g[", "at[r * M + j] += 1.001 * g["),
        (sweep, sweep_source, "seen[PLACE[i] * M", "seen[PLACE[i / 2] * M"),
        (ends, sweep_source, "seen[(PLACE[i] * M", "seen[(PLACE[i / 2] * M"),
        (ends, sweep_source, RIGHT_LANES, WRONG_LANES),
        (shots, shot_source, "to[l][place] = values[i * L + l]", "to[l][place] = 1.0"),
        (shots, shot_source, "*q[l] = closed[l]", "*q[l] = closed[l] + 1e-3"),
        (shots, shot_source, "dw[d * L + l] = 1.0", "dw[d * L + l] = 1.001"),
        (shots, shot_source, "sigma[k] : 1.0", "sigma[k] : 2.0"),
        (shots, shot_source, "* W + j] = g[j * L + l];", "* W + j] = g[j * L + l] + (j == 1);"),
    ],
)
def test_a_kernel_that_disagrees_is_not_used(
    numbers, module, right, wrong, cache, caplog, monkeypatch, quick
):
    bounded = replace(LINEAR, bounds=[Bound("state.x", "x", -9.0, 9.0)])
    monkeypatch.setitem(globals(), "LINEAR", bounded)
    expected, made = numbers(Interpreted()), module.c_source
    assert right in made_of(made, numbers)
    monkeypatch.setattr(module, "c_source", lambda parts: made(parts).replace(right, wrong))
    found = numbers(Compiled())
    np.testing.assert_array_equal(found, expected)
    assert "disagrees" in caplog.text
    assert stored(cache) == []


def made_of(c_source, numbers) -> str:
    """The C text of either kind."""
    if numbers is shots:
        return c_source(transcribed(LINEAR, Interpreted()).interval.shot)
    return c_source(scheme(dynamics(paper_problem().system), CLASSICAL))


@KINDS
def test_without_a_compiler_the_answer_is_the_same(numbers, cache, caplog, monkeypatch):
    monkeypatch.setenv("CC", "/no/such/compiler")
    expected = numbers(Interpreted())
    for _ in range(2):
        np.testing.assert_array_equal(numbers(Compiled()), expected)
    assert [record.message for record in caplog.records] == [
        "nhpocp: no C compiler was found (CC is '/no/such/compiler'): CasADi's own evaluation is used, slower"
    ]
    assert stored(cache) == []


@KINDS
@pytest.mark.parametrize("body", ["exit 1", "echo out of space >&2; exit 1", "exit 0"])
def test_a_compiler_that_fails_is_named(body, numbers, tmp_path, caplog, monkeypatch):
    broken = tmp_path / "cc"
    broken.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo broken 1.0 && exit 0\n{body}\n')
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    np.testing.assert_array_equal(numbers(Compiled()), numbers(Interpreted()))
    assert "the C compiler failed" in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []


@needs_compiler
@KINDS
def test_a_folder_that_takes_nothing(numbers, tmp_path, caplog, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("NHPOCP_CACHE", str(tmp_path / "file" / "cache"))
    np.testing.assert_array_equal(numbers(Compiled()), numbers(Interpreted()))
    assert "takes no kernels" in caplog.text


@needs_compiler
def test_two_processes_at_once(cache):
    """Each kind of kernel, of sweeps and of shots."""
    kinds = [kind.__name__ for kind in (sweep, ends, shots)]
    command = [sys.executable, "-c", WORKER, str(Path(__file__).parents[3]), *kinds]

    def work(_):
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)

    with ThreadPoolExecutor() as pool:
        done = list(pool.map(work, range(2)))
    assert done[0].stdout == done[1].stdout
    assert len(done[0].stdout.splitlines()) == len(kinds)
    assert [one.stderr for one in done] == ["", ""]
    assert len(stored(cache)) == 2
    assert len(list(cache.iterdir())) == 2


@needs_compiler
def test_threads_share_a_kernel_and_its_memory(cache, quick):
    """Sweeps of growing length at once: what one thread works in is not freed under it by another."""
    problem, steps = paper_problem(), [10, 400, 30, 200, 800, 50] * 10
    values = coefficients(problem.basis)

    def swept(count):
        integrator = RungeKutta4(count, Compiled())
        return DifferentiatedEndPointMap(problem.system, problem.basis, 1.0, problem.start_point, integrator)(
            values
        ).jacobian

    expected = {count: swept(count) for count in sorted(set(steps), reverse=True)}
    forget()
    swept(10)
    before = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e-6)
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(swept, steps))
    finally:
        sys.setswitchinterval(before)
    for count, jacobian in zip(steps, found, strict=True):
        np.testing.assert_array_equal(jacobian, expected[count])


# --- the ends of many paths -------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("model", SYSTEMS)
def test_every_system_has_the_same_ends_compiled(model, cache, quick):
    problem = parse_problem(starter(model))
    compiled, interpreted = (led(way, problem) for way in (Compiled(), Interpreted()))
    for found, expected in zip(compiled, interpreted, strict=True):
        assert found.shape == expected.shape
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max(initial=1e-300))
    bare = led(Compiled(), problem, differentiated=False)
    np.testing.assert_array_equal(bare.states, compiled.states)
    assert bare.derivatives.shape == (0, *compiled.derivatives.shape[1:])
    assert len(stored(cache)) == 1


def test_the_ends_are_those_of_each_sweep():
    problem, way = paper_problem(), Interpreted()
    flow = RungeKutta4(13, way).flow(dynamics(problem.system), problem.basis, 1.0)
    found = led(way, problem)
    for k, coefficients in enumerate(many(problem)):
        alone = flow.sensitivity(problem.start_point, coefficients)
        np.testing.assert_array_equal(found.states[k], alone.path[-1])
        np.testing.assert_array_equal(found.derivatives[k], alone.derivatives[-1])
        np.testing.assert_array_equal(found.watched[k], alone.watched)


@needs_compiler
def test_auto_takes_the_kernel_of_sweeps_for_the_ends_of_many(cache, monkeypatch, quick):
    monkeypatch.delenv("NHPOCP_COMPILE")
    problem, begun = paper_problem(), []
    monkeypatch.setattr(kernel_cache.Place, "_begin", lambda place, recipe: begun.append(place))
    eager = CompiledWhenReady(patience=1e-9)
    first = led(eager, problem)
    led(eager, problem)
    assert len(begun) == 1
    forget()
    end_point(Compiled(), problem.system)
    forget()
    led(eager, problem)
    np.testing.assert_allclose(led(eager, problem).derivatives, first.derivatives, atol=1e-12)
    assert kernels._of_sweeps(scheme(dynamics(problem.system), CLASSICAL)).kernel is not None


@needs_compiler
def test_a_kernel_is_tried_on_controls_that_differ(cache, caplog, monkeypatch, quick):
    made, problem = sweep_source.c_source, paper_problem()
    monkeypatch.setattr(
        sweep_source, "c_source", lambda scheme: made(scheme).replace(RIGHT_LANES, WRONG_LANES)
    )
    flow = RungeKutta4(13, Compiled()).flow(dynamics(problem.system), problem.basis, 1.0)
    flow.ends(problem.start_point, 0.0 * many(problem, 1), differentiated=False)
    assert "disagrees" in caplog.text


@needs_compiler
def test_bundles_as_they_are_built_in_earnest(cache):
    """Vector instructions, a basis with jumps, and the plans that are made of them."""
    problem = replace(paper_problem(), basis=PiecewiseConstant(9), initial=None)
    compiled, interpreted = (led(way, problem, steps=30) for way in (Compiled(), Interpreted()))
    for found, expected in zip(compiled, interpreted, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    problem = paper_problem()
    goals = [{**problem.goal, "position": [-0.4, -0.2, z]} for z in (34.0, 34.5, 35.0)]
    plans = [
        list(plan_many(problem, goals, Auto(Continuation(Adaptive(), integrator=RungeKutta4(100, way)))))
        for way in (Compiled(), Interpreted())
    ]
    for ours, expected in zip(*plans, strict=True):
        assert (ours.outcome, ours.evaluations) == (expected.outcome, expected.evaluations)
        np.testing.assert_allclose(ours.control.coefficients, expected.control.coefficients, atol=1e-9)


# --- the intervals of an NLP ------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize(
    ("model", "free"),
    # what is free, or constant, enters the kernel beside the system: every system once, one of each kind twice
    [
        *((model, True) for model in SYSTEMS),
        *((model, False) for model in ("three_upu", "unicycle", "rigid_body")),
    ],
)
def test_every_system_has_the_same_nlp_compiled(model, free, cache, caplog, quick):
    """Along guesses that are paths themselves: what is left of their gaps is rounding."""
    problem, settings = replace(parse_problem(starter(model)), bounds=[]), {}
    if free:
        problem = replace(problem, horizon=Horizon(1.0, 0.5, 3.0), objective="path_length")
        settings = {"basis": problem.basis, "steps": 2}
    compiled, interpreted = (
        values(transcribed(problem, way, **settings)) for way in (Compiled(), Interpreted())
    )
    for found, expected in zip(compiled, interpreted, strict=True):
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * scale)
    assert caplog.text == ""
    assert len(stored(cache)) == 1


@needs_compiler
@pytest.mark.parametrize("name", ["heisenberg", "rolling_sphere", "unicycle", "veselova_joint"])
def test_a_kernel_is_kept_where_the_guess_is_the_solution(name, cache, caplog, quick):
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    solver = replace(problem.solvers["nlp"], kernels=Compiled(), intervals=20)
    for _ in range(3):
        plan = solver.solve(problem).control
        forget()
        problem = replace(problem, basis=plan.basis, initial=plan.coefficients)
        kept = stored(cache)
        assert len(kept) == 1
    assert caplog.text == ""


def test_what_all_but_cancels_is_held_against_its_terms():
    """x + y with x = -y to ten digits: rounding of x is large beside the sum, and a mistake is larger."""
    x = np.array([30.0])
    y = np.array([-30.0 + 1e-9])
    expected, nearby = [x + y], [1.000000001 * x + y]
    assert agree([x * (1 + 4e-16) + y], expected, nearby)
    assert not agree([x * (1 + 1e-7) + y], expected, nearby)
    for wrong in (np.nan, np.inf):
        assert not agree([np.array([wrong])], expected, nearby)


def test_numbers_that_overflow_prove_nothing():
    """∞ - ∞ in one order of a sum, a number in another: no fault of the kernel, nor a word for it."""
    overflowed = [np.array([1.0, np.inf])]
    assert agree(overflowed, overflowed, overflowed)
    for other in (2.0, np.nan):
        assert agree([np.array([1.0, other])], overflowed, overflowed) is None


def test_numbers_that_rounding_decides_prove_nothing():
    expected, other = [np.array([1.0, 2.0])], [np.array([1.0, 2.1])]
    assert agree(other, expected, [np.array([1.0, 2.0 + 1e-9])]) is False
    assert agree(other, expected, [np.array([1.0, 2.01])]) is None


@needs_compiler
def test_one_kernel_serves_every_grid_and_tightened_bounds(cache, quick):
    for intervals, steps, limit in ((9, 1, 9.0), (4, 3, 9.0), (17, 2, 8.0)):
        bounds = [
            Bound("state.x", "x", -limit, limit),
            Bound("control.u", "u", -limit, limit),  # at the start of an interval too
            Bound("state.y", "y", 1.0, 1.0),  # at the end of an interval only
        ]
        problem = replace(LINEAR, bounds=bounds, horizon=Horizon(1.0, 0.5, 3.0))
        compiled, interpreted = (
            values(transcribed(problem, way, steps=steps, intervals=intervals))
            for way in (Compiled(), Interpreted())
        )
        for found, expected in zip(compiled, interpreted, strict=True):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert len(stored(cache)) == 1


@needs_compiler
def test_both_ways_lead_to_the_same_optimum(cache, problem, quick):
    found = [
        MultipleShooting(intervals=50, steps_per_interval=1, kernels=way).solve(problem)
        for way in (Compiled(), Interpreted())
    ]
    efforts = [solution.details["objective_value"] for solution in found]
    assert efforts[0] == pytest.approx(efforts[1], abs=1e-9)
    assert round(efforts[0], 5) == 2.05082
    assert len(found[0].iterations) == len(found[1].iterations)
    assert found[0].details["optimality"]["stationarity"] < 1e-6
    assert len(stored(cache)) == 1


@needs_compiler
def test_auto_takes_a_stored_kernel_at_once_and_builds_only_what_comes_again(cache, monkeypatch, quick):
    monkeypatch.delenv("NHPOCP_COMPILE")
    begun = []
    monkeypatch.setattr(kernel_cache.Place, "_begin", lambda place, recipe: begun.append(place))
    eager = CompiledWhenReady(patience=1e-9)
    solver = MultipleShooting(intervals=4, steps_per_interval=1, kernels=eager)
    solver.solve(LINEAR)
    assert not begun
    solver.solve(LINEAR)
    solver.solve(LINEAR)
    assert len(begun) == 1
    forget()
    transcribed(LINEAR, Compiled()).functions["nlp"]
    forget()
    assert type(transcribed(LINEAR, eager).shots) is type(transcribed(LINEAR, Compiled()).shots)
    assert type(transcribed(LINEAR, CompiledWhenReady()).shots) is type(transcribed(LINEAR, eager).shots)
    forget()
    assert type(transcribed(LINEAR, CompiledWhenReady()).shots) is type(
        transcribed(LINEAR, Interpreted()).shots
    )


@needs_compiler
def test_auto_builds_in_the_background_and_then_uses_it(cache, monkeypatch):
    monkeypatch.delenv("NHPOCP_COMPILE")
    system = paper_problem().system
    end_point(CompiledWhenReady(patience=1e9), system)
    assert not cache.exists()
    begun = []
    start = subprocess.Popen
    monkeypatch.setattr(
        kernel_cache.subprocess,
        "Popen",
        lambda *a, **k: begun.append(start(*a, **{**k, "start_new_session": False})),
    )
    eager = CompiledWhenReady(patience=1e-6)
    first = end_point(eager, system)
    (process,) = begun
    assert process.wait(60) == 0
    (file,) = stored(cache)
    second = end_point(eager, system)
    np.testing.assert_allclose(second.jacobian, first.jacobian, atol=1e-12)
    assert len(begun) == 1
    assert file.exists()


def test_auto_can_be_switched_off(cache):
    assert os.environ["NHPOCP_COMPILE"] == "never"
    system = paper_problem().system
    for _ in range(3):
        end_point(CompiledWhenReady(patience=0.0), system)
    assert not cache.exists()


YAML = """
nhpocp: 1
system: {{model: three_upu}}
start: {{position: [0, 0, 25], orientation: {{rpy: [0, 0, -pi/6]}}}}
goal: {{position: [-0.4, -0.2, 35], orientation: {{rpy: [0, 0, -90 deg]}}}}
control: {{basis: fourier, harmonics: 2, initial: [[0, .5, 0, 0, 0], [0, .5, 0, 0, 0], [1, 0, .5, 0, 0]]}}
solvers: {{jacobian: {{step_rule: euler, gamma: 1}}, compile: {word}}}
"""


@needs_compiler
def test_always_and_never_give_the_same_solution(cache, quick):
    found = {}
    for word, way in (("never", Interpreted()), ("auto", CompiledWhenReady()), ("always", Compiled())):
        problem = parse_problem(YAML.format(word=word))
        solver = problem.solvers["jacobian"]
        assert solver.integrator.kernels == problem.solvers["nlp"].kernels == way
        found[word] = solver.find(problem)
    np.testing.assert_allclose(
        found["always"].control.coefficients, found["never"].control.coefficients, atol=1e-9
    )
    assert len(found["always"].records) == len(found["never"].records) == 5
    assert len(stored(cache)) == 1


def test_always_needs_a_compiler(monkeypatch):
    monkeypatch.setenv("CC", "/no/such/compiler")
    with pytest.raises(MissingDependencyError, match=r"solvers\.compile"):
        parse_problem(YAML.format(word="always"))
    parse_problem(YAML.format(word="auto"))


def test_code_that_is_not_straight_lines_is_refused():
    with pytest.raises(NotCompilableError):
        _accessed("  if (casadi_f3(arg, res, iw, w, 0)) return 1;")


@needs_compiler
def test_doctor_shows_the_cache_and_clears_it(cache, quick):
    end_point(Compiled())
    command = [sys.executable, "-c", "from nhpocp.cli import main; main()", "doctor", "--json"]

    def doctor(*options):
        done = subprocess.run([*command, *options], capture_output=True, text=True, check=True, timeout=120)
        return json.loads(done.stdout)["cache"], done.stderr

    shown, _ = doctor()
    assert shown == {"folder": str(cache), "kernels": 1, "bytes": stored(cache)[0].stat().st_size}
    (cache / "somebody-elses.txt").write_text("kept")
    shown, said = doctor("--clear-cache")
    assert (shown["kernels"], shown["bytes"]) == (0, 0)
    assert "1 kernels removed" in said
    assert [path.name for path in cache.iterdir()] == ["somebody-elses.txt"]
