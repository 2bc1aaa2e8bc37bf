"""Sweeps: every run once and stored as it finishes, whatever ends the program or its workers meanwhile."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from corners import CORNERS

import nhpocp
from nhpocp.cli import entry
from nhpocp.errors import InvalidProblemError
from nhpocp.study.cluster import LOCAL, DaskExecutor
from nhpocp.study.order import one_by_one, pieces
from nhpocp.study.store import Store
from nhpocp.study.study import read_study_text
from nhpocp.study.sweep import sweep
from tests.cli.test_terminal import in_a_terminal
from tests.study import deadly

ROOT = Path(__file__).parents[2]
PROGRAM = [sys.executable, "-m", "nhpocp"]
UNICYCLE = (
    CORNERS
    + """\
    solvers: {compile: never}
    output: {pictures: false}
  axes:
    goal.x: {linspace: [0.5, 2, 4]}
    goal.theta: [0, 30 deg, -pi/4]
"""
)
MEASURED = ("session", "solve_s", "verify_s", "finished", "tries")  # what differs between two sweeps


def environment(**more):
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def begun(*arguments, cwd, **more):
    return subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        cwd=cwd,
        env=environment(**more),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ran(*arguments, cwd):
    """(exit status, output, errors) of the program, in this process."""
    with contextlib.chdir(cwd):
        done = CliRunner().invoke(click_program, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.stderr


@click.command(
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
)
@click.pass_context
def click_program(context):
    context.exit(entry.status(context.args))


def rows(store: Path) -> list[dict]:
    with Store.open(store) as opened:
        return list(opened.rows())


def alike(one, other):
    """Rows of two sweeps say the same; numbers of continuations in company to rounding."""
    assert [row["run"] for row in one] == [row["run"] for row in other]
    for a, b in zip(one, other, strict=True):
        for name in a.keys() - {*MEASURED, "solved_control", "margins", "extremes", "limits", "message"}:
            if isinstance(a[name], float):
                assert a[name] == pytest.approx(b[name], rel=1e-6, abs=1e-9), name
            else:
                assert a[name] == b[name], name


@pytest.fixture(scope="session")
def swept(tmp_path_factory):
    """(folder, exit status, output, errors) of a sweep over twelve goals, run by the program in two processes."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "corners.yaml").write_text(UNICYCLE)
    return folder, *ran("sweep", "corners.yaml", "--workers", 2, "--json", cwd=folder)


def test_a_row_a_run(swept):
    folder, status, out, errors = swept
    said = json.loads(out)
    assert (status, errors) == (0, "")
    home = folder / "results" / "corners"
    assert said == {**said, "store": "results/corners/study.sqlite", "runs": 12, "converged": 12, "failed": 0}
    assert said["report"] == "results/corners/report.html"
    assert {path.name for path in home.iterdir()} == {"study.sqlite", "report.html", "comparison.tex"}
    assert "12 runs: 12 solved and confirmed" in (home / "report.html").read_text(encoding="utf-8")
    with sqlite3.connect(folder / said["store"]) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        query = 'SELECT run, "goal.x", "goal.theta", outcome, converged FROM runs ORDER BY run'
        stored = connection.execute(query).fetchall()
        (versions,) = connection.execute("SELECT environment FROM sessions").fetchone()
    assert stored[1] == (2, 0.5, pytest.approx(0.5235987755982988), "converged", 1)
    assert [run for run, *_ in stored] == list(range(1, 13))
    assert {"nhpocp", "casadi", "processor"} <= set(json.loads(versions))


def test_the_plans_are_those_of_the_solver(swept):
    row = rows(swept[0] / "results/corners/study.sqlite")[4]
    assert json.loads(row["parameters"]) == {"goal.x": 1.0, "goal.theta": pytest.approx(0.5235987755982988)}
    problem = nhpocp.load_problem(ROOT / "problems" / "unicycle.yaml")
    problem = nhpocp.PlanningProblem(
        system=problem.system,
        start={"x": 0, "y": 0, "theta": 0},
        goal={"x": 1, "y": 1, "theta": 30 * nhpocp.deg},
    )
    alone = nhpocp.solve(problem)
    assert (row["effort"], row["evaluations"]) == (pytest.approx(alone.control.effort), alone.evaluations)
    assert row["verified_error"] == pytest.approx(alone.verdict.error, rel=1e-3)


def test_a_run_becomes_a_folder_that_verifies(swept):
    folder = swept[0]
    status, out, _ = ran(
        "solve", "--from", "results/corners/study.sqlite", "--run", 5, "-o", "one", "--json", cwd=folder
    )
    row, said = rows(folder / "results/corners/study.sqlite")[4], json.loads(out)
    assert (status, said["outcome"], said["effort"]) == (0, "converged", pytest.approx(row["effort"]))
    assert said["verified"]["error"] == pytest.approx(row["verified_error"], rel=1e-6)
    status, out, _ = ran("verify", "one", cwd=folder)
    assert (status, "differs" in out) == (0, False)
    status, _, errors = ran("solve", "--from", "results/corners/study.sqlite", "--run", 99, cwd=folder)
    assert (status, "run 99 is not stored here; 12 of the runs 1…12 are" in errors) == (2, True)


def test_the_table_reads_back_as_it_was(swept, tmp_path):
    store = swept[0] / "results/corners/study.sqlite"
    status, out, _ = ran("export", store, "-o", tmp_path / "runs.csv", cwd=tmp_path)
    assert (status, out) == (0, f"{tmp_path / 'runs.csv'}\n")
    with (tmp_path / "runs.csv").open(newline="", encoding="utf-8") as stream:
        table = list(csv.DictReader(stream))
    for cells, row in zip(table, rows(store), strict=True):
        assert {name: float(cells[name]) for name in ("goal.x", "goal.theta")} == json.loads(
            row["parameters"]
        )
        assert float(cells["effort"]) == row["effort"]
        assert cells["outcome"] == row["outcome"]


def test_parquet_asks_for_its_extra(swept, tmp_path):
    store = swept[0] / "results/corners/study.sqlite"
    try:
        import pyarrow.parquet as pq
    except ImportError:
        status, _, errors = ran("export", store, "--format", "parquet", "-o", tmp_path / "a", cwd=tmp_path)
        assert (status, 'pip install "nhpocp[parquet]"' in errors) == (3, True)
        return
    ran("export", store, "--format", "parquet", "-o", tmp_path / "a", cwd=tmp_path)
    table = pq.read_table(tmp_path / "a").to_pylist()
    assert [row["effort"] for row in table] == [row["effort"] for row in rows(store)]
    assert [row["goal.x"] for row in table] == [
        json.loads(row["parameters"])["goal.x"] for row in rows(store)
    ]


def test_resuming_what_is_whole_runs_nothing_and_another_study_is_refused(swept):
    folder = swept[0]
    before = rows(folder / "results/corners/study.sqlite")
    assert ran("sweep", "corners.yaml", "--resume", cwd=folder)[0] == 0
    assert rows(folder / "results/corners/study.sqlite") == before
    status, _, errors = ran("sweep", "corners.yaml", cwd=folder)
    assert (status, "this store exists; --resume runs what is missing" in errors) == (2, True)
    (folder / "other.yaml").write_text(UNICYCLE.replace("[0.5, 2, 4]", "[0.5, 2, 5]"))
    status, _, errors = ran("sweep", "other.yaml", "--resume", cwd=folder)
    assert (status, "this store is of another study" in errors) == (2, True)


@pytest.mark.parametrize("content", ["", "no database", None])
def test_what_is_no_store_is_told(tmp_path, content):
    if content is not None:
        (tmp_path / "study.sqlite").write_text(content * 400)
    status, _, errors = ran("export", "study.sqlite", cwd=tmp_path)
    assert status == 2
    assert errors.startswith("study.sqlite: ")
    assert "Traceback" not in errors


def wait_for(condition, seconds=60.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def count(store: Path) -> int:
    if not store.exists():
        return 0
    connection = sqlite3.connect(store, timeout=30)
    try:
        return connection.execute("SELECT count(*) FROM runs").fetchone()[0]
    except sqlite3.OperationalError:  # not made yet
        return 0
    finally:
        connection.close()


def workers_of(process) -> list[int]:
    """The processes that a sweep has begun to work in, by Linux's list."""
    found = subprocess.run(
        ["pgrep", "-P", str(process.pid), "-f", "spawn_main"], capture_output=True, text=True
    )
    return [int(number) for number in found.stdout.split()]


def here():
    return ThreadPoolExecutor(1)


LONG = UNICYCLE.replace("[0, 30 deg, -pi/4]", "[0]") + "    horizon: {linspace: [1, 2, 6]}\n"


def test_what_was_stopped_and_killed_goes_on_to_the_same_rows(tmp_path, undisturbed):
    (tmp_path / "corners.yaml").write_text(LONG)
    store, before = tmp_path / "out" / "study.sqlite", 0
    for number in (signal.SIGTERM, signal.SIGKILL):
        process = begun("sweep", "corners.yaml", "-o", "out", "--workers", 1, "--resume", cwd=tmp_path)
        wait_for(lambda least=before + 4: count(store) >= least)
        children = workers_of(process)
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
        wait_for(lambda pids=children: not any(Path(f"/proc/{pid}").exists() for pid in pids))
        assert children
        stored = count(store)
        assert before + 4 <= stored < 24
        if number == signal.SIGTERM:
            before = stored
            assert process.returncode == 1
            assert errors == f"stopped by hand; {stored} of 24 runs are stored, --resume runs the others\n"
    study = read_study_text(LONG, "corners.yaml")
    with Store.create(store, study, resume=True) as opened:
        assert sweep(study, opened, 1, make=here).converged == 24
    alike(rows(store), undisturbed)
    sessions = [row["session"] for row in rows(store)]
    assert sessions == [1] * before + [2] * (stored - before) + [3] * (24 - stored)


@pytest.mark.parametrize("cluster", [False, True], ids=["processes", "dask"])
def test_a_worker_that_dies_costs_one_retry_and_one_that_dies_again_a_row(tmp_path, monkeypatch, cluster):
    """Its death comes from outside (`NHPOCP_TEST_DEATHS` of tests/study/deadly.py), as that by lack of memory does."""
    deaths = tmp_path / "deaths"
    deaths.write_text(json.dumps({"2.0": 2}))
    study = read_study_text(
        UNICYCLE.replace("goal.x: {linspace", "goal.y: {linspace")
        .replace("goal.theta", "horizon")
        .replace("[0, 30 deg, -pi/4]", "[0.5, 1.0, 2.0]")
    )
    monkeypatch.setenv("NHPOCP_TEST_DEATHS", str(deaths))
    monkeypatch.setattr("nhpocp.study.sweep.performed", deadly.performed)
    make = partial(DaskExecutor, LOCAL, 1) if cluster else None
    with Store.create(tmp_path / "study.sqlite", study, resume=False) as store:
        tally = sweep(study, store, workers=1, make=make)
        stored = list(store.rows())
    assert (tally.stored, tally.failed) == (12, 1)
    (dead,) = [row for row in stored if not row["converged"]]
    assert json.loads(dead["parameters"])["horizon"] == 2.0
    assert (dead["outcome"], dead["tries"], dead["solved_control"]) == ("solver_error", 2, None)
    assert "died twice" in dead["message"]
    others = [row for row in stored if json.loads(row["parameters"])["horizon"] == 2.0 and row is not dead]
    assert [(row["tries"], row["converged"]) for row in others] == [
        (2, 1)
    ] * 3  # which were under way with it


def test_from_python(tmp_path, monkeypatch, undisturbed):
    (tmp_path / "corners.yaml").write_text(LONG)
    monkeypatch.chdir(tmp_path)
    tally = nhpocp.sweep("corners.yaml", workers=1, make=here)
    assert (tally.runs, tally.converged, tally.failed, tally.stopped) == (24, 24, 0, "")
    alike(rows(tmp_path / "results" / "corners" / "study.sqlite"), undisturbed)
    with pytest.raises(InvalidProblemError, match="this store exists"):
        nhpocp.sweep("corners.yaml")
    assert nhpocp.sweep("corners.yaml", resume=True, make=here).done == 0
    with pytest.raises(InvalidProblemError, match="workers: "):
        nhpocp.sweep("corners.yaml", "other", workers=0)
    with pytest.raises(
        InvalidProblemError, match="study: expected the name of a study file, got the number 3"
    ):
        nhpocp.sweep(3)


def test_a_second_sweep_on_one_store_is_refused(tmp_path):
    study = read_study_text(UNICYCLE)
    with (
        Store.create(tmp_path / "study.sqlite", study, resume=False),
        pytest.raises(InvalidProblemError, match="another sweep is writing to this store"),
    ):
        Store.create(tmp_path / "study.sqlite", study, resume=True)


def test_progress_on_a_terminal_where_ctrl_c_leaves_a_whole_store(tmp_path):
    (tmp_path / "corners.yaml").write_text(LONG)
    arguments = ["sweep", "corners.yaml", "-o", ".", "--workers", 1]
    status, screen = in_a_terminal(arguments, tmp_path, columns=120, press=", 0 failed", PYTHONPATH=str(ROOT))
    assert status == 1
    assert re.search(r"\b(\d+) of 24, \1 solved, 0 failed, \S+ a second", screen)
    stored = len(rows(tmp_path / "study.sqlite"))
    assert f"{stored} of 24 runs: {stored} solved and verified" in screen
    assert f"stopped by hand; {stored} of 24 runs are stored, --resume runs the others" in screen
    assert "Traceback" not in screen


def test_ctrl_c_after_the_last_run_says_nothing_wrong(tmp_path, monkeypatch, capsys):
    from nhpocp.study import sweep as course

    def ended(study, store, *_):
        tally = sweep(study, store, 1, make=here)
        signal.raise_signal(signal.SIGINT)
        return tally

    monkeypatch.setattr(course, "sweep", ended)
    monkeypatch.chdir(tmp_path)
    Path("few.yaml").write_text(
        UNICYCLE.replace("[0.5, 2, 4]", "[1, 2, 2]").replace("[0, 30 deg, -pi/4]", "[0]")
    )
    assert entry.status(["sweep", "few.yaml", "-o", "."]) == 0
    said = capsys.readouterr()
    assert "2 of 2 runs: 2 solved and verified" in said.out
    assert "by hand" not in said.err


def test_a_combination_that_is_no_problem_is_a_row_that_says_so(tmp_path):
    """Each level is fine beside the others' first; min 2 with initial 1 is not."""
    head = UNICYCLE.partition("    goal.x")[0]
    head = head.replace("    solvers:", "    horizon: {min: 0.5, max: 5, initial: 3}\n    solvers:")
    study = read_study_text(head + "    horizon.min: [0.5, 2]\n    horizon.initial: [3, 1]\n")
    with Store.create(tmp_path / "study.sqlite", study, resume=False) as store:
        tally = sweep(study, store, 1, make=here)
        rows = [(json.loads(row["parameters"]), row) for row in store.rows()]
    assert (tally.stored, tally.failed, len(rows)) == (4, 1, 4)
    for levels, row in rows:
        possible = levels["horizon.min"] <= levels["horizon.initial"]
        assert (row["outcome"] == "converged") is possible, row["message"]
        assert possible or "outside min and max" in row["message"]


@pytest.mark.parametrize("order", ["given", "nearest"])
@pytest.mark.parametrize("done", [set(), {1, 5, 6}, set(range(1, 24)), set(range(1, 25))])
def test_pieces_hold_every_missing_run_once(order, done):
    study = read_study_text(LONG + f"  order: {order}\n")
    parts = list(pieces(study, done))
    assert sorted(run for part in parts for run in part.runs) == [
        run for run in range(1, 25) if run not in done
    ]
    singles = [single for part in parts for single in one_by_one(part, order == "nearest")]
    before = {part.runs[0]: part.before for part in singles}
    assert all((part.before is None) or order == "nearest" for part in parts)
    if order == "nearest" and not done:  # a chain through the goals of each horizon
        assert sum(previous is None for previous in before.values()) == 6
        for part in parts:
            goals = [
                tuple(study.parameters(run)[path] for path in ("goal.x", "goal.theta")) for run in part.runs
            ]
            steps = [abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in pairwise(goals)]
            assert max(steps) <= 0.53 + 0.5


def test_neighbours_begin_with_each_others_plans_and_resume_so(tmp_path):
    text = UNICYCLE + "  order: nearest\n"
    study = read_study_text(text, "corners.yaml")
    with Store.create(tmp_path / "a.sqlite", study, resume=False) as store:
        sweep(study, store, 1, make=here)
    whole = rows(tmp_path / "a.sqlite")
    with Store.create(tmp_path / "b.sqlite", study, resume=False) as store:
        order = [run for part in pieces(study, set()) for run in part.runs]
        session = store.begin(1, {})
        store.add({**row, "session": session} for row in whole if row["run"] in order[:5])
        assert sweep(study, store, 1, make=here).done == 7
    alike(rows(tmp_path / "b.sqlite"), whole)
    plain = read_study_text(UNICYCLE, "corners.yaml")
    assert plain.digest != study.digest
    assert sum(row["evaluations"] for row in whole[1:]) < 12 * whole[0]["evaluations"]
