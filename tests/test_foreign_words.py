"""Words out of files command neither the terminal nor a spreadsheet; what is no file name is answered in words."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path

import pytest

from nhpocp.cli.entry import status
from nhpocp.cli.terminal import put, say, tell
from nhpocp.comparison import Comparison, _cell

CONTROLS = "".join(map(chr, (*range(9), *range(11, 32), *range(127, 160))))
EVIL = f"\x1b]0;owned\x07\x1b[2J\x9b31m{CONTROLS}"


def clean(shown: str) -> bool:
    return bool(shown) and not set(CONTROLS) & set(shown)


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
    for verb in ("check", "verify", "plot"):
        assert status([verb, str(tmp_path / EVIL.replace("\0", ""))]) == 2
        shown = capsys.readouterr()
        assert clean(shown.err)


@pytest.mark.parametrize("value", ["=1+1", "+1", "-1+1", "@SUM(A1)", "\t=1+1", " =1"])
def test_what_a_spreadsheet_would_execute_is_quoted(value, monkeypatch):
    monkeypatch.setattr(
        Comparison, "rows", lambda self: [{"name": value, "number": -1.5, "ok": True, "k": 3}]
    )
    (row,) = csv.DictReader(io.StringIO(Comparison([]).to_csv()))
    assert row == {"name": f"'{value}", "number": "-1.5", "ok": "true", "k": "3"}
    assert _cell("paper") == "paper"


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
