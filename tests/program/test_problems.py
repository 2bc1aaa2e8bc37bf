"""The gallery: every file is solved and verified by the solvers that take part, and meets its references."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import nhpocp

FILES = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
PROBLEMS = {file.stem: nhpocp.load_problem(file) for file in FILES}
METHODS = ("jacobian", "nlp", "sinusoids")
RELATIVE = ("effort", "leg_effort", "path_length")


def named_solver(stem: str) -> str:
    """The solver that a file's first comment names, as in `# nlp: …`; the Jacobian method otherwise."""
    text = (FILES[0].parent / f"{stem}.yaml").read_text(encoding="utf-8")
    named = re.search(r"^# (nlp|sinusoids): ", text, flags=re.MULTILINE)
    return named[1] if named else "jacobian"


def solvers_of(stem: str) -> list[str]:
    """The one that the file names, those with a reference, and both methods where it names none."""
    named, reference = named_solver(stem), PROBLEMS[stem].reference
    planned = not any("outcome" in of for of in reference.values() if isinstance(of, dict))
    both = METHODS[:2] if named == "jacobian" and planned else ()
    return [name for name in METHODS if name == named or name in reference or name in both]


CASES = [(stem, name) for stem in PROBLEMS for name in solvers_of(stem)]


@pytest.mark.parametrize("stem", PROBLEMS)
def test_a_reference_names_its_source(stem):
    reference = PROBLEMS[stem].reference
    if not reference:
        return  # nobody knows one
    assert set(METHODS) & set(reference), "no solver has a reference"
    assert reference.get("source"), "whose numbers are they?"
    for name in set(METHODS) & set(reference):
        exact = set(reference[name]) <= {"outcome", "iterations", "evaluations"}
        assert exact or reference[name].get("tolerance", reference.get("tolerance")), (
            f"{name}: to how many digits?"
        )
        assert {*RELATIVE, "outcome", "horizon", "iterations", "evaluations"} & set(reference[name])


@pytest.mark.parametrize(("stem", "name"), CASES, ids=map(" by ".join, CASES))
def test_it_is_solved_and_meets_its_reference(stem, name):
    problem = PROBLEMS[stem]
    reference = problem.reference.get(name, {})
    tolerance = reference.get("tolerance", problem.reference.get("tolerance"))
    solution = nhpocp.solve(problem, problem.solvers[name])
    if "outcome" in reference:  # there is no plan, and that is what is known
        assert solution.outcome.value == reference["outcome"]
        return
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
