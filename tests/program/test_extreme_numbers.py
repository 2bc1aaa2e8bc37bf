"""Numbers near the ends of what a double can hold: an ending or a sentence, never a traceback or NumPy's warnings."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp.analysis import analyze, slices
from nhpocp.analysis.analysis import PathAnalysis
from nhpocp.analysis.growth import Growth
from nhpocp.cli.entry import status
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.horizon import Horizon
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import load_problem
from nhpocp.scales import Scales
from nhpocp.solution import Crossing
from nhpocp.solution_folder import plain
from nhpocp.verification.crossings import MOST, sign_changes, touches
from nhpocp.views.analysis_words import path_rows
from tests.conftest import Integrators, paper_problem

PROBLEMS = Path(__file__).parents[2] / "problems"
HUGE = [1e155, 1e200, -1e200, 1e308]


def line(**changes):
    """Both integrators to (1, 1)."""
    values = {
        "system": Integrators(),
        "start": {"x": 0, "y": 0},
        "goal": {"x": 1, "y": 1},
        "basis": Fourier(1),
        "horizon": Horizon(1.0),
        "pictures": False,
    }
    return PlanningProblem(**{**values, **changes})


@pytest.mark.parametrize("solver", ["euler", "adaptive", "ode"])
@pytest.mark.parametrize("value", HUGE)
@pytest.mark.parametrize("place", ["goal", "start"])
def test_an_error_that_overflows_is_not_finite(solver, value, place):
    rules = {"euler": nhpocp.Euler(1.0), "adaptive": nhpocp.Adaptive(), "ode": nhpocp.Ode()}
    problem = line(**{place: {"x": value, "y": 0}})
    with np.errstate(all="ignore"):
        solution = nhpocp.solve(problem, nhpocp.Continuation(step_rule=rules[solver]))
    assert solution.outcome is Outcome.NOT_FINITE
    assert "overflows" in solution.message
    assert solution.iterations[0]["error"] is None


@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
def test_speeds_that_are_no_numbers_are_not_finite(solver):
    problem = load_problem(PROBLEMS / "unicycle.yaml", ["horizon=1e-300", "start.y=1e20"])
    plan = nhpocp.solve(problem, problem.solvers[solver])
    assert plan.outcome is Outcome.NOT_FINITE
    assert "speeds of about inf" in plan.message


def test_no_control_is_drawn_whose_derivatives_overflow(tmp_path):
    """`initial: auto` with lengths of 1e155, which make the drawn controls' Jacobians infinite."""
    changes = ("goal.x=1e155", "control.initial=auto", "output.pictures=false")
    options = [word for change in changes for word in ("--set", change)]
    path = str(PROBLEMS / "heisenberg.yaml")
    assert status(["solve", path, *options, "-o", str(tmp_path / "plan")]) == 1


def test_a_jacobian_that_overflows_in_the_metric_is_not_finite(tmp_path):
    """Finite as it is: what the NLP falls back on met it in its guess."""
    changes = ("start.y=1e155", "output.pictures=false", "solvers.nlp.max_iterations=9")
    options = [word for change in changes for word in ("--set", change)]
    path = str(PROBLEMS / "heisenberg.yaml")
    assert status(["solve", path, "--solver", "nlp", *options, "-o", str(tmp_path / "plan")]) == 1


def test_units_of_costs_overflow_in_silence():
    huge = Scales(Integrators(), length=1e200, time=1.0, number=1e200, radius=1e200)
    for objective in OBJECTIVES.values():
        assert objective.scale(huge) > 0


@pytest.mark.parametrize("value", [1e-160, 1e-300])
def test_an_error_length_that_is_next_to_nothing_is_not_finite(value):
    with np.errstate(all="ignore"):
        solution = nhpocp.solve(paper_problem(error_length=value), nhpocp.Continuation())
    assert solution.outcome is Outcome.NOT_FINITE


@pytest.mark.parametrize(
    "changes",
    [
        {"length_scale": 1e20},
        {"length_scale": 1e-300},
        {"length_scale": 1e308},
        {"base_radius": 1e308},
        {"platform_radius": 1e200},
        {"platform_radius": 1e-300},
        {"start": {"position": [0, 0, 1e200], "orientation": np.eye(3)}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_an_analysis_says_what_overflows(changes, monkeypatch):
    monkeypatch.setattr(slices, "RESOLUTION", 9)
    with np.errstate(all="ignore"):
        found = analyze(paper_problem(**changes), degree=2)
    json.dumps(plain(found.to_json()), allow_nan=False)
    assert found.end_point or found.notes


def test_nothing_stands_beside_the_json_document(tmp_path):
    command = [sys.executable, "-m", "nhpocp", "solve", PROBLEMS / "unicycle.yaml", "--json", "-o", "out"]
    changes = ["--set", "horizon=1e308", "--set", "output.pictures=false"]
    done = subprocess.run(
        [*map(str, command), *changes], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 1
    assert json.loads(done.stdout)["outcome"] == "not_finite"
    assert done.stderr == ""


@pytest.mark.parametrize("key", ["error_length", "length_scale"])
@pytest.mark.parametrize("value", ["1e200", "1e-200"])
def test_a_length_out_of_range_is_named_where_it_stands(key, value, tmp_path):
    file = tmp_path / "problem.yaml"
    text = (PROBLEMS / "unicycle.yaml").read_text()
    file.write_text(f"{text}\n{key}: {value}\n")
    with pytest.raises(InvalidProblemError, match=r"expected a number from 1e-50 to 1e\+50") as found:
        load_problem(file)
    line = file.read_text().splitlines().index(f"{key}: {value}") + 1
    assert (found.value.file, found.value.line, found.value.path) == (str(file), line, key)
    with pytest.raises(InvalidProblemError, match=f"^{key}: .* is out of range"):
        load_problem(PROBLEMS / "unicycle.yaml", [f"{key}={value}"])


def test_zeros_that_are_rounding_are_not_gone_into():
    """A platform of 1e20 had a thousand of them, each of which took Brent's method thirty evaluations."""
    times, asked = np.linspace(0.0, 1.0, 1001), []

    def noise(t: float) -> float:
        asked.append(t)
        return float(np.sin(1e7 * t))

    values = np.random.default_rng(0).normal(size=len(times))
    found = sign_changes(noise, times, values)
    assert not asked
    assert len(found) == np.count_nonzero(values[1:] * values[:-1] < 0) > MOST
    places = np.searchsorted(times, found)
    assert (values[places] * values[places - 1] < 0).all()
    assert np.diff(found).min() > 0
    touches(noise, times, np.abs(values) * 1e-6)
    sign_changes(lambda t: 1.0 + noise(t) ** 2, times, np.abs(values) + np.tile([1.0, 1e-9], 501)[:1001])
    assert len(asked) <= 2 * MOST * 60


def test_valleys_that_are_rounding_are_not_all_gone_into(monkeypatch):
    """A map of 161 × 161 that is noise has some 10 000 of them."""
    asked = []

    def noise(self, points):
        asked.append(len(points))
        return {"s": np.abs(np.random.default_rng(len(asked)).normal(size=len(points)))}

    monkeypatch.setattr(slices._Plane, "sigmas", noise)
    monkeypatch.setattr(slices._Plane, "determinants", noise)
    problem = paper_problem()
    spans = [slices.Span(c) for c in slices.chosen(problem.system.state_space, ["x", "z"])]
    points = np.tile(problem.start_point, (2, 1))
    slices.singularity_map(problem.system, spans, points[0], "start", points, 15.0)
    assert max(asked) <= slices.MOST


def test_what_is_met_too_often_is_counted():
    """Thousands of changes of sign filled the terminal."""
    zeros = [Crossing("det_w", 1e-3 * k, {}, True) for k in range(900)]
    states, growth = np.zeros((2, 9)), Growth(6, ())
    times = np.array([0.0, 1.0])
    path = PathAnalysis(times, states, (growth, growth), growth, np.ones(2), {}, zeros, states)
    assert "det W at t = 0.007 and 892 more" in path_rows(path)[-1][1]
