"""What a prompt shows of every object that users meet: one line, by which they know it."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import nhpocp
from nhpocp.batch import Plan
from nhpocp.deferred import Deferred, Named
from nhpocp.outcome import Outcome
from nhpocp.plain_text import LONGEST, as_call, brief
from nhpocp.solution import Crossing
from nhpocp.systems.legs import Leg
from tests.conftest import paper_problem

PUBLIC = vars(nhpocp)["_HOMES"]
ENTRY_BY_ENTRY = 400  # characters: a mapping of quantities names each of them


@pytest.fixture(scope="module")
def solution():
    return nhpocp.solve(paper_problem(bounds={"leg_length": [5, 60]}), nhpocp.Auto())


@pytest.fixture(scope="module")
def parts(solution):
    problem = solution.problem
    analysis = nhpocp.analyze(problem)
    comparison = nhpocp.Comparison.of([solution, solution])
    return [
        *(problem, solution, analysis, comparison, problem.system, solution.control, solution.verdict),
        *(
            problem.bounds[0],
            solution.verdict.bounds[0],
            problem.horizon,
            problem.basis,
            problem.system.legs[0],
        ),
        *(analysis.filtration, analysis.path, analysis.end_point, analysis.map, analysis.points["start"]),
        *(comparison.entries[0], comparison.groups[0], nhpocp.Run(problem, nhpocp.Auto(), "mine")),
        *(nhpocp.simulate(problem, solution.control), next(nhpocp.plan_many(problem, [problem.goal]))),
        nhpocp.Via(0.5, {"orientation": np.eye(3)}),
    ]


def test_each_is_one_line_and_names_its_class(parts):
    for part in parts:
        line = repr(part)
        assert "\n" not in line
        assert type(part).__name__ in line
        assert " object at 0x" not in line
        assert len(line) <= 2 * LONGEST, line


def test_a_trajectory_names_its_quantities_and_their_shapes(solution):
    assert repr(solution.costs).startswith("{'effort': ")
    line = repr(Named(solution.trajectory))
    assert len(line) < ENTRY_BY_ENTRY
    assert "'orientation': <array 201 × 3 × 3>" in line


def test_what_is_deferred_is_not_worked_out_to_be_shown():
    deferred = Deferred(lambda: pytest.fail("looked at"), {"effort": 2.0})
    assert repr(deferred) == "{'effort': 2, …}"
    assert repr(Deferred(dict)) == "{…}"


def test_a_solution_says_how_it_ended(solution):
    error, effort = f"{solution.verdict.error:.3g}", f"{solution.control.effort:.6g}"
    assert repr(solution) == (
        f"<Solution of 'problem' by jacobian: converged, E = {error}, effort {effort}, "
        f"{solution.evaluations} evaluations>"
    )
    failed = replace(solution, outcome=Outcome.SINGULAR_S, verdict=replace(solution.verdict, ok=False))
    assert "singular_s, E = " in repr(failed)
    assert "nobody has verified it" in repr(replace(solution, verdict=None))
    refuted = replace(solution.verdict, ok=False, reasons=["E is too large"], crossings=[CROSSING])
    assert repr(refuted) == f"<Verdict refuted: E is too large, E = {error}, 1 crossings>"


CROSSING = Crossing("det_w", 0.54, {}, True)
WRITTEN = [
    (nhpocp.Fourier(3), "Fourier(harmonics=3)"),
    (nhpocp.Euler(0.5), "Euler(gamma=0.5)"),
    (nhpocp.Horizon(), "Horizon(initial=1)"),
    (nhpocp.Horizon(None, 1, 2), "Horizon(initial=None, minimum=1, maximum=2)"),
    (nhpocp.Continuation(), "Continuation(step_rule=Euler(gamma=0.1))"),
    (nhpocp.MultipleShooting(20, seed=3), "MultipleShooting(intervals=20, seed=3)"),
    (nhpocp.RungeKutta4(50), "RungeKutta4(steps=50)"),
    (nhpocp.Unicycle(), "Unicycle(width=0.2)"),
    (nhpocp.Heisenberg(scale=2), "Heisenberg(scale=2)"),
    (
        nhpocp.ThreeUPU(base_radius=20),
        "ThreeUPU(base_radius=20, platform_radius=15, roller_tilt=1.309, platform_axis='radial', "
        "joint='veselova', form='feedback')",
    ),
    (
        nhpocp.ThreeUPU(legs=[Leg((i, 0, 0), (0, i, 0), (0, 0, 1), (1, 0, 0)) for i in (1, 2, 3)]),
        "ThreeUPU(legs=<list of 3>, form='feedback')",
    ),
    (nhpocp.Interpreted(), "Interpreted()"),
    (CROSSING, "<Crossing of det W = 0 at t = 0.54>"),
    (
        Plan(Outcome.CONVERGED, "", 1e-4, nhpocp.Control(nhpocp.Fourier(0), [[1.0]]), 5),
        "<Plan converged: E = 0.0001, 5 evaluations, unverified>",
    ),
]


@pytest.mark.parametrize(("made", "line"), WRITTEN, ids=lambda value: type(value).__name__)
def test_settings_and_systems_are_written_as_one_would_type_them(made, line):
    assert repr(made).startswith(line)


@pytest.mark.parametrize("made", [made for made, line in WRITTEN if "<" not in line])
def test_a_line_that_is_a_call_makes_the_object_again(made):
    again = eval(repr(made), {name: getattr(nhpocp, name) for name in PUBLIC} | {"Leg": Leg})
    assert type(again) is type(made)
    assert repr(again) == repr(made)


def test_a_class_of_ones_own_is_shown_so_too():
    @dataclass(frozen=True)
    class Damping(nhpocp.GeneralizedInverse):
        weight: float = 1.0
        label: str | None = None

        def apply(self, jacobian, error):  # pragma: no cover
            raise NotImplementedError

    Damping.__abstractmethods__ = frozenset()
    assert repr(Damping(2.5)) == "Damping(weight=2.5)"


@given(
    st.recursive(
        st.text() | st.floats() | st.integers() | st.none(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner) | st.tuples(inner, inner),
    )
)
def test_any_value_is_one_line_without_control_sequences(value):
    for line in (brief(value), as_call("f", [("x", value, None), ("y", value, value)])):
        assert line.isprintable() or not any(ord(letter) < 32 or 127 <= ord(letter) < 160 for letter in line)
        assert len(line.splitlines()) <= 1
