"""Numbers near the ends of what a double can hold: an ending or a sentence, never a traceback or NumPy's warnings."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import Integrators, paper_problem

import nhpocp
from nhpocp.analysis import analyze, slices
from nhpocp.controls.fourier import Fourier
from nhpocp.problem import Horizon, PlanningProblem
from nhpocp.solution import Outcome
from nhpocp.solution_folder import plain

PROBLEMS = Path(__file__).parents[1] / "problems"
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
