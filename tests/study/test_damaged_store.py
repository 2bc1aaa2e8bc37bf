"""Stores that met other programs: what is damaged is told in one line, by whatever verb reads it."""

from __future__ import annotations

import contextlib
import io
import pickle
import shutil
import sqlite3

import pytest

from nhpocp.cli import entry
from nhpocp.errors import InvalidProblemError
from nhpocp.study.store import COLUMNS, Store
from nhpocp.study.study import read_study_text
from nhpocp.study.sweep import sweep
from tests.study.test_sweep import UNICYCLE, here

FEW = UNICYCLE.replace("[0.5, 2, 4]", "[1, 2, 2]").replace("[0, 30 deg, -pi/4]", "[0]") + "  order: nearest\n"
EXPORT, PARQUET = ["export", "s", "-o", "out.csv"], ["export", "s", "--format", "parquet", "-o", "out"]
REPORT = ["compare", "--from", "s", "-o", "."]
SOLVE, RESUME = (
    ["solve", "--from", "s", "--run", "1", "-o", "out"],
    ["sweep", "few.yaml", "-o", ".", "--resume"],
)
ENDLESS = """ALTER TABLE runs RENAME TO old; CREATE VIEW runs AS
    WITH RECURSIVE more(run) AS (SELECT 1 UNION ALL SELECT run + 1 FROM more) SELECT old.*, 1 FROM more, old"""


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    (folder / "few.yaml").write_text(FEW)
    with Store.create(folder / "study.sqlite", read_study_text(FEW, "few.yaml"), resume=False) as store:
        assert sweep(read_study_text(FEW, "few.yaml"), store, 1, make=here).converged == 2
    return folder


def said(stored, tmp_path, damage, call):
    """(exit status, messages) of a verb on a damaged copy."""
    shutil.copy(stored / "few.yaml", tmp_path)
    store = tmp_path / "study.sqlite"
    shutil.copy(stored / "study.sqlite", store)
    with contextlib.closing(sqlite3.connect(store)) as connection:
        connection.executescript(damage)
    words = io.StringIO()
    with contextlib.chdir(tmp_path), contextlib.redirect_stderr(words), contextlib.redirect_stdout(words):
        status = entry.status(["study.sqlite" if word == "s" else word for word in call])
    return status, words.getvalue()


@pytest.mark.parametrize(
    ("damage", "call", "expected"),
    [
        ("DELETE FROM study WHERE key = 'axes'", EXPORT, "axes: damaged: expected text, got nothing"),
        (
            "UPDATE study SET value = '[1]' WHERE key = 'axes'",
            EXPORT,
            "axes: damaged: expected a list of paths",
        ),
        (
            "UPDATE study SET value = 'x' WHERE key = 'runs'",
            EXPORT,
            "runs: damaged: expected a number of runs",
        ),
        ("UPDATE study SET value = 'x' WHERE key = 'digest'", RESUME, "this store is of another study"),
        ("DELETE FROM study WHERE key = 'digest'", RESUME, "this store is of another study"),
        ("DELETE FROM study WHERE key = 'problem'", SOLVE, "problem: damaged: expected text, got nothing"),
        ("UPDATE study SET value = '2' WHERE key = 'schema_version'", EXPORT, "a store of version 2"),
        (ENDLESS, EXPORT, "this is no store of a study (no table runs)"),
        ("DROP TABLE sessions", RESUME, "this is no store of a study (no table sessions)"),
        ("UPDATE runs SET run = 99 WHERE run = 2", RESUME, "damaged: run 99; the study has 1…2"),
        (
            "UPDATE runs SET effort = 'x'",
            EXPORT,
            "run 1: effort: damaged: expected a number, got the text 'x'",
        ),
        ("UPDATE runs SET message = x'ff'", EXPORT, "run 1: message: damaged: expected text"),
        ("UPDATE runs SET message = CAST(x'ff' AS TEXT)", EXPORT, "cannot use this store: Could not decode"),
        ("UPDATE runs SET outcome = 'x'", SOLVE, "run 1: outcome: damaged: the text 'x' is no outcome"),
        ("UPDATE runs SET margins = '[['", EXPORT, "run 1: margins: damaged: this is not JSON"),
        ('UPDATE runs SET margins = \'{"a": "b"}\'', PARQUET, "run 1: margins: damaged: expected numbers"),
        ("UPDATE runs SET margins = 'null'", EXPORT, "run 1: margins: damaged: expected a mapping"),
        ("UPDATE runs SET parameters = '{}'", SOLVE, "run 1: parameters: damaged: expected values of goal."),
        ("UPDATE runs SET solved_control = '3'", SOLVE, "run 1: solved_control: damaged: expected a mapping"),
        ("UPDATE runs SET solved_control = '{\"horizon\": []}'", SOLVE, "a stored control is damaged"),
        ("UPDATE sessions SET began = 'x'", REPORT, "sessions: damaged: ValueError: Invalid isoformat"),
        (
            "UPDATE runs SET variant = 'x'",
            REPORT,
            "runs: variant: damaged: the text 'x' is none of the study's",
        ),
        ("UPDATE runs SET limits = '['", REPORT, "run 1: limits: damaged: this is not JSON"),
        (
            "UPDATE runs SET effort = 'x'",
            REPORT,
            "run 1: effort: damaged: expected a number, got the text 'x'",
        ),
        (
            "DELETE FROM runs WHERE run = 2; UPDATE runs SET solved_control = '{'",
            RESUME,
            "control is damaged",
        ),
    ],
)
def test_damage_is_told_in_one_line(damage, call, expected, stored, tmp_path, monkeypatch):
    if call == PARQUET:
        pytest.importorskip("pyarrow")
    if call == RESUME:  # in this process
        monkeypatch.setattr("nhpocp.study.sweep.processes", lambda *_: here())
    status, words = said(stored, tmp_path, damage, call)
    assert status == 2
    assert words.startswith("study.sqlite: ")
    assert words.count("\n") == 1
    assert expected in words


def test_a_run_whose_numbers_are_unknown_is_a_folder_all_the_same(stored, tmp_path):
    known = {"run", "solved_control", *(name for name, kind in COLUMNS.items() if "NOT NULL" in kind)}
    unknown = [name for name in COLUMNS if name not in known]
    assert {"evaluations", "solve_s", "margins", "final_error"} <= set(unknown)
    status, words = said(stored, tmp_path, f"UPDATE runs SET {' = NULL, '.join(unknown)} = NULL", SOLVE)
    assert status == 0, words


@pytest.mark.parametrize("number", [2**60, 2**70, -(10**400)])
def test_tables_take_whole_numbers_of_any_size(number, stored, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    level = f'\'{{"goal.x": {number}, "goal.theta": 0}}\''
    assert said(stored, tmp_path, f"UPDATE runs SET parameters = {level}", PARQUET) == (0, "out\n")
    (first, _) = parquet.read_table(tmp_path / "out").to_pylist()
    assert first["goal.x"] == (number if abs(number) < 1e300 else -float("inf"))


def test_what_a_worker_refuses_reaches_the_program():
    error = InvalidProblemError("a stored control is damaged", path="control", file="a.sqlite")
    assert str(pickle.loads(pickle.dumps(error))) == "a.sqlite: control: a stored control is damaged"
