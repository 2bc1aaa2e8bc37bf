"""Laws of every system: those of the registry join by themselves, with the problem of the library as a place to stand.

A new system's line here is one in `VARIANTS`, for parameters that change its equations.
"""

from __future__ import annotations

import math
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

from nhpocp.arrays import namespace
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled import kernel_build
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import parse_problem, starter
from nhpocp.problem_file.registry import SYSTEMS, system_class
from nhpocp.systems.numeric import _least_along
from nhpocp.systems.parallel_robot import ParallelRobot
from nhpocp.systems.system import System
from nhpocp.testing import check_system
from nhpocp.testing.laws import apart
from nhpocp.testing.systems import LAWS, at, exact, random_control, standing
from nhpocp.verification import geometry
from tests.conftest import LIBRARY, Turntable, library_problem
from tests.ferry import Ferry

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


@cache
def library() -> dict[str, PlanningProblem]:
    """A problem of the library for each model that has one."""
    found: dict[str, PlanningProblem] = {}
    for problem in map(library_problem, LIBRARY):
        found.setdefault(problem.system.model, problem)
    return found


@cache
def problem_of(case: str) -> PlanningProblem:
    """Where a case stands: start and size of the library's problem."""
    if case in DRIFTING:
        return standing(*DRIFTING[case])
    model, _, other = case.partition(",")
    known = library()[model]
    system = system_class(model)(**VARIANTS[model]) if other else known.system
    return standing(system, known.start)


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


# --- the laws ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_holds(law, case, monkeypatch):
    monkeypatch.setattr(kernel_build, "FLAGS", (("-O0", "-fPIC", "-shared"),))  # optimised: test_kernels
    law(problem_of(case))


@pytest.mark.parametrize("case", CASES)
def test_every_system_writes_its_constraints_from_geometry(case):
    system = problem_of(case).system
    assert geometry.has_legs(system) or type(system).constraints is not System.constraints


class Slipping(Ferry):
    def constraints(self, state, velocity):
        return namespace(state).vector([velocity[0]])


class Unbreakable(Ferry):
    def constraints(self, state, velocity):
        return namespace(state).vector([0.0 * velocity[0]])


class Misnamed(Ferry):
    def outputs(self, state, control):
        return {"stern": state[:2] - self.heading(state)}


class Fast(Ferry):
    def linearised(self, state, control):
        return 2 * super().linearised(state, control)


class Deaf(Ferry):
    def vector_fields(self, state):
        return np.array([[math.cos(float(state[2])), 0], [math.sin(float(state[2])), 0], [0, 1]])


class Forgetful(Ferry):
    def parameters(self):
        return {}


class Still(Ferry):
    driftless = True


class Flat(Ferry):
    def drawing(self, state):
        return {"lines": {"hull": np.zeros((2, 3))}, "points": {"bow": np.zeros((1, 2))}}


BROKEN = {
    Slipping: "motions keep the constraints: no. a motion breaks them",
    Unbreakable: "the constraints can be broken: no",
    Misnamed: r"outputs are those declared: no. outputs\(…\) gives \['stern'\]; output_blocks declares \['bow'\]",
    Fast: "linearised is the derivative: no. column 2",
    Deaf: "numbers and symbols move alike",
    Forgetful: "parameters make the same system: no",
    Still: "numbers and symbols move alike: no",
    Flat: "drawings are plain arrays of one dimension: no. points have \\[2, 3\\] coordinates",
}


@pytest.mark.parametrize("broken", BROKEN)
def test_a_system_that_breaks_a_law_is_told_which(broken):
    with pytest.raises(AssertionError, match=f"ferry: {BROKEN[broken]}"):
        check_system(broken(current=0.3), {"position": [0.3, -0.2], "theta": 0.4})


def test_a_sound_system_of_ones_own_passes_and_what_is_none_is_refused():
    check_system(Ferry())
    with pytest.raises(InvalidProblemError, match="expected a system"):
        check_system(Ferry)


# --- the equations ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", DRIFTING)
def test_drift_moves_without_control_and_forbids_what_driftless_systems_may(case):
    problem = problem_of(case)
    assert not problem.system.driftless
    still = np.zeros(problem.system.input_space.size)
    assert apart(exact(problem, lambda t: still, 1.0), problem.start_point) > 0.01
    forth = at(random_control(problem, 6))
    back = exact(problem, lambda t: -forth(1.0 - t), 1.0, exact(problem, forth, 1.0))
    assert apart(back, problem.start_point) > 0.01


# --- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "parameters", "path", "words"),
    [
        ("heisenberg", {"scale": 0}, "system.scale", "0 leaves z where it is"),
        ("heisenberg", {"scale": float("nan")}, "system.scale", "finite"),
        ("heisenberg", {"scale": "1"}, "system.scale", "expected a number, got the text"),
        ("rolling_sphere", {"radius": -1}, "system.radius", "> 0"),
        ("rolling_sphere", {"contact": "glue"}, "system.contact", "none of rubber, marble"),
        ("suslov_joint", {"wheel": 1}, "system.wheel", "suslov_joint has none"),
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
