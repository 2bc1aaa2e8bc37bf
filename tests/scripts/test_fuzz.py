"""A bounded share of the seeded nonsense of `scripts/fuzz.py`."""

import os

import fuzz
import pytest

posix = pytest.mark.skipif(os.name != "posix", reason="alarms")
COUNTS = {  # few hundred in all
    "problem_bytes": 40,
    "problem_structure": 40,
    "settings": 20,
    "solves": 2,
    "solution_folders": 6,
    "study_bytes": 30,
    "study_structure": 30,
    "store_bytes": 20,
    "store_tables": 20,
    "store_cells": 20,
    "store_journal": 10,
}


@pytest.fixture(scope="module")
def stored():
    with fuzz.prepared() as folder:
        yield folder


@posix
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_nonsense_breaks_nothing(kind, stored, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz, "LONGEST", 60.0)  # the machine may be busy
    monkeypatch.setattr(fuzz, "MOST", float("inf"))  # of all tests of this process
    found = fuzz.fuzzed(fuzz.KINDS[kind][0], COUNTS[kind], seed=1, stored=stored)
    assert [str(one) for one in found] == []


@posix
def test_what_breaks_is_named(monkeypatch, tmp_path):
    def fail(call):
        raise IndexError("list index out of range")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz, "status", fail)
    (one,) = fuzz.fuzzed(fuzz.problem_bytes, 1, seed=2, stored=tmp_path)
    assert str(one).startswith("problem_bytes, seed 2, call 0: IndexError: list index out of range: nhpocp")


@posix
def test_what_is_written_elsewhere_is_named(monkeypatch, tmp_path):
    def astray(call):
        with open("notes.txt", "w") as stream:
            stream.write("mine")
        return 0

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz, "status", astray)
    (one,) = fuzz.fuzzed(fuzz.problem_bytes, 1, seed=2, stored=tmp_path)
    assert "files beside its output: ['notes.txt']" in str(one)


@posix
def test_the_script_says_what_it_tried(monkeypatch, capsys):
    given = ["fuzz.py", "--inputs", "3", "--kinds", "problem_bytes", "settings"]
    monkeypatch.setattr("sys.argv", given)
    with pytest.raises(SystemExit) as ended:
        fuzz.main()
    assert ended.value.code == 0
    assert capsys.readouterr().out == "problem_bytes 2, settings 2\n4 inputs, 0 broken\n"
