"""Plans for machines, and where they go by an integration in the machine's own time."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import nhpocp
from nhpocp.cli.entry import status
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution
from nhpocp.solvers.claimed import claimed

PROBLEMS = Path(__file__).parents[2] / "problems"


@cache
def plan(name: str, **control: object) -> Solution:
    """The control that a problem of the library begins with, as a plan; `control`: other coefficients."""
    problem = nhpocp.load_problem(PROBLEMS / f"{name}.yaml")
    begun = control.get("control") or problem.control(problem.initial, problem.horizon.first)
    return claimed(problem, problem.solvers["jacobian"], begun, Outcome.CONVERGED, "", 0.0)


def reference(solution: Solution, times: np.ndarray, duration: float, quintic: bool) -> np.ndarray:
    """States (k, size) at times of the machine: ẋ = f + G u τ' integrated in these, from the plan's control alone."""
    system, control = solution.problem.system, solution.control

    def rate(s: float, x: np.ndarray) -> np.ndarray:
        z = s / duration
        p = z**3 * (10 - 15 * z + 6 * z * z) if quintic else z
        slope = 30 * (z * (1 - z)) ** 2 if quintic else 1.0
        u = control(np.array([control.horizon * p]))[0]
        scale = control.horizon / duration * slope
        return np.asarray(system.rate(x, u * scale if system.driftless else u))

    start = np.asarray(solution.problem.start_point, dtype=float)
    done = solve_ivp(rate, (0.0, duration), start, "DOP853", t_eval=times, rtol=1e-10, atol=1e-10)
    return done.y.T


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A verified plan of the paper's task."""
    place = tmp_path_factory.mktemp("plan") / "paper"
    overrides = ["--set", "output.pictures=false", "--set", "solvers.jacobian.gamma=1"]
    assert status(["solve", str(PROBLEMS / "paper.yaml"), "-o", str(place), *overrides]) == 0
    return place
