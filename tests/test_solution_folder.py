"""Solution folders: what they hold, that they come back whole, and that nothing else is overwritten."""

import csv
import json
import math

import numpy as np
import pytest
from conftest import PAPER_START, paper_problem

from nhpocp import planning
from nhpocp.constraints import Bound
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError
from nhpocp.solution import Outcome
from nhpocp.solution_folder import load_solution, plain, save_solution, to_json
from nhpocp.solvers.continuation import Continuation, Euler

BOUNDS = [Bound("leg_length", "leg_lengths", 20.0, 60.0), Bound("leg_speed", "u", -200.0, 200.0)]


@pytest.fixture(scope="module")
def solution():
    return planning.solve(paper_problem(name="paper", bounds=BOUNDS), Continuation(step_rule=Euler(1.0)))


@pytest.fixture
def failed():
    start = 5000 * PAPER_START  # far beyond what the integration can follow
    return planning.solve(paper_problem("vertical_equal", initial=start), Continuation())


def test_round_trip(solution, tmp_path):
    back = load_solution(save_solution(solution, tmp_path / "a" / "b"))
    assert back.converged
    assert to_json(back) == to_json(solution)
    np.testing.assert_array_equal(back.control.coefficients, solution.control.coefficients)
    for name, values in solution.trajectory.items():
        np.testing.assert_array_equal(back.trajectory[name], values)
    again = planning.solve(back.problem, Continuation(step_rule=Euler(1.0)))
    np.testing.assert_array_equal(again.control.coefficients, solution.control.coefficients)


def test_a_failed_run_comes_back_too(failed, tmp_path):
    assert failed.outcome is Outcome.SINGULAR_S
    assert not np.isfinite(failed.trajectory["position"]).all()
    folder = save_solution(failed, tmp_path / "failed")
    back = load_solution(folder)
    assert (back.outcome, back.converged) == (Outcome.SINGULAR_S, False)
    text = (folder / "solution.json").read_text()
    assert "NaN" not in text
    assert "Infinity" not in text
    assert json.loads(text)["trajectory"]["position"][-1] == [None, None, None]


def test_files_hold_the_contract(solution, tmp_path):
    folder = save_solution(solution, tmp_path / "out")
    assert {path.name for path in folder.iterdir()} == {
        *("problem.yaml", "solution.json", "trajectory.csv", "arrays.npz", "solver.log")
    }
    data = json.loads((folder / "solution.json").read_text())
    assert data["schema_version"] == 1
    assert data["system"]["model"] == "three_upu"
    assert data["system"]["base_radius"] == 30.0
    assert set(data["verified"]) >= {"error", "ok", "method", "original", "rolling", "leg_rate"}
    assert set(data["verified"]["original"]) >= {"error", "reached_t", "ok"}
    assert data["control"]["input"] == "v"
    assert np.shape(data["control"]["coefficients"]) == (3, 5)
    assert np.shape(data["trajectory"]["orientation"]) == (201, 3, 3)
    assert np.shape(data["trajectory"]["joint_angles"]) == (201, 3, 4)
    assert data["constraints"]["leg_length"]["ok"] is True
    assert data["iterations"][-1]["k"] == data["evaluations"] - 1
    with (folder / "trajectory.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 201
    assert float(rows[-1]["t"]) == 1.0
    for i in range(3):
        assert float(rows[7][f"position[{i}]"]) == solution.trajectory["position"][7, i]
        assert float(rows[7][f"orientation[2][{i}]"]) == solution.trajectory["orientation"][7, 2, i]


def test_only_solution_folders_are_replaced(solution, tmp_path):
    folder = save_solution(solution, tmp_path / "mine")
    (folder / "stale.txt").write_text("from an older run")
    save_solution(solution, folder)
    assert not (folder / "stale.txt").exists()
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").write_text("years of work")
    with pytest.raises(InvalidProblemError, match="was not written by nhpocp"):
        save_solution(solution, foreign)
    assert (foreign / "thesis.tex").read_text() == "years of work"
    with pytest.raises(InvalidProblemError, match="this is a file"):
        save_solution(solution, foreign / "thesis.tex")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["foreign", "mine"]


def test_written_whole_or_not_at_all(solution, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    kept = save_solution(solution, tmp_path / "kept")
    monkeypatch.setattr(np, "savez_compressed", full)
    for target in (kept, tmp_path / "new"):
        with pytest.raises(InvalidProblemError, match="No space left"):
            save_solution(solution, target)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert load_solution(kept).converged


def test_numbers_survive_pictures_that_do_not_fit(solution, tmp_path):
    def greedy(_, folder):
        (folder / "half.png").write_bytes(b"\x89PNG")
        raise OSError(28, "No space left on device")

    folder = save_solution(solution, tmp_path / "out", greedy)
    assert not (folder / "half.png").exists()
    assert load_solution(folder).converged


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("solution.json", "{"),
        ("solution.json", '{"schema_version": 2}'),
        ("solution.json", '{"schema_version": 1}'),
        ("arrays.npz", "no archive"),
        ("problem.yaml", "nhpocp: [1"),
    ],
)
def test_damaged_folders_are_named(solution, tmp_path, name, content):
    folder = save_solution(solution, tmp_path / "out")
    (folder / name).write_text(content)
    with pytest.raises((UnreadableSolutionError, InvalidProblemError), match=str(folder)):
        load_solution(folder)


def test_missing_folder(tmp_path):
    with pytest.raises(UnreadableSolutionError, match=r"solution\.json is missing"):
        load_solution(tmp_path)


def test_arrays_are_never_unpickled(solution, tmp_path):
    folder = save_solution(solution, tmp_path / "out")
    np.savez(folder / "arrays.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(UnreadableSolutionError, match="damaged"):
        load_solution(folder)


def test_plain_makes_strict_json():
    assert plain({"a": [math.nan, math.inf, np.float64(1), np.int64(2)], "b": np.eye(1)}) == {
        "a": [None, None, 1.0, 2],
        "b": [[1.0]],
    }
