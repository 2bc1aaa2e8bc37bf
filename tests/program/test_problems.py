"""The problem library: every file is solved by every solver it has a reference for, and meets it."""

from __future__ import annotations

from pathlib import Path

import pytest

import nhpocp
from nhpocp.problem import PlanningProblem

FILES = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
PROBLEMS = {file.stem: nhpocp.load_problem(file) for file in FILES}
METHODS = ("jacobian", "nlp")
RELATIVE = ("effort", "leg_effort", "path_length")


def known(problem: PlanningProblem) -> list[str]:
    """The solvers with a reference; nlp among them once this version has it."""
    return [
        name for name in METHODS if name in problem.reference and (name != "nlp" or name in problem.solvers)
    ]


CASES = [(stem, name) for stem, problem in PROBLEMS.items() for name in known(problem)]


@pytest.mark.parametrize("stem", PROBLEMS)
def test_every_file_names_a_reference_and_its_source(stem):
    reference = PROBLEMS[stem].reference
    assert set(METHODS) & set(reference), "no solver has a reference"
    assert reference.get("source"), "whose numbers are they?"
    for name in set(METHODS) & set(reference):
        assert reference[name].get("tolerance", reference.get("tolerance")), f"{name}: to how many digits?"
        assert {*RELATIVE, "horizon", "iterations", "evaluations"} & set(reference[name])


@pytest.mark.parametrize(("stem", "name"), CASES, ids=map(" by ".join, CASES))
def test_reference_is_met(stem, name):
    problem = PROBLEMS[stem]
    reference = problem.reference[name]
    tolerance = reference.get("tolerance", problem.reference.get("tolerance"))
    solution = nhpocp.solve(problem, problem.solvers[name])
    assert solution.verdict is not None
    assert solution.verdict.ok, solution.verdict.reasons
    assert solution.converged, solution.message
    for quantity in RELATIVE:
        if quantity in reference:
            found = solution.costs[quantity]
            assert found == pytest.approx(reference[quantity], rel=tolerance), quantity
    if "horizon" in reference:
        assert solution.control.horizon == pytest.approx(reference["horizon"], rel=tolerance)
    if "iterations" in reference:
        assert solution.iterations[-1]["k"] == reference["iterations"]
    if "evaluations" in reference:
        assert solution.evaluations == reference["evaluations"]
