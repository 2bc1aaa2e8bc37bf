"""What a folder states is worked out again: nothing is held against one as it was written, every edit is."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.cli.entry import status
from nhpocp.comparison_folder import load_comparison
from nhpocp.constraints.bound import Bound
from nhpocp.controls.control import Control
from nhpocp.errors import UnreadableSolutionError
from nhpocp.horizon import Horizon
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem_file import parse_problem, starter
from nhpocp.problem_file.registry import SYSTEMS
from nhpocp.solution_folder import audit, load_solution, save_solution
from nhpocp.solution_folder.plain_data import as_text, checksum
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.multi_start import MultiStart
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from nhpocp.solvers.least_squares import LeastSquares, LeastSquaresSettings
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.verification import verify
from nhpocp.verification.costs import replayed_costs
from tests.conftest import PAPER_START, paper_problem

BOUNDS = [Bound("leg_length", "leg_lengths", 20.0, 60.0)]
# words, times and the place of the run: a checksum alone says whether they are as they were written
FREE = {"message", "warnings", "details", "timing", "environment"}
OF_THE_OPTIMIZER = {"evaluations"}  # what IPOPT counted cannot be counted again


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Any]:
    """A folder of each solver, of a path that crosses det W = 0, and one without checksum."""
    home = tmp_path_factory.mktemp("audits")
    problem = paper_problem("paper_conjecture", bounds=BOUNDS, samples=41)
    solutions = {
        "jacobian": planning.solve(problem, Continuation(step_rule=Euler(1.0))),
        "nlp": planning.solve(replace(problem, bounds=()), MultipleShooting(intervals=8)),
    }
    return {name: save_solution(solution, home / name) for name, solution in solutions.items()}


def edited(folder, home, key: str, value: Any, keep_checksum: bool = False):
    """A copy of a folder with one entry of solution.json changed; without the checksum, as a folder of 0.1 is."""
    copy = home / "copy"
    if copy != folder:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
    data = json.loads((copy / "solution.json").read_text())
    data[key] = value
    if not keep_checksum:
        data.pop("checksum", None)
    (copy / "solution.json").write_text(as_text(data))
    return copy


def another(value: Any) -> Any:
    """Something else of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, str):
        return f"{value}x"
    if isinstance(value, list):
        return [another(value[0]), *value[1:]] if value else ["x"]
    if isinstance(value, dict):
        key = next(iter(value), "x")
        return {**value, key: another(value.get(key, 0))}
    return 1.5


def noticed(folder, key: str) -> bool:
    """Whether `verify` ends with another status, or says that it cannot judge what the folder has for this key."""
    try:
        found = audit(folder)
    except UnreadableSolutionError:
        return True
    return not found.ok or any(sentence.startswith((f"{key}:", f"{key}.")) for sentence in found.unchecked)


# --- as it was written ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
def test_a_folder_as_written_is_confirmed(folders, solver, tmp_path):
    found = audit(folders[solver])
    assert found.verdict.ok
    assert found.differences == []
    assert status(["verify", str(folders[solver])]) == 0
    without = edited(folders[solver], tmp_path, "name", found.solution.problem.name)
    assert audit(without).differences == []  # as 0.1 wrote it
    assert any("checksum" in sentence for sentence in audit(without).unchecked)


@pytest.mark.parametrize("model", SYSTEMS)
def test_no_system_states_what_is_not_found_again(model, tmp_path):
    problem = replace(parse_problem(starter(model)), samples=21, pictures=False, bounds=())
    for solver in (Continuation(step_rule=Adaptive(), max_iterations=5), _few(1, 3)):
        folder = save_solution(planning.solve(problem, solver), tmp_path / solver.name)
        assert audit(folder).differences == []


def _few(iterations: int, intervals: int = 6) -> MultipleShooting:
    return MultipleShooting(
        intervals=intervals, steps_per_interval=1, optimizer=Ipopt(max_iterations=iterations)
    )


ENDINGS = {
    "auto": (paper_problem(), Auto()),
    "least cost": (paper_problem(), Auto(Continuation(step_rule=Adaptive(), objective="effort"))),
    "starts": (paper_problem(initial=np.zeros((3, 5))), MultiStart(Continuation(step_rule=Adaptive()), 2)),
    "stopped early": (paper_problem(), Continuation(max_iterations=2)),
    "not finite": (paper_problem("vertical_equal", initial=40 * PAPER_START), Continuation()),
    "crossing": (paper_problem("paper_conjecture"), Continuation(step_rule=Euler(0.5))),
    "goal out of bounds": (
        paper_problem(bounds=[Bound("leg_length", "leg_lengths", 20.0, 30.0)]),
        Continuation(),
    ),
    "goal out of bounds of the NLP": (
        paper_problem(bounds=[Bound("leg_length", "leg_lengths", 20.0, 30.0)]),
        _few(20),
    ),
    "endless": (paper_problem(horizon=Horizon(1.0, 0.5, None)), _few(20)),
    "free horizon": (paper_problem(horizon=Horizon(1.0, 0.5, 2.0), objective="time"), _few(8)),
    "no cost lowered": (paper_problem(), LeastSquares(LeastSquaresSettings())),
    "starts of the NLP": (paper_problem(), replace(_few(8), starts=2)),
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_no_ending_states_what_is_not_found_again(ending, tmp_path):
    problem, solver = ENDINGS[ending]
    solution = planning.solve(replace(problem, samples=21), solver)
    assert audit(save_solution(solution, tmp_path / "out")).differences == []


def test_an_objective_that_nothing_was_tried_for_may_be_missing(tmp_path):
    problem, solver = ENDINGS["goal out of bounds of the NLP"]
    foreseen = planning.solve(replace(problem, samples=21), solver)
    assert foreseen.objective == "effort"
    assert audit(save_solution(replace(foreseen, objective="none"), tmp_path / "out")).differences == []


def test_an_interrupted_or_unverified_solve_states_nothing_else(tmp_path):
    solved = planning.solve(paper_problem(samples=21), Continuation(step_rule=Euler(1.0)))
    for solution in (replace(solved, outcome=Outcome.INTERRUPTED), replace(solved, verdict=None)):
        assert audit(save_solution(solution, tmp_path / "out")).differences == []


# --- edited ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> dict[str, Any]:
    """Folders of a small system, whose replay takes little."""
    home = tmp_path_factory.mktemp("small")
    problem = replace(parse_problem(starter("heisenberg")), samples=21, pictures=False)
    solvers = (Continuation(step_rule=Adaptive()), _few(40))
    return {
        solver.name: save_solution(planning.solve(problem, solver), home / solver.name) for solver in solvers
    }


@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
def test_every_edit_of_a_key_is_noticed(small, solver, tmp_path):
    """Every key that the file has, so that none can be forgotten; with the checksum even the free words."""
    data = json.loads((small[solver] / "solution.json").read_text())
    unseen = set()
    for key, value in data.items():
        if key == "checksum":
            continue
        if not noticed(edited(small[solver], tmp_path, key, another(value)), key):
            unseen.add(key)
    assert unseen <= FREE | (OF_THE_OPTIMIZER if solver == "nlp" else set())
    for key in [*sorted(unseen), "checksum"]:
        assert noticed(edited(small[solver], tmp_path, key, another(data[key]), keep_checksum=True), key)


@pytest.mark.parametrize("key", ["system", "converged", "length_scale"])
def test_a_key_that_was_removed_is_noticed(small, key, tmp_path):
    copy = edited(small["jacobian"], tmp_path, key, None)
    data = json.loads((copy / "solution.json").read_text())
    del data[key]
    (copy / "solution.json").write_text(as_text(data))
    assert f"{key} is missing in solution.json" in audit(copy).differences


EDITS = [  # that may be made at once: each is said by itself
    ("effort", 1.0, "effort is 1; worked out again it is 1.69269"),
    ("leg_effort", 500.0, "leg_effort is 500"),
    ("path_length", 20.0, "path_length is 20"),
    ("system.base_radius", 99.0, "system.base_radius is 99"),
    ("final_error", 1e-9, "final_error is 1e-09"),
    ("evaluations", 3, "evaluations is 3"),
    ("length_scale", 1.0, "length_scale is 1"),
    ("crossings.0.t", 0.4, "crossings[0].t is 0.4"),
    ("constraints.leg_length.worst", 3.0, "constraints.leg_length.worst is 3"),
    ("verified.rolling", 0.5, "verified.rolling is 0.5"),
    ("verified.original.reached_t", 1.0, "verified.original.reached_t is 1"),
    ("settings.max_iterations", 7, "settings.max_iterations is 7; problem.yaml says 500"),
    ("settings.step_rule", "adaptive", "settings.step_rule is"),
]
ALONE = [  # each of these is judged by what the others say
    ("outcome", "stagnated", "converged is true"),
    ("converged", False, "converged is false"),
    ("crossings", [], "crossings is []"),
    ("verified.ok", False, "verified.ok is false"),
    ("objective", "effort", "objective is"),
]


@pytest.mark.parametrize(
    "edits", [EDITS, *([edit] for edit in ALONE)], ids=["at once", *(edit[0] for edit in ALONE)]
)
def test_what_differs_is_said(folders, edits, tmp_path):
    copy = folders["jacobian"]
    data = json.loads((copy / "solution.json").read_text())
    for path, value, _ in edits:
        *parts, last = (int(part) if part.isdigit() else part for part in path.split("."))
        place = data
        for part in parts:
            place = place[part]
        place[last] = value
        copy = edited(copy, tmp_path, path.split(".")[0], data[path.split(".")[0]])
    audited = audit(copy)
    for _, _, said in edits:
        assert any(sentence.startswith(said) for sentence in audited.differences), audited.differences
    assert not audited.ok


def test_a_folder_of_euler_from_before_auto_was_the_default_is_right(tmp_path):
    solved = planning.solve(paper_problem(samples=21), Continuation(step_rule=Euler(0.5)))
    folder = save_solution(solved, tmp_path / "old")
    written = (folder / "problem.yaml").read_text()
    assert "step_rule: euler" in written
    (folder / "problem.yaml").write_text(written.replace("step_rule: euler", "", 1).replace("{, ", "{"))
    assert audit(edited(folder, tmp_path, "name", "problem")).differences == []
    other = {**solved.settings, "step_rule": "adaptive"}
    assert any(
        "settings.step_rule" in s for s in audit(edited(folder, tmp_path, "settings", other)).differences
    )


def test_a_tolerance_raised_in_the_folder_alone_is_noticed(folders, tmp_path):
    """The problem file's settings count, which hold what --set said as well."""
    data = json.loads((folders["jacobian"] / "solution.json").read_text())
    raised = edited(folders["jacobian"], tmp_path, "settings", {**data["settings"], "tolerance": 10.0})
    raised = edited(raised, tmp_path, "tolerance", 10.0)
    assert any("settings.tolerance is 10; problem.yaml says 0.001" in s for s in audit(raised).differences)


def test_costates_that_are_no_table_are_noticed(folders, tmp_path):
    data = json.loads((folders["nlp"] / "solution.json").read_text())
    data["details"]["costates"][2][1] = None
    found = audit(edited(folders["nlp"], tmp_path, "details", data["details"]))
    assert any(sentence.startswith("details.costates is no table") for sentence in found.differences)
    assert any(sentence.startswith("details.costates: only their shape") for sentence in found.unchecked)


def test_a_trajectory_table_that_was_edited_is_noticed(folders, tmp_path):
    copy = shutil.copytree(folders["jacobian"], tmp_path / "copy")
    lines = (copy / "trajectory.csv").read_text().splitlines()
    cells = lines[7].split(",")
    for changed, said in (
        (["0.5", *cells[1:]], "trajectory.csv: t is 0.5 in row 7"),
        ([*cells[:3], "", *cells[4:]], "is empty in row 7"),
        (cells[1:], "trajectory.csv has 41 rows"),
    ):
        (copy / "trajectory.csv").write_text("\n".join([*lines[:7], ",".join(changed), *lines[8:]]))
        assert any(said in sentence for sentence in audit(copy).differences)
    (copy / "trajectory.csv").write_text("\n".join(lines[:-1]))
    assert any("trajectory.csv has 40 rows; the trajectory has 41" in s for s in audit(copy).differences)
    (copy / "trajectory.csv").unlink()
    assert audit(copy).differences == []


@pytest.mark.parametrize(
    ("horizon", "said"),
    [
        (Horizon(10.0), "the control lasts 1; the problem's horizon is 10"),
        (Horizon(None, 2.0, 3.0), "the control lasts 1, outside the problem's horizon [2, 3]"),
        (Horizon(None, None, 0.5), "outside the problem's horizon [0, 0.5]"),
        (Horizon(1.0), None),
        (Horizon(None, 0.5, 1.0), None),
    ],
)
def test_a_control_of_another_duration_is_refuted(folders, horizon, said):
    solution = load_solution(folders["jacobian"])
    verdict = verify(replace(solution, problem=replace(solution.problem, horizon=horizon)))
    assert verdict.ok == (said is None)
    assert said is None or any(said in reason for reason in verdict.reasons)


def test_a_checksum_does_not_ask_how_a_number_is_written():
    assert checksum({"a": [1, 2.5], "b": True}) == checksum({"b": True, "a": [1.0, 2.5], "checksum": "x"})
    assert checksum({"a": True}) != checksum({"a": 1})


def test_costs_that_are_known_otherwise():
    """The effort from the Gram matrix; nothing for standing still."""
    problem = paper_problem(goal={"position": [0, 0, 30]})
    still = Control(problem.basis, np.zeros((3, 5)))
    assert replayed_costs(problem, still) == dict.fromkeys(costs_of_motion(), 0.0)
    control = Control(problem.basis, PAPER_START)
    assert replayed_costs(problem, control)["effort"] == pytest.approx(control.effort, rel=1e-12)


# --- a comparison of folders -----------------------------------------------------------------------------------------


def test_a_comparison_of_folders_trusts_none_of_them(folders, tmp_path):
    assert load_comparison(list(folders.values())).notes == []
    data = json.loads((folders["jacobian"] / "solution.json").read_text())
    data["control"]["coefficients"][2][0] += 0.01
    forged = edited(folders["jacobian"], tmp_path, "control", data["control"])
    found = load_comparison([forged, folders["nlp"]])
    assert [entry.solution.converged for entry in found.entries] == [False, True]
    assert found.entries[0].solution.outcome is Outcome.NOT_VERIFIED
    assert any("effort is" in note and str(forged) in note for note in found.notes)
    assert not found.all_converged
