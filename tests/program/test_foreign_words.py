"""Words out of files command neither the terminal nor a spreadsheet; what is no file name is answered in words."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.cli import progress as progress_module
from nhpocp.cli.entry import status
from nhpocp.cli.progress import TerminalPanel as Panel
from nhpocp.cli.progress import progress
from nhpocp.cli.summary import comparison_lines, report
from nhpocp.cli.terminal import console, put, say, tell
from nhpocp.comparison import Comparison, Entry
from nhpocp.csv_writer import as_text
from nhpocp.outcome import Outcome
from nhpocp.solution_folder import save_solution
from nhpocp.solution_folder.tables import write_iterations, write_trajectory
from nhpocp.solvers.continuation.continuation import Continuation
from tests.conftest import paper_problem

DIRECTIONS = "\u061c\u200e\u200f\u2028\u2029" + "".join(
    map(chr, (*range(0x202A, 0x202F), *range(0x2066, 0x206A)))
)
CONTROLS = "".join(map(chr, (*range(9), *range(11, 32), *range(127, 160)))) + DIRECTIONS
EVIL = f"\x1b]0;owned\x07\x1b[2J\x9b31m{CONTROLS}"


@pytest.fixture(scope="module")
def failed():
    """A solution whose every word is somebody else's."""
    problem = paper_problem(samples=5, name=f"name{EVIL}")
    found = planning.solve(problem, Continuation(max_iterations=1))
    verdict = replace(found.verdict, reasons=[f"reason{EVIL}"], warnings=[f"doubt{EVIL}"])
    words = {"message": f"message{EVIL}", "warnings": [f"warning{EVIL}"]}
    return replace(found, verdict=verdict, outcome=Outcome.NOT_VERIFIED, **words)


def clean(shown: str) -> bool:
    return bool(shown) and not set(CONTROLS) & set(shown)


def clean_on_a_terminal(shown: str) -> bool:
    """The same but for the ends of lines and rich's own sequences, none of which clears or is coloured like ours."""
    ours = re.sub("\x1b\\[[0-9;?]*[mhlAK]|\r", "", shown)
    return clean(ours) and "31m" in ours


def test_nothing_that_is_said_holds_a_control_sequence(capsys):
    for speak in (say, tell):
        speak(EVIL + "\tä\n")
    put({EVIL: [EVIL]})
    shown = capsys.readouterr()
    assert clean(shown.out)
    assert clean(shown.err)
    assert "\\x1b]0;owned\\x07" in shown.err
    assert "\tä\n" in shown.err
    assert json.loads(shown.out[shown.out.index("{") :]) == {EVIL: [EVIL]}


def test_keys_and_names_of_a_file_are_shown_spelt_out(tmp_path, capsys):
    file = tmp_path / "a.yaml"
    file.write_text(
        'nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {x: 0}\n"\\e[2J\\x9b": 1\n'
    )
    assert status(["check", str(file)]) == 2
    assert "\\x1b[2J\\x9b" in capsys.readouterr().err
    assert status(["check", "--\x1b[2J\x9b"]) == 2
    assert clean(capsys.readouterr().err)
    for verb in ("check", "verify", "plot"):
        assert status([verb, str(tmp_path / EVIL.replace("\0", ""))]) == 2
        shown = capsys.readouterr()
        assert clean(shown.err)


FORMULAS = ["=1+1", "+1", "-1+1", "@SUM(A1)", "\t=1+1", " =1", "\tx", "\rx", "\n=1", "＝1+1"]


@pytest.mark.parametrize("value", FORMULAS)
def test_what_a_spreadsheet_would_execute_is_quoted(value, monkeypatch):
    monkeypatch.setattr(
        Comparison, "rows", lambda self: [{"name": value, "number": -1.5, "ok": True, "k": 3}]
    )
    (row,) = csv.DictReader(io.StringIO(Comparison([]).to_csv(), newline=""))
    assert row == {"name": f"'{value}", "number": "-1.5", "ok": "true", "k": "3"}
    assert as_text("paper") == "paper"


def test_tables_of_a_solution_quote_names_and_words_and_no_number(failed, tmp_path):
    """Headers are made of names of a user's system; the words of iterations may be a user's solver's."""
    values = np.linspace(-1.5, 1.5, len(failed.trajectory["t"]))
    odd = replace(
        failed,
        trajectory={**failed.trajectory, **dict.fromkeys(FORMULAS, values)},
        iterations=[{"k": 0, "error": -0.5, "=note": "@x", "rank": np.int64(-3), "accepted": np.True_}],
    )
    write_trajectory(odd, tmp_path / "trajectory.csv")
    write_iterations(odd, tmp_path / "iterations.csv")
    with open(tmp_path / "trajectory.csv", newline="") as stream:
        header, first, *_ = csv.reader(stream)
    assert all(re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) for name in header)
    assert first.count("-1.5") == len(FORMULAS)
    lines = (tmp_path / "iterations.csv").read_text().splitlines()
    assert lines == ["k,error,rank,'=note,accepted", "0,-0.5,-3,'@x,1"]


def test_tables_on_a_terminal_hold_no_control_sequence(failed, capsys, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    report(failed, Path(f"folder{EVIL}".replace("\0", "")), f"file{EVIL}")
    shown = capsys.readouterr().out
    assert clean_on_a_terminal(shown)
    for word in ("name", "message", "reason", "doubt", "warning", "folder"):
        assert f"{word}\\x1b]0;" in shown.replace("\n", "")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    comparison = Comparison([Entry(failed, f"variant{EVIL}", None)], [f"note{EVIL}"])
    comparison_lines(comparison, [Path(f"report{EVIL}".replace("\0", ""))], {})
    shown = capsys.readouterr()
    assert clean_on_a_terminal(shown.out)
    assert clean(shown.err)


def test_the_progress_on_a_terminal_holds_no_control_sequence(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(progress_module, "AT_ONCE", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    record = {"k": 0, "error": 1.0, "run": 1, "runs": 2, "name": f"n{EVIL}", "variant": EVIL, "way": EVIL}
    with progress(False, EVIL) as show:
        show(record)
    shown = capsys.readouterr().err
    assert clean_on_a_terminal(shown)
    assert "n\\x1b]0;owned" in shown
    panel = Panel(EVIL)
    panel.hear({**record, "name": None})
    assert all(not set(CONTROLS) & set(line) for line in panel.lines(100))
    console(error=True).print({EVIL: EVIL})
    assert clean_on_a_terminal(capsys.readouterr().err + "31m")


def test_verify_and_plot_say_stored_words_spelt_out(failed, tmp_path, capsys):
    folder = save_solution(replace(failed, problem=paper_problem(samples=5)), tmp_path / "out")
    stored = json.loads((folder / "solution.json").read_text())
    (folder / "solution.json").write_text(
        json.dumps({**stored, "name": EVIL, "settings": {EVIL: EVIL, **stored["settings"]}})
    )
    assert status(["verify", str(folder)]) == 1
    assert clean(capsys.readouterr().out)
    (folder / "solution.json").write_text(json.dumps({**stored, "outcome": EVIL}))
    for verb in ("verify", "plot"):
        assert status([verb, str(folder)]) == 2
        assert clean(capsys.readouterr().err)


@pytest.mark.parametrize("named", [".", "", "/", "..", "folder"])
def test_init_of_a_folder_is_refused_in_words(named, tmp_path, capsys, monkeypatch):
    (tmp_path / "here" / "folder").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    assert status(["init", named]) == 2
    assert "this is a folder; name a file, such as " in capsys.readouterr().err
    assert [path.name for path in Path().rglob("*")] == ["folder"]


@pytest.mark.parametrize("verb", ["check", "solve", "analyze", "compare"])
def test_a_pipe_is_not_waited_for(verb, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe.yaml")
    assert status([verb, str(tmp_path / "pipe.yaml")]) == 2
    assert "this is a pipe; expected a file" in capsys.readouterr().err
