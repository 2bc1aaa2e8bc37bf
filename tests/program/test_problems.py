"""The gallery: every file goes through `check`, `analyze`, `solve` and `compare`, by the solvers that take part; every
plan is verified, and what is known of it is met."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import nhpocp
from nhpocp.analysis import slices
from nhpocp.cli.entry import status
from tests.conftest import LIBRARY, library_problem

FOLDER = Path(__file__).parents[2] / "problems"
PROBLEMS = {stem: library_problem(stem) for stem in LIBRARY}
METHODS = ("jacobian", "nlp", "sinusoids")
RELATIVE = ("effort", "leg_effort", "path_length")
# those that are not simply controllable: with drift, bounded to one direction, folded or at rest where brackets fail
VERDICTS = {
    **dict.fromkeys(
        ["bryson_denham", "double_integrator", "rigid_body", "satellite_slew"], "strongly accessible"
    ),
    **dict.fromkeys(["dubins", "three_trailers", "truck_docking", "truck_with_trailers"], "undecided"),
    "equal_spheres": "not controllable",
}
RANKS = {
    "cartan_line": 4,
    "equal_spheres": 2,
}  # of the guess's end point, where not full: on abnormal extremals


def named_solver(stem: str) -> str:
    """The solver that a file's first comment names, as in `# nlp: …`; the Jacobian method otherwise."""
    text = (FOLDER / f"{stem}.yaml").read_text(encoding="utf-8")
    named = re.search(r"^# (nlp|sinusoids): ", text, flags=re.MULTILINE)
    return named[1] if named else "jacobian"


def solvers_of(stem: str) -> list[str]:
    """The one that the file names, those with a reference, and both methods where it names none."""
    named, reference = named_solver(stem), PROBLEMS[stem].reference
    planned = not any("outcome" in of for of in reference.values() if isinstance(of, dict))
    both = METHODS[:2] if named == "jacobian" and planned else ()
    return [name for name in METHODS if name == named or name in reference or name in both]


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


@pytest.mark.parametrize("stem", PROBLEMS)
def test_every_verb(stem, tmp_path, monkeypatch, capsys, undrawn):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(slices, "RESOLUTION", 25)  # quicker
    file, quiet = str(FOLDER / f"{stem}.yaml"), ["--set", "output.pictures=false"]
    once = {"nlp": ["--set", "solvers.nlp.mesh_check=false"]}  # the verdict stands; costs are not doubted
    assert status(["check", file]) == 0
    assert status(["analyze", file, *quiet, "-o", "analysis"]) == 0
    meets_what_is_known(stem, json.loads(Path("analysis/analysis.json").read_text()))
    names = solvers_of(stem)
    planned = [
        status(["solve", file, *quiet, *once.get(name, []), "--solver", name, "-o", name]) for name in names
    ]
    assert status(["compare", "--from", *names, "-o", "report"]) == max(planned)
    out = capsys.readouterr()
    assert len(json.loads(Path("report/comparison.json").read_text())["runs"]) == len(names)
    for name, found in zip(names, planned, strict=True):
        solution = nhpocp.load_solution(name)
        meets_its_reference(stem, solution)
        assert found == (0 if solution.converged else 1), out
    assert Path("report/report.html").stat().st_size > 10_000


def meets_what_is_known(stem, analysis):
    verdict = VERDICTS.get(stem, "controllable")
    problem = PROBLEMS[stem]
    assert analysis["controllability"]["verdict"] == verdict
    assert verdict in ("undecided", "not controllable") or not analysis["controllability"]["larc_fails_at"]
    assert analysis["end_point"]["rank"] == RANKS.get(stem, problem.system.state_space.dimension)
    assert set(analysis["points"]) == ({"start", "goal"} if problem.goal_is_a_pose else {"start"})
    if verdict == "controllable":
        assert analysis["generic"]["growth_vector"] == analysis["points"]["start"]["growth_vector"]
    assert len(analysis["path"]["t"]) == len(analysis["path"]["growth_vectors"]) >= 51


def meets_its_reference(stem, solution):
    problem = PROBLEMS[stem]
    reference = problem.reference.get(solution.solver, {})
    tolerance = reference.get("tolerance", problem.reference.get("tolerance"))
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
