"""Comparisons as data and as files: rows, claims, gaps, folders, and the verb `compare`."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nhpocp.cli.entry import status
from nhpocp.comparison import Comparison, Entry, Run, compare
from nhpocp.comparison_folder import load_comparison, plan, write_comparison
from nhpocp.constraints.bound import Bound, BoundReport
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError, NhpocpWarning, UnreadableSolutionError
from nhpocp.flow.simulation import simulate
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.problem_file import load_problem, variant
from nhpocp.solution import Solution, Verdict
from nhpocp.solution_folder import folder_name, save_solution
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.views.report import write_report
from tests.conftest import Integrators, paper_problem

PROBLEMS = Path(__file__).parents[1] / "problems"
# the contract's keys, in its order
KEYS = [
    "name",
    "solver",
    "variant",
    "folder",
    "outcome",
    "converged",
    "verified_error",
    "effort",
    "leg_effort",
]
KEYS += ["path_length", "evaluations", "build_s", "solve_s", "claim_right"]
FAST = [
    "--set",
    "solvers.jacobian.gamma=1",
    "--set",
    "solvers.nlp.intervals=20",
    "--set",
    "solvers.nlp.tolerance=1e-3",
    "--set",
    "output.pictures=false",
]


def line(goal: float = 1.0, **changes: Any) -> PlanningProblem:
    """Two integrators from the origin to (goal, 0)."""
    values = {
        "system": Integrators(),
        "start": {"x": 0, "y": 0},
        "goal": {"x": goal, "y": 0},
        "pictures": False,
    }
    return PlanningProblem(**{**values, "name": "line", **changes})


def made(scale: float = 1.0, ok: bool | None = True, **changes: Any) -> Solution:
    """A Solution by hand: u = scale·(1 + sin), whose effort is 1.5·scale²."""
    problem = changes.pop("problem", line())
    coefficients = np.zeros((2, problem.basis.size))
    coefficients[0, :2] = scale
    control = Control(problem.basis, coefficients, 1.0)
    motion = simulate(problem, control)
    verdict = None if ok is None else Verdict(1e-9 if ok else 2.0, ok, "by hand", [] if ok else ["E = 2"])
    values: dict[str, Any] = {
        "problem": problem,
        "solver": "jacobian",
        "settings": {"gamma": 0.1},
        "tolerance": 1e-3,
        "outcome": Outcome.CONVERGED,
        "message": "done.",
        "final_error": 0.0,
        "control": control,
        "trajectory": motion.trajectory,
        "costs": motion.costs,
        "iterations": [{"k": 0, "error": 1.0}],
        "evaluations": 1,
        "verdict": verdict,
        "timing": {"build_s": 0.1, "solve_s": 0.2},
    }
    return Solution(**{**values, **changes})


def run(*arguments: Any, cwd: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from nhpocp.cli import main; main()", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False, **options
    )


def here(*arguments: Any, cwd: Path) -> subprocess.CompletedProcess[str]:
    """What `run` returns, without a process of its own."""
    out, err = io.StringIO(), io.StringIO()
    words = [str(word) for word in arguments]
    with contextlib.chdir(cwd), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = status(words)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """The unicycle's problem by both methods and in one space of controls."""
    home = tmp_path_factory.mktemp("compared")
    variant = ("--variant", "nlp:control=basis")
    done = run("compare", PROBLEMS / "unicycle.yaml", *FAST, *variant, "-o", "out", "--json", cwd=home)
    assert done.returncode == 0, done.stderr
    return home, done


# --- rows -----------------------------------------------------------------------------------------------------------


def test_a_row_has_the_contracts_keys_first():
    row = Comparison.of([made()]).rows()[0]
    assert [key for key in row if key in KEYS] == KEYS
    assert row["effort"] == pytest.approx(1.5)
    assert (row["name"], row["variant"], row["folder"], row["iterations"]) == ("line", "jacobian", None, 0)


@pytest.mark.parametrize(
    ("outcome", "ok", "right"),
    [
        (Outcome.CONVERGED, True, True),
        (Outcome.CONVERGED, None, None),  # a claim that nobody has judged
        (Outcome.NOT_VERIFIED, False, None),  # in the solver's own eyes, as the message says
        (Outcome.CONSTRAINT_VIOLATED, False, None),
        (Outcome.STAGNATED, False, None),
        (Outcome.STAGNATED, True, None),  # it claimed nothing, so it was not right either
        (Outcome.SOLVER_ERROR, None, None),
        (Outcome.INTERRUPTED, False, None),
    ],
)
def test_claim_right_is_about_claims_only(outcome, ok, right):
    assert Entry.of(made(ok=ok, outcome=outcome)).claim_right is right


@pytest.mark.parametrize("outcome", [Outcome.NOT_VERIFIED, Outcome.CONSTRAINT_VIOLATED])
def test_a_refuted_claim_is_a_claim(outcome):
    broken = BoundReport(Bound("input", np.array(-1.0), np.array(1.0)), 1.0, 0.5, (0,), ok=False)
    reports = [broken] if outcome is Outcome.CONSTRAINT_VIOLATED else []
    judged = made(ok=None).judged(Verdict(2.0, False, "by hand", ["E = 2"], bounds=reports))
    assert judged.outcome is outcome
    assert Entry.of(judged).claim_right is False


def test_the_gap_is_to_the_best_verified_run_of_the_same_task():
    cheap_but_wrong = made(0.5, ok=False, outcome=Outcome.NOT_VERIFIED, settings={"gamma": 3})
    runs = [made(1.0), made(1.1, settings={"gamma": 1}), cheap_but_wrong, made(9.0, problem=line(goal=9.0))]
    rows = Comparison.of(runs).rows()
    assert [row["optimality_gap"] for row in rows] == [0.0, pytest.approx(0.21), None, 0.0]


@pytest.mark.parametrize(("objective", "value"), [("effort", 1.5), ("path_length", None), ("time", 1.0)])
def test_the_gap_is_in_the_problems_own_objective(objective, value):
    row = Comparison.of([made(problem=line(objective=objective))]).rows()[0]
    assert row["objective"] == objective
    assert row["objective_value"] == pytest.approx(value if value is not None else row["path_length"])
    assert row["optimality_gap"] == 0


def test_a_run_that_evaluated_nothing_has_no_numbers_of_a_motion():
    row = Comparison.of(
        [made(0.0, ok=None, evaluations=0, iterations=[], outcome=Outcome.INFEASIBLE)]
    ).rows()[0]
    assert row["effort"] is row["path_length"] is row["objective_value"] is None
    assert row["reason"] == "done."


def test_numbers_that_are_not_finite_are_null():
    solution = made(ok=False, outcome=Outcome.NOT_FINITE, costs={"effort": np.nan, "path_length": np.inf})
    comparison = Comparison.of([solution])
    json.dumps(comparison.to_json(), allow_nan=False)
    assert comparison.rows()[0]["path_length"] is None


def test_csv_has_the_columns_and_values_of_the_json():
    comparison = Comparison.of([made(), made(ok=False, outcome=Outcome.NOT_VERIFIED)], ["a, b", None])
    rows = comparison.rows()
    table = list(csv.DictReader(io.StringIO(comparison.to_csv())))
    assert list(table[0]) == list(rows[0])
    for words, row in zip(table, rows, strict=True):
        for key, value in row.items():
            flags = {None: "", True: "true", False: "false"}
            expected = flags[value] if value is None or isinstance(value, bool) else str(value)
            assert words[key] == expected


def test_names_that_are_used_twice_are_told_apart_by_their_settings():
    runs = [made(), made(settings={"gamma": 0.5}), made(settings={"gamma": 0.5})]
    variants = [entry.variant for entry in Comparison.of(runs).entries]
    assert variants == ["jacobian:gamma=0.1", "jacobian:gamma=0.5", "jacobian:gamma=0.5 (2)"]


def test_runs_that_differ_in_their_control_are_called_by_it():
    runs = [made(problem=line(basis=Fourier(h), initial=None)) for h in (1, 2, 5)]
    runs += [made(problem=line(basis=Fourier(5), initial=np.zeros((2, 11))))]
    comparison = Comparison.of(runs)
    assert len(comparison.groups) == 1
    assert [entry.variant for entry in comparison.entries] == [
        *(f"jacobian:control.harmonics={h},control.initial=auto" for h in (1, 2, 5)),
        "jacobian:control.harmonics=5,control.initial=given",
    ]


def test_two_tasks_of_one_name_are_two_groups():
    groups = Comparison.of([made(), made(problem=line(goal=2.0)), made(solver="nlp")]).groups
    assert [group.title for group in groups] == ["line", "line (2)"]
    assert [len(group.entries) for group in groups] == [2, 1]


# --- compare --------------------------------------------------------------------------------------------------------


class Scripted:
    """A solver that does what the test says."""

    name = "jacobian"
    tolerance = 1e-3

    def __init__(self, action: Any) -> None:
        self.action = action

    def settings(self) -> dict[str, Any]:
        return {"gamma": 0.1}

    def solve(self, problem: PlanningProblem, progress: Any = None) -> Solution:
        return self.action(problem)


def raising(error: BaseException) -> Scripted:
    def fail(problem: PlanningProblem) -> Solution:
        raise error

    return Scripted(fail)


@pytest.mark.parametrize(
    "error",
    [
        InvalidProblemError("not for me"),
        RuntimeError("CasADi"),
        MemoryError(),
        TypeError("int + NoneType"),
        IndexError("list index out of range"),
        AssertionError(),
        OSError(28, "No space left on device"),
        StopIteration(),
    ],
    ids=lambda error: type(error).__name__,
)
def test_what_a_solver_cannot_take_is_a_failed_row(error):
    good = Scripted(lambda problem: made(ok=None, problem=problem))
    found = compare([Run(line(), raising(error), "one"), Run(line(), good, "two")])
    first, second = found.rows()
    assert (first["outcome"], first["converged"], first["claim_right"]) == ("solver_error", False, None)
    assert str(error) in first["reason"]
    assert second["converged"] is True
    assert not found.all_converged


@pytest.mark.parametrize(
    "error", [InvalidProblemError("cannot write here"), OSError(28, "No space left on device")]
)
def test_a_run_that_cannot_be_stored_is_a_note(error):
    def store(solution: Solution, run: Run) -> str:
        if run.variant == "one":
            raise error
        return "there"

    good = Scripted(lambda problem: made(ok=None, problem=problem))
    found = compare([Run(line(), good, "one"), Run(line(), good, "two")], finished=store)
    assert [entry.folder for entry in found.entries] == [None, "there"]
    (note,) = found.notes
    assert note.startswith("line by one could not be stored: ")
    assert not found.all_converged


def test_a_free_horizon_is_a_failed_row_of_the_jacobian_method():
    problem = paper_problem(horizon=Horizon(initial=None, minimum=0.5, maximum=2.0))
    row = compare([Run(problem, Continuation(), "jacobian")]).rows()[0]
    assert row["outcome"] == "solver_error"
    assert "the horizon is free" in row["reason"]


def test_ctrl_c_keeps_what_there_is():
    stored: list[str] = []

    def solve(problem: PlanningProblem) -> Solution:
        signal.raise_signal(signal.SIGINT)
        return made(ok=None, problem=problem, outcome=Outcome.INTERRUPTED)

    good = Scripted(lambda problem: made(ok=None, problem=problem))
    runs = [Run(line(), good, "one"), Run(line(), Scripted(solve), "two"), Run(line(), good, "three")]
    found = compare(runs, finished=lambda solution, run: stored.append(run.variant))
    assert [entry.variant for entry in found.entries] == stored == ["one", "two"]
    assert found.notes == ["Stopped by hand; not run: line by three."]
    assert not found.all_converged


def test_progress_says_which_run_it_is_of():
    records: list[Any] = []
    compare([paper_problem()], ["jacobian"], progress=records.append)
    assert records[0]["k"] == 0
    assert {record["variant"] for record in records} == {"jacobian"}


def test_an_unknown_variant_is_refused():
    with pytest.raises(InvalidProblemError, match="unknown solver 'foo'"):
        compare([line()], ["foo"])


# --- variants and folders -------------------------------------------------------------------------------------------


def test_a_variant_changes_its_solver_and_nothing_else():
    problem = load_problem(PROBLEMS / "paper.yaml")
    changed, solver = variant(problem, "nlp:control=basis,intervals=40")
    assert solver.settings()["control"] == "basis"
    assert solver.settings()["intervals"] == 40
    assert changed.name == problem.name
    assert changed.solvers["jacobian"].settings() == problem.solvers["jacobian"].settings()
    assert variant(problem, "nlp") == (problem, problem.solvers["nlp"])


def test_a_variant_of_a_problem_made_in_python():
    _, solver = variant(paper_problem(), "jacobian:step_rule=euler,gamma=0.5")
    assert solver.settings()["gamma"] == 0.5
    with pytest.warns(NhpocpWarning, match=r"jacobian:gamma=0.5: solvers\.jacobian\.gamma: 0.5 does nothing"):
        variant(paper_problem(), "jacobian:gamma=0.5")
    assert variant(paper_problem(), "nlp")[1].name == "nlp"


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("foo", "'foo' is no solver"),
        ("nlp:", "expected solver:key=value"),
        ("nlp:control", "expected solver:key=value"),
        ("nlp:contrl=basis", "did you mean 'control'.*--variant nlp:contrl=basis"),
        ("nlp:intervals=0", "--variant nlp:intervals=0"),
    ],
)
def test_a_bad_variant_is_named(label, words):
    with pytest.raises(InvalidProblemError, match=words):
        variant(load_problem(PROBLEMS / "paper.yaml"), label)


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("nlp:control=basis", "nlp-control-basis"),
        ("a/b", "a-b"),
        ("..", "problem-"),
        ("report.html", "report.html-"),
    ],
)
def test_folder_names_stay_inside(name, folder):
    assert folder_name(name) == folder


def test_a_plan_has_both_solvers_and_each_variant_once(tmp_path):
    problem = load_problem(PROBLEMS / "paper.yaml")
    runs = plan([problem], ["nlp:control=basis", "nlp", "nlp:control=basis"], tmp_path)
    names = ["jacobian", "nlp", "nlp-control-basis"]
    assert list(runs) == [str(tmp_path / "paper" / name) for name in names]


def test_two_problems_of_one_name_are_refused(tmp_path):
    with pytest.raises(InvalidProblemError, match="two problems would both be stored"):
        plan([paper_problem(name="a b"), paper_problem(name="a-b")], [], tmp_path)


def test_two_variants_of_one_folder_are_refused(tmp_path):
    with pytest.raises(InvalidProblemError, match="same folder"):
        plan([paper_problem()], ["nlp:tolerance=1e-3", "nlp:tolerance=1e+3"], tmp_path)


def test_folders_that_are_not_ours_are_left_alone(tmp_path):
    (tmp_path / "problem" / "nlp").mkdir(parents=True)
    (tmp_path / "problem" / "nlp" / "thesis.tex").write_text("mine")
    with pytest.raises(InvalidProblemError, match="not written by nhpocp"):
        plan([paper_problem()], [], tmp_path)


def test_only_files_of_ours_are_replaced(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "comparison.csv").write_text("name,solver,variant,old")
    write_comparison(Comparison.of([made()]), tmp_path, write_report)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["comparison.csv", "comparison.json", "comparison.tex", "notes.txt", "report.html"]
    assert (tmp_path / "comparison.csv").read_text() != "name,solver,variant,old"


def test_animations_are_made_where_pictures_are_wanted_and_something_moves(tmp_path):
    runs = [made(problem=line(name=name, pictures=name != "b", goal=k)) for k, name in enumerate("abc")]
    asked, linked = [], []

    def animate(entries, file):
        asked.append([entry.solution.problem.name for entry in entries])
        if asked[-1] == ["a"]:
            file.write_text("a page")

    def report(comparison, file, animations):
        linked.append(animations)
        file.write_text("")

    written = write_comparison(Comparison.of(runs), tmp_path, report, animate)
    assert asked == [["a"], ["c"]]
    assert linked == [{"a": "a/animation.html"}]
    assert written.files[-1].read_text() == "a page"
    assert written.missing == []
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["animation.html"]


@pytest.mark.parametrize("blocked", ["file", "folder"])
def test_a_place_that_cannot_be_written_is_bad_input(tmp_path, blocked):
    home = tmp_path / "out"
    if blocked == "file":
        home.write_text("mine")
    else:
        (home / "report.html").mkdir(parents=True)
    with pytest.raises(InvalidProblemError, match=r"cannot write here|a folder stands"):
        write_comparison(Comparison.of([made()]), home, write_report)


def test_no_solutions_are_no_comparison(tmp_path):
    with pytest.raises(UnreadableSolutionError, match="no solution folder"):
        load_comparison([tmp_path])


def test_a_stored_failure_gives_the_same_row(tmp_path):
    problem = paper_problem(horizon=Horizon(initial=None, minimum=0.5, maximum=2.0), name="free")

    def keep(solution: Solution, run: Run) -> str:
        return str(save_solution(solution, tmp_path / folder_name(run.variant)))

    found = compare([Run(problem, Continuation(), "jacobian:gamma=1")], finished=keep)
    again = load_comparison([tmp_path])
    assert again.rows() == found.rows()
    assert again.rows()[0]["variant"] == "jacobian:gamma=1"


# --- the verb -------------------------------------------------------------------------------------------------------


def test_compare_prints_what_it_stores(compared):
    home, done = compared
    data = json.loads(done.stdout)
    assert data["schema_version"] == 1
    assert data == json.loads((home / "out" / "comparison.json").read_text())
    rows = data["runs"]
    assert [row["variant"] for row in rows] == ["jacobian", "nlp", "nlp:control=basis"]
    assert [row["folder"] for row in rows][2] == "out/unicycle/nlp-control-basis"
    assert all(row["converged"] and row["claim_right"] for row in rows)
    assert all((home / row["folder"] / "solution.json").exists() for row in rows)
    assert rows[1]["optimality_gap"] == 0
    assert rows[2]["effort"] <= rows[0]["effort"] + 1e-9  # the same space, and the NLP minimises


def test_from_folders_gives_the_same_table(compared, tmp_path):
    home, done = compared
    again = here("compare", "--from", "out", "-o", tmp_path, "--json", cwd=home)
    assert again.returncode == 0, again.stderr
    assert again.stdout == done.stdout
    for name in ("comparison.csv", "report.html"):
        assert (tmp_path / name).read_bytes() == (home / "out" / name).read_bytes()


def test_from_takes_single_folders(compared, tmp_path, undrawn):
    home, _ = compared
    done = here(
        "compare", "--from", "out/unicycle/nlp", "out/unicycle/jacobian", "-o", tmp_path, "--json", cwd=home
    )
    assert [row["variant"] for row in json.loads(done.stdout)["runs"]] == ["nlp", "jacobian"]


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--from", "missing"],
        ["--from", "missing", "--variant", "nlp:control=basis"],
        [PROBLEMS / "paper.yaml", PROBLEMS / "paper.yaml"],
        [PROBLEMS / "paper.yaml", "--variant", "foo"],
        ["missing.yaml"],
    ],
)
def test_bad_input_is_status_2_and_leaves_nothing(arguments, tmp_path):
    done = here("compare", *arguments, "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"]["message"]
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_the_report_is_written_whatever_one_run_raises(tmp_path, monkeypatch, capsys, undrawn):
    def fail(*_: Any) -> Solution:
        raise TypeError("unsupported operand")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Continuation, "solve", fail)
    file = str(PROBLEMS / "unicycle.yaml")
    assert status(["compare", file, "--set", "output.pictures=false", "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)["runs"]
    assert [(row["variant"], row["outcome"]) for row in rows] == [
        ("jacobian", "solver_error"),
        ("nlp", "converged"),
    ]
    assert "TypeError: unsupported operand" in rows[0]["reason"]
    assert "TypeError: unsupported operand" in (tmp_path / "results" / "report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_writes_the_report_of_what_is_there(tmp_path):
    slow = ["--set", "solvers.jacobian.gamma=1e-4", "--set", "solvers.jacobian.max_iterations=100000"]
    command = [
        sys.executable,
        "-c",
        "from nhpocp.cli import main; main()",
        "compare",
        str(PROBLEMS / "paper.yaml"),
    ]
    process = subprocess.Popen(
        [*command, *slow, "--set", "output.pictures=false"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "results").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(4)  # until it solves, which takes minutes
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120)
    assert process.returncode == 1
    found = json.loads((tmp_path / "results" / "comparison.json").read_text())
    assert [row["outcome"] for row in found["runs"]] == ["interrupted"]
    note, *missing = found["warnings"]
    assert note == "Stopped by hand; not run: paper by nlp."
    report = tmp_path / "results" / "report.html"  # where the time was enough
    assert report.exists() == (not missing)
    assert not report.exists() or note in report.read_text()


def test_python_says_it_as_the_contract_does(tmp_path, undrawn):
    import nhpocp

    problem = replace(paper_problem(), samples=21)
    problem = replace(problem, solvers={"jacobian": Continuation(step_rule=nhpocp.Euler(gamma=1.0))})
    comparison = nhpocp.compare([problem], ["jacobian"])
    path = nhpocp.write_report(comparison, tmp_path / "report.html")
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


# --- what differs, and what does not ----------------------------------------------------------------------------------


def test_one_task_under_several_names_is_one_section():
    turned = [{"x": 0.1 + 0.2, "y": 0}, {"y": 0.0, "x": 0.3}]
    problems = [line(name=f"run{i}", start=start) for i, start in enumerate(turned)]
    comparison = Comparison.of([made(problem=problem) for problem in problems])
    assert [group.title for group in comparison.groups] == ["run0"]
    assert [entry.variant for entry in comparison.entries] == ["jacobian:name=run0", "jacobian:name=run1"]


def test_files_of_one_task_are_told_apart_as_they_run():
    comparison = compare([line(name="one", initial=None), line(name="two", initial=None)], ["jacobian"])
    assert len(comparison.groups) == 1
    assert [entry.variant for entry in comparison.entries] == ["jacobian:name=one", "jacobian:name=two"]


def test_a_row_says_its_basis():
    rows = Comparison.of([made(problem=line(basis=Fourier(h))) for h in (1, 3)]).rows()
    assert [row["basis"] for row in rows] == ["fourier harmonics=1", "fourier harmonics=3"]


def test_the_two_default_runs_may_be_left_out(tmp_path, capsys, undrawn):
    file = tmp_path / "line.yaml"
    file.write_text(
        "nhpocp: 1\nsystem: {model: heisenberg}\nstart: {x: 0, y: 0, z: 0}\ngoal: {x: 0, y: 0, z: 1}\n"
        "output: {pictures: false}\n"
    )
    variants = [f"--variant=jacobian:control.harmonics={h}" for h in (1, 2)]
    assert status(["compare", str(file), "--only", *variants, "-o", str(tmp_path / "out"), "--json"]) == 0
    runs = json.loads(capsys.readouterr().out)["runs"]
    assert [run["variant"] for run in runs] == [f"jacobian:control.harmonics={h}" for h in (1, 2)]
    assert [run["basis"] for run in runs] == [f"fourier harmonics={h}" for h in (1, 2)]
    table = (tmp_path / "out" / "comparison.tex").read_text()
    assert "\nharmonics = 2 & fourier harmonics=2 & " in table
    assert status(["compare", str(file), "--only", "-o", str(tmp_path / "other")]) == 2
    assert "say some with --variant" in capsys.readouterr().err
