"""Compiled kernels: the same numbers as without, whatever happens to compiler and cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from conftest import Integrators, paper_problem

from nhpocp import machine
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import MissingDependencyError
from nhpocp.flow import kernel_build, kernels
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.kernel_source import _accessed
from nhpocp.flow.kernels import Compiled, CompiledWhenReady, Interpreted
from nhpocp.problem_file import parse_problem
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.three_upu import ThreeUPU

needs_compiler = pytest.mark.skipif(machine.c_compiler() is None, reason="no C compiler")
BASES = [Fourier(2), Fourier(7), PiecewiseConstant(9)]
WORKER = """
import os, sys
cache = os.environ["NHPOCP_CACHE"]
sys.path.insert(0, sys.argv[1])
from test_kernels import end_point
os.environ["NHPOCP_CACHE"] = cache
from nhpocp.flow.kernels import Compiled
print(repr(end_point(Compiled()).jacobian.sum()))
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
    kernels._place.cache_clear()
    kernels._said.clear()


def coefficients(basis) -> np.ndarray:
    return 0.3 * np.random.default_rng(4).standard_normal((3, basis.size)) / np.sqrt(basis.size)


def end_point(way, system=None, basis=BASES[0], shares=()):
    problem = paper_problem()
    system = system or problem.system
    integrator = RungeKutta4(30, way)
    found = DifferentiatedEndPointMap(system, basis, 1.0, problem.start_point, integrator, shares)
    return found(coefficients(basis))


def stored(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


@needs_compiler
@pytest.mark.parametrize("form", ["feedback", "original"])
@pytest.mark.parametrize("preset", ["default", "normal75", "vertical_equal"])
def test_a_kernel_says_what_casadi_says(preset, form, cache):
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
        RungeKutta4(13, way).flow(numeric.rate_function, Fourier(3), 2.0)
        for way in (Compiled(), Interpreted())
    ]
    (path, derivative), (_, expected) = (
        flow.sensitivity(np.array([1.0, 2.0]), np.arange(14.0).reshape(2, 7)) for flow in flows
    )
    np.testing.assert_allclose(derivative, expected, atol=1e-12)
    np.testing.assert_allclose(path[-1], [1.0, 2.0 + 14.0], atol=1e-12)
    assert len(stored(cache)) == 1


@needs_compiler
def test_a_path_that_runs_away_is_not_finite_either_way():
    wild = 1e4 * np.ones((3, 5))
    problem = paper_problem()
    for way in (Compiled(), Interpreted()):
        integrator = RungeKutta4(20, way)
        found = DifferentiatedEndPointMap(
            problem.system, problem.basis, 1.0, problem.start_point, integrator
        )(wild)
        assert found.path.shape == (21, 12)
        assert not np.isfinite(found.jacobian).all() or np.abs(found.jacobian).max() > 1e6


@needs_compiler
def test_a_damaged_kernel_is_built_anew(cache, caplog):
    expected = end_point(Compiled()).jacobian
    (file,) = stored(cache)
    half = file.read_bytes()[:1000]
    file.unlink()  # the loaded one stays as it is
    file.write_bytes(half)
    forget()
    np.testing.assert_array_equal(end_point(Compiled()).jacobian, expected)
    assert "damaged" in caplog.text
    assert [path.stat().st_size for path in stored(cache)] != [1000]


@needs_compiler
def test_a_file_that_is_no_library_is_ignored(cache, caplog):
    expected = end_point(Compiled()).jacobian
    (file,) = stored(cache)
    file.unlink()
    key = file.stem.partition("-")[0]
    (cache / f"{key}-{kernel_build.digest(b'no library')}.so").write_bytes(b"no library")
    forget()
    np.testing.assert_allclose(end_point(Compiled()).jacobian, expected, rtol=1e-9, atol=1e-9)
    assert len(caplog.records) == 1
    assert "cannot be loaded" in caplog.text


@needs_compiler
def test_a_kernel_that_disagrees_is_not_used(cache, caplog, monkeypatch):
    expected = end_point(Interpreted()).jacobian
    right = kernels.c_source
    monkeypatch.setattr(
        kernels, "c_source", lambda s: right(s).replace("now = before", "now = before, *now += 1e-3")
    )
    np.testing.assert_array_equal(end_point(Compiled()).jacobian, expected)
    assert "disagrees" in caplog.text
    assert stored(cache) == []


def test_without_a_compiler_the_answer_is_the_same(cache, caplog, monkeypatch):
    monkeypatch.setenv("CC", "/no/such/compiler")
    expected = end_point(Interpreted()).jacobian
    for _ in range(2):
        np.testing.assert_array_equal(end_point(Compiled()).jacobian, expected)
    assert [record.message for record in caplog.records] == [
        "nhpocp: no C compiler was found: CasADi's own evaluation is used, slower"
    ]
    assert stored(cache) == []


@pytest.mark.parametrize("body", ["exit 1", "echo out of space >&2; exit 1", "exit 0"])
def test_a_compiler_that_fails_is_named(body, tmp_path, caplog, monkeypatch):
    broken = tmp_path / "cc"
    broken.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo broken 1.0 && exit 0\n{body}\n')
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    np.testing.assert_array_equal(end_point(Compiled()).jacobian, end_point(Interpreted()).jacobian)
    assert "the C compiler failed" in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []


@needs_compiler
def test_a_folder_that_takes_nothing(tmp_path, caplog, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("NHPOCP_CACHE", str(tmp_path / "file" / "cache"))
    np.testing.assert_array_equal(end_point(Compiled()).jacobian, end_point(Interpreted()).jacobian)
    assert "takes no kernels" in caplog.text


@needs_compiler
def test_two_processes_at_once(cache):
    command = [sys.executable, "-c", WORKER, str(Path(__file__).parent)]

    def work(_):
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)

    with ThreadPoolExecutor() as pool:
        done = list(pool.map(work, range(2)))
    assert done[0].stdout == done[1].stdout
    assert [one.stderr for one in done] == ["", ""]
    assert len(stored(cache)) == 1
    assert len(list(cache.iterdir())) == 1


@needs_compiler
def test_auto_builds_in_the_background_and_then_uses_it(cache, monkeypatch):
    monkeypatch.delenv("NHPOCP_COMPILE")
    system = paper_problem().system
    end_point(CompiledWhenReady(patience=1e9), system)
    assert not cache.exists()
    begun = []
    start = subprocess.Popen
    monkeypatch.setattr(
        kernels.subprocess,
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
    assert kernels._place.cache_info().currsize == 1
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
solvers: {{jacobian: {{gamma: 1}}, compile: {word}}}
"""


@needs_compiler
def test_always_and_never_give_the_same_solution(cache):
    found = {}
    for word, way in (("never", Interpreted()), ("auto", CompiledWhenReady()), ("always", Compiled())):
        problem = parse_problem(YAML.format(word=word))
        solver = problem.solvers["jacobian"]
        assert solver.integrator.kernels == way
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
    with pytest.raises(NotImplementedError):
        _accessed("  if (casadi_f3(arg, res, iw, w, 0)) return 1;")


@needs_compiler
def test_doctor_shows_the_cache_and_clears_it(cache):
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
