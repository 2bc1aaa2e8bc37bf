"""`nhpocp analyze` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from nhpocp.analysis import slices
from nhpocp.cli.analyzing import parse_slice
from nhpocp.cli.entry import status
from nhpocp.state_space import StateSpace, rotation, vector

PROBLEMS = Path(__file__).parents[2] / "problems"
FAST = ["--set", "output.pictures=false"]


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(slices, "RESOLUTION", 25)  # quicker


def run(*arguments, problem="unicycle", capsys):
    found = status(["analyze", str(PROBLEMS / f"{problem}.yaml"), *arguments])
    return found, *capsys.readouterr()


def test_says_what_it_finds_and_writes_under_results(capsys):
    found, out, _ = run(*FAST, capsys=capsys)
    assert found == 0
    for words in ("controllable", "growth vector (2, 3)", "rank 3", "dexterity", "results/unicycle/analysis"):
        assert words in out
    assert max(map(len, out.splitlines())) < 200
    data = json.loads(Path("results/unicycle/analysis/analysis.json").read_text())
    assert data["points"]["goal"]["growth_vector"] == [2, 3]


def test_names_singularities_and_lost_ranks(capsys):
    found, out, _ = run(*FAST, problem="paper_conjecture", capsys=capsys)
    assert found == 0
    assert "(3, 5, 6) at t = 0.7601, 0.8063" in out
    assert "changes of sign: det W at t = 0.6326, det W at t = 0.89" in out
    assert "det W changes its sign" in out


def test_json_is_one_document(capsys):
    slice_ = "x=-5:5,yaw=-90 deg:pi/2"
    options = ["--json", "--slice", slice_, "--at", "goal", "-o", "here"]
    found, out, _ = run(*FAST, *options, problem="paper", capsys=capsys)
    data = json.loads(out)
    assert (found, data["folder"], data["schema_version"]) == (0, "here", 1)
    assert data["map"]["at"] == "goal"
    assert data["map"]["coordinates"] == {"x": [-5, 5], "yaw": [-np.pi / 2, np.pi / 2]}
    stored = json.loads(Path("here/analysis.json").read_text())
    assert {key: data[key] for key in stored} == stored


def test_options_reach_the_analysis(capsys):
    found, out, _ = run(*FAST, "--json", "--degree", "1", "--tolerance", "1e-6", capsys=capsys)
    data = json.loads(out)
    assert found == 0
    assert (data["tolerance"], data["bracket_degree"]) == (1e-6, 1)
    assert data["controllability"]["verdict"] == "undecided"


def test_pictures_are_drawn_unless_the_file_says_no(capsys):
    assert run("-o", "drawn", capsys=capsys)[0] == 0
    drawn = {f"{name}.{kind}" for name in ("along_guess", "agility") for kind in ("svg", "png")}
    assert {file.name for file in Path("drawn").iterdir()} == {"analysis.json", *drawn}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--slice", "z"], "takes two coordinates"),
        (["--slice", "z,tilt"], "no coordinate 'tilt'"),
        (["--slice", "z=1,yaw"], "expected LO:HI"),
        (["--slice", "z=1:many,yaw"], "expected a number"),
        (["--slice", "z=nan:3,yaw"], "NaN"),
        (["--slice", "z=3:1,yaw"], "low < high"),
        (["--at", "noon"], "no state 'noon'"),
        (["--tolerance", "2"], "between 0 and 1"),
        (["--degree", "two"], "integer"),
        (["--set", "start.x=1"], "unknown key"),
    ],
)
def test_bad_input_exits_2_and_writes_nothing(arguments, words, capsys):
    found, out, err = run(*FAST, *arguments, "--json", problem="paper", capsys=capsys)
    assert found == 2
    assert words in err
    assert words in json.loads(out)["error"]["message"]
    assert not Path("results").exists()


def test_a_faulty_file_is_named_with_its_line(capsys):
    Path("mine.yaml").write_text("nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0}\ngoal: {x: 1}\n")
    assert status(["analyze", "mine.yaml"]) == 2
    assert "mine.yaml:3:1: start.theta" in capsys.readouterr().err


def test_a_folder_of_somebody_else_is_left_alone(capsys):
    Path("theirs").mkdir()
    Path("theirs/thesis.tex").write_text("all of it")
    found, _, err = run(*FAST, "-o", "theirs", capsys=capsys)
    assert found == 2
    assert "thesis.tex" in err
    assert Path("theirs/thesis.tex").read_text() == "all of it"


def test_help_tells_how_a_slice_is_written(capsys):
    assert status(["analyze", "--help"]) == 0
    out = capsys.readouterr().out
    for words in ("--slice", "A[=LO:HI],B[=LO:HI]", "z,yaw", "--at", "start|goal|TIME", "Exit status"):
        assert words in out


def test_numbers_of_a_slice_are_those_of_problem_files():
    space = StateSpace([vector("position", 3, "length"), rotation("orientation")])
    first, second = parse_slice("yaw = -2*pi/3:20 deg, z", space)
    assert (first.low, first.high) == pytest.approx((-2 * np.pi / 3, np.pi / 9))
    assert (second.coordinate.name, second.low, second.high) == ("z", None, None)
