"""Solution folders: what they hold, that they come back whole, and that nothing else is overwritten."""

import csv
import errno
import json
import math
import os
import shutil
import signal
import tracemalloc
import zipfile
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.comparison_folder import load_comparison, solution_folders
from nhpocp.constraints.bound import Bound, BoundReport
from nhpocp.errors import InvalidProblemError, UnreadableSolutionError
from nhpocp.outcome import Outcome
from nhpocp.problem_file import load_problem
from nhpocp.provenance import environment
from nhpocp.solution import Crossing, Replay, Verdict
from nhpocp.solution_folder import (
    check_target,
    load_solution,
    plain,
    reading,
    save_solution,
    store_solution,
    to_json,
    writing,
)
from nhpocp.solution_folder.reading import LARGEST_FILE, read_arrays
from nhpocp.solution_folder.stored import StoredBound, StoredCrossing, StoredReplay, StoredVerdict
from nhpocp.solution_folder.target import DATA, PICTURES
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.verification import verify
from nhpocp.views.figures import FIGURES
from tests.conftest import PAPER_START, paper_problem

PAPER = Path(__file__).parents[2] / "problems" / "paper.yaml"
BOUNDS = [Bound("leg_length", "leg_lengths", 20.0, 60.0), Bound("leg_speed", "u", -200.0, 200.0)]


@pytest.fixture(scope="module")
def solution():
    return planning.solve(paper_problem(name="paper", bounds=BOUNDS), Continuation(step_rule=Euler(1.0)))


@pytest.fixture(scope="module")
def failed():
    start = 40 * PAPER_START  # far beyond what the integration can follow
    return planning.solve(paper_problem("vertical_equal", initial=start), Continuation())


def test_round_trip(solution, tmp_path):
    back = load_solution(save_solution(solution, tmp_path / "a" / "b"))
    assert back.converged
    assert to_json(back) == to_json(solution)
    np.testing.assert_array_equal(back.control.coefficients, solution.control.coefficients)
    for name, values in solution.trajectory.items():
        np.testing.assert_array_equal(back.trajectory[name], values)
    again = planning.solve(back.problem, Continuation(step_rule=Euler(1.0)))
    # to rounding: one of the two systems has a kernel
    np.testing.assert_allclose(again.control.coefficients, solution.control.coefficients, rtol=1e-9)


def test_a_plan_of_the_nlp_comes_back_with_its_plugin_and_its_grid(tmp_path):
    done = planning.solve(paper_problem(), MultipleShooting(intervals=8))
    folder = save_solution(done, tmp_path / "out")
    back = load_solution(folder)
    assert to_json(back) == to_json(done)
    assert back.problem.solvers["nlp"].settings() == done.settings
    data = json.loads((folder / "solution.json").read_text())
    assert data["environment"]["plugin"] == "ipopt"
    edit(folder, "control", "grid", 3, value=0.4)  # which is uniform
    refused(folder, "solution.json", "control.grid")


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
        *("problem.yaml", "solution.json", "trajectory.csv", "columns.csv", "arrays.npz", "solver.log")
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
        assert float(rows[7][f"position_{i + 1}"]) == solution.trajectory["position"][7, i]
        assert float(rows[7][f"orientation_3_{i + 1}"]) == solution.trajectory["orientation"][7, 2, i]


# --- the iterations on request ---------------------------------------------------------------------------------------


def iterations(folder):
    """The rows of iterations.csv as dicts; empty cells are None."""
    with (folder / "iterations.csv").open(newline="") as file:
        return [
            {name: float(cell) if cell else None for name, cell in row.items()}
            for row in csv.DictReader(file, strict=True)
        ]


def expected_rows(records):
    """Every record with the keys of all of them; what is not finite is left out."""
    names = {name for record in records for name in record}
    return [{name: plain(record.get(name)) for name in names} for record in records]


@pytest.mark.parametrize("name", ["solution", "failed"])
def test_a_trace_holds_every_record(name, request, tmp_path):
    done = request.getfixturevalue(name)
    folder = save_solution(done, tmp_path / "out", trace=True)
    assert done.iterations
    assert iterations(folder) == expected_rows(done.iterations)
    header = (folder / "iterations.csv").read_text().splitlines()[0].split(",")
    assert header[:4] == ["k", "error", "step", "gamma"]
    assert header[-1] == "accepted"
    save_solution(load_solution(folder), folder)  # without: the old one goes, as every file of ours
    assert not (folder / "iterations.csv").exists()


def test_a_trace_of_unlike_records(failed, tmp_path):
    """Two tries, one record that is not finite, one without a Jacobian; and none at all."""
    records = [
        {"k": 0, "error": 1.5, "sigma_s": 0.25, "attempt": 0, "accepted": True},
        {"k": 0, "error": math.nan, "rank": None, "sigma_s": 1e-300, "attempt": 1, "accepted": False},
    ]
    folder = save_solution(replace(failed, iterations=records), tmp_path / "out", trace=True)
    assert iterations(folder) == expected_rows(records)
    lines = (folder / "iterations.csv").read_text().splitlines()
    assert lines == ["k,attempt,error,rank,sigma_s,accepted", "0,0,1.5,,0.25,1", "0,1,,,1e-300,0"]
    folder = save_solution(replace(failed, iterations=[]), tmp_path / "none", trace=True)
    assert (folder / "iterations.csv").read_text().splitlines() == ["k"]


def test_a_trace_is_written_with_the_rest_or_not_at_all(solution, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing, "write_iterations", full)
    with pytest.raises(InvalidProblemError, match="No space left"):
        save_solution(solution, tmp_path / "out", trace=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["solution.json", "comparison.json"])
def test_json_that_would_fill_the_memory_is_refused_before_it_is_parsed(
    name, solution, tmp_path, monkeypatch
):
    """As `[],[],…`: 3 bytes each in the file, 64 as a list."""
    folder = save_solution(solution, tmp_path / "out" / "paper" / "nlp")
    file = (tmp_path / "out" if name == "comparison.json" else folder) / name
    monkeypatch.setattr(reading, "LARGEST_TREE", 8_000_000)
    file.write_text('{"schema_version": 1, "runs": [' + "[]," * 100_000 + "[]]}")
    with pytest.raises(UnreadableSolutionError, match="more lists, texts and numbers") as found:
        load_comparison([tmp_path / "out"])
    assert found.value.file == str(file)
    monkeypatch.setattr(reading, "LARGEST_FILE", 100_000)
    with pytest.raises(UnreadableSolutionError, match="larger than"):
        load_comparison([tmp_path / "out"])


def test_a_comparison_that_is_too_deep_or_damaged_gives_no_order(tmp_path):
    for name in "ba":
        (tmp_path / name).mkdir()
        (tmp_path / name / "solution.json").write_text('{"schema_version": 1}')
    for text in ('{"runs": ' + "[" * 200_000, '{"runs": 3}', "{", "\xff"):
        (tmp_path / "comparison.json").write_text(text, encoding="latin-1")
        assert solution_folders(tmp_path) == [tmp_path / "a", tmp_path / "b"]


# --- which problem is stored -----------------------------------------------------------------------------------------


def test_the_stored_problem_is_the_solved_one(tmp_path):
    problem = replace(load_problem(PAPER), goal={"position": [-0.3, -0.1, 34]}, pictures=False)
    done = planning.solve(problem, Continuation(step_rule=Euler(0.5), tolerance=1e-2))
    back = load_solution(save_solution(done, tmp_path / "out"))
    assert list(back.problem.goal) == ["position"]
    np.testing.assert_array_equal(back.problem.goal["position"], [-0.3, -0.1, 34])
    assert back.problem.solvers["jacobian"].settings() == done.settings
    again = planning.solve(back.problem)
    np.testing.assert_array_equal(again.control.coefficients, done.control.coefficients)
    assert verify(back).ok


def test_a_file_that_was_solved_as_it_stands_is_kept_with_its_comments(tmp_path):
    problem = load_problem(PAPER, ["solvers.jacobian.gamma=1"])
    done = planning.solve(problem, problem.solvers["jacobian"])
    folder = save_solution(done, tmp_path / "out")
    assert (folder / "problem.yaml").read_text() == problem.source
    assert "# the paper's" in problem.source


@dataclass(frozen=True)
class Hasty(Euler):
    """A step rule of one's own, which no problem file can name."""

    kind: ClassVar[str] = "hasty"


def test_a_solver_without_a_name_in_files_can_be_read_back(tmp_path):
    done = planning.solve(paper_problem(), Continuation(step_rule=Hasty(1.0), tolerance=1e-2))
    back = load_solution(save_solution(done, tmp_path / "out"))
    assert back.settings["step_rule"] == "hasty"
    assert back.problem.solvers["jacobian"].tolerance == 1e-2


def test_the_environment_is_recorded(solution, tmp_path):
    data = json.loads((save_solution(solution, tmp_path / "out") / "solution.json").read_text())
    assert data["environment"]["casadi"]
    assert data["environment"]["plugin"] is None
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    said = data["environment"]["compiler"]
    assert said is None if found is None else said.startswith(f"{found}: ")
    assert environment("fatrop")["plugin"] == "fatrop"


# --- where it may be written -----------------------------------------------------------------------------------------


def tree(folder):
    """Everything under a folder with its content."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def test_our_own_files_are_replaced(solution, tmp_path):
    folder = save_solution(solution, tmp_path / "mine")
    for name in ("robot.png", "controls.svg", "animation.gif"):
        (folder / name).write_text("from an older run")
    save_solution(solution, folder)
    assert not (folder / "robot.png").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    "name",
    ["thesis.tex", "thesis.png", "robot.png/photo.jpg", "old/", "solver.log/notes", "sub/solution.json"],
)
def test_foreign_things_are_left_alone(solution, tmp_path, name):
    folder = save_solution(solution, tmp_path / "mine")
    if name == "sub/solution.json":
        save_solution(solution, folder / "sub")
    elif name.endswith("/"):
        (folder / name).mkdir()
    else:
        (folder / "solver.log").unlink()
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("years of work")
    before = tree(tmp_path)
    with pytest.raises(
        InvalidProblemError, match=f"'{name.split('/')[0]}' in this folder was not written by"
    ):
        save_solution(solution, folder)
    assert tree(tmp_path) == before


def test_folders_without_a_solution_are_left_alone(solution, tmp_path):
    for name in ("thesis.tex", "problem.yaml"):  # which may be the only copy
        foreign = tmp_path / name.partition(".")[0]
        foreign.mkdir()
        (foreign / name).write_text("years of work")
        with pytest.raises(InvalidProblemError, match="was not written by nhpocp"):
            save_solution(solution, foreign)
        assert (foreign / name).read_text() == "years of work"
        with pytest.raises(InvalidProblemError, match="this is a file"):
            save_solution(solution, foreign / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["problem", "thesis"]


def test_what_appears_during_the_writing_survives(solution, tmp_path):
    folder = save_solution(solution, tmp_path / "mine")
    with pytest.raises(InvalidProblemError, match=r"'thesis\.tex' in this folder"):
        save_solution(solution, folder, lambda *_: (folder / "thesis.tex").write_text("years of work"))
    assert (folder / "thesis.tex").exists()
    assert load_solution(folder).converged


def test_every_picture_is_known_as_our_own():
    assert set(PICTURES) == set(FIGURES)


def test_a_link_is_kept_and_what_it_names_is_replaced(solution, tmp_path):
    (tmp_path / "link").symlink_to("behind")
    for _ in range(2):
        save_solution(solution, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert load_solution(tmp_path / "behind").converged
    assert sorted(path.name for path in tmp_path.iterdir()) == ["behind", "link"]
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(InvalidProblemError, match="cannot write here"):
        check_target(tmp_path / "circle")


def test_trying_leaves_no_trace(solution, tmp_path, monkeypatch):
    check_target(tmp_path / "a" / "b" / "c")
    assert list(tmp_path.iterdir()) == []
    folder = save_solution(solution, tmp_path / "mine")
    before = tree(tmp_path)
    check_target(folder)
    assert tree(tmp_path) == before
    monkeypatch.chdir(folder)
    for place in (Path(), folder):
        with pytest.raises(InvalidProblemError, match=r"current folder|in this folder"):
            check_target(place)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("existing", [False, True])
def test_a_place_where_nothing_can_be_renamed_is_refused_at_once(solution, tmp_path, monkeypatch, existing):
    """As mount points, sticky folders and quotas do."""

    def refuse(*_):
        raise OSError(16, "Device or resource busy")

    folder = tmp_path / "out"
    if existing:
        save_solution(solution, folder)
    before = tree(tmp_path)
    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(InvalidProblemError, match="out: cannot write here: Device or resource busy"):
        check_target(folder)
    assert tree(tmp_path) == before


def test_ctrl_c_waits_for_the_files(solution, tmp_path):
    """Twice: outside the command line nobody else would notice."""

    def stop(*_):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        save_solution(solution, tmp_path / "out", stop)
    assert load_solution(tmp_path / "out").converged
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


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


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EDQUOT, errno.EIO])
def test_numbers_survive_pictures_that_do_not_fit_and_say_so(number, solution, tmp_path):
    def greedy(_, folder):
        (folder / "half.png").write_bytes(b"\x89PNG")
        raise OSError(number, os.strerror(number))

    folder = save_solution(solution, tmp_path / "out", greedy)
    assert not (folder / "half.png").exists()
    back = load_solution(folder)
    assert back.converged
    (warning,) = back.warnings
    assert f"the pictures could not be written ({os.strerror(number)})" in warning
    assert f"nhpocp plot {folder}" in warning
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        name for name in DATA if name != "iterations.csv"
    )


def test_a_disk_with_no_room_for_a_warning_keeps_the_numbers(solution, tmp_path, monkeypatch):
    def greedy(*_, **__):
        monkeypatch.setattr(Path, "write_text", greedy)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    written = store_solution(solution, tmp_path / "out", greedy)
    monkeypatch.undo()
    assert "could not be written" in written.warnings[0]
    assert load_solution(tmp_path / "out").converged


# --- what is read ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(solution, tmp_path_factory):
    return save_solution(solution, tmp_path_factory.mktemp("stored") / "out")


@pytest.fixture
def folder(stored, tmp_path):
    return Path(shutil.copytree(stored, tmp_path / "copy"))


def refused(folder, name, *words):
    """The error of reading a damaged folder: it names folder and file, and speaks our words."""
    with pytest.raises(UnreadableSolutionError) as caught:
        load_solution(folder)
    assert str(folder / name) in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("solution.json", b""),
        ("solution.json", b"{"),
        ("solution.json", b"[1]"),
        ("solution.json", b"\xff\xfe{}"),
        ("solution.json", b'{"schema_version": 2}'),
        ("solution.json", b'{"schema_version": 1}'),
        ("solution.json", b'{"schema_version": 1, "details": ' + 100_000 * b"[" + 100_000 * b"]" + b"}"),
        ("solution.json", b'{"name": "\\ud800"}'),
        ("arrays.npz", b""),
        ("arrays.npz", b"no archive"),
        ("arrays.npz", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1,)}"),
        ("problem.yaml", b"nhpocp: [1"),
        ("problem.yaml", b"\xff"),
        ("problem.yaml", 10_000 * b"["),
    ],
)
def test_damaged_files_are_named(folder, name, content):
    (folder / name).write_bytes(content)
    refused(folder, name)


@pytest.mark.parametrize("name", ["solution.json", "problem.yaml", "arrays.npz"])
def test_missing_files_are_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(UnreadableSolutionError, match=f"copy: no solution folder: {name} is missing"):
        load_solution(folder)
    (folder / name).mkdir()
    refused(folder, name, "folder" if name == "problem.yaml" else "Is a directory")


def test_missing_folder(tmp_path):
    for place in (tmp_path, tmp_path / "none", tmp_path / ("x" * 300)):
        with pytest.raises(UnreadableSolutionError, match=place.name):
            load_solution(place)


def test_every_bit_of_the_arrays_may_flip(folder, solution):
    """Either it is noticed, or it stood where nothing depends on it, such as a date."""
    file, random = folder / "arrays.npz", np.random.default_rng(0)
    content = file.read_bytes()
    bits = 8 * len(content)
    for place in [*random.integers(0, bits, 100), *range(0, 700, 7), *range(bits - 8000, bits, 41)]:
        flipped = bytearray(content)
        flipped[place // 8] ^= 1 << place % 8
        file.write_bytes(flipped)
        try:
            arrays = read_arrays(file, 10**6)
        except UnreadableSolutionError as error:
            assert str(file) in str(error)  # noqa: PT017
        else:
            for values in arrays.values():
                assert any(np.array_equal(values, right) for right in solution.trajectory.values())
    for length in [0, 3, *random.integers(0, len(content) - 1, 5)]:
        file.write_bytes(content[:length])
        refused(folder, "arrays.npz")


def edit(folder, *path, value):
    """Sets one place of solution.json."""
    data = json.loads((folder / "solution.json").read_text())
    here = data
    for part in path[:-1]:
        here = here[part]
    here[path[-1]] = value
    (folder / "solution.json").write_text(json.dumps(data))


ZEROS = np.zeros((2, 5)).tolist()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("tolerance", "1e-3"),
        ("tolerance", None),
        ("tolerance", True),
        ("tolerance", -1.0),
        ("tolerance", 1e9),  # what verification would allow
        ("tolerance", 10**400),
        ("settings.tolerance", 1e9),
        ("settings.tolerance", "1e-3"),
        ("settings.gamma", "fast"),
        ("settings", []),
        ("outcome", "won"),
        ("outcome", 3),
        ("message", None),
        ("final_error", "small"),
        ("final_error", math.nan),
        ("iterations", "abc"),
        ("iterations", [1]),
        ("iterations", [{"k": "zero"}]),
        ("iterations", [{"k": 0, "error": "big"}]),
        ("evaluations", "abc"),
        ("evaluations", -1),
        ("effort", "much"),
        ("warnings", "one"),
        ("timing", {"build_s": "long"}),
        ("timing", None),
        ("details", "none"),
        ("verified", True),
        ("verified.error", "0"),
        ("verified.ok", 1),
        ("verified.original", {"ok": True}),
        ("crossings", [{"which": "det_w"}]),
        ("constraints", {"leg_length": {"worst": "0", "ok": True, "t": 0, "component": []}}),
        ("control", None),
        ("control.coefficients", ZEROS),
        ("control.coefficients", [[1.0] * 4] * 3),
        ("control.coefficients", [1.0, 2.0]),
        ("control.coefficients", "abc"),
        ("control.coefficients", [["a"] * 5] * 3),
        ("control.coefficients", [[None] * 5] * 3),
        ("control.coefficients", []),
        ("control.horizon", 0),
        ("control.horizon", -1.0),
        ("control.horizon", "1"),
        ("control.horizon", None),
        ("control.basis", "wavelets"),
        ("control.basis", ["fourier"]),
        ("control.input", "u"),
        ("trajectory", []),
        ("trajectory.t", "abc"),
        ("trajectory.t", [0.0]),
        ("trajectory.t", ["0.0"] * 201),
        ("trajectory.position", [[0.0, 0.0]] * 201),
        ("trajectory.position", [[0.0, 0.0, 0.0]] * 201),  # another path than that of arrays.npz
        ("trajectory.position", [[0.0, 0.0, "0"]] * 201),
        ("trajectory.position", {}),
        ("trajectory.u", [[0.0], [0.0, 1.0]]),
    ],
)
def test_wrong_types_and_shapes_are_refused_on_reading(folder, path, value):
    edit(folder, *path.split("."), value=value)
    # two copies that differ are the fault of either
    refused(folder, "arrays.npz" if value == [[0.0, 0.0, 0.0]] * 201 else "solution.json")


def test_refusals_name_the_key(folder):
    edit(folder, "iterations", 2, "error", value="big")
    refused(folder, "solution.json", "iterations[2].error", "expected a number, got the text 'big'")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("t", np.zeros(200)),
        ("t", np.zeros((201, 1))),
        ("t", np.full(201, np.nan)),
        ("t", np.zeros(0)),
        ("position", np.zeros((201, 2))),
        ("position", np.zeros((200, 3))),
        ("position", np.zeros(())),
        ("orientation", np.zeros((201, 9))),
        ("v", np.zeros((201, 4))),
        ("u", np.zeros((201, 3, 1))),
        ("sigma_s", np.zeros((201, 2))),
        ("u", np.full((201, 3), "text")),
        ("u", np.zeros((201, 3), dtype=complex)),
        ("position", np.zeros((201, 3))),  # another path than that of solution.json
    ],
)
def test_wrong_arrays_are_refused_on_reading(folder, name, values):
    with np.load(folder / "arrays.npz") as file:
        arrays = dict(file)
    np.savez(folder / "arrays.npz", **{**arrays, name: values})
    refused(folder, "arrays.npz", *([] if name == "t" else [f": {name}: "]))


@pytest.mark.parametrize("name", ["t", "position", "v"])
def test_missing_arrays_are_named(folder, name):
    with np.load(folder / "arrays.npz") as file:
        np.savez(folder / "arrays.npz", **{key: file[key] for key in file if key != name})
    refused(folder, "arrays.npz", f"{name}: this array is missing")


def test_arrays_are_never_unpickled(folder):
    np.savez(folder / "arrays.npz", t=np.array([{"a": 1}], dtype=object))
    refused(folder, "arrays.npz", "damaged")


def test_further_keys_and_arrays_are_welcome(folder):
    edit(folder, "author", value="me")
    with np.load(folder / "arrays.npz") as file:
        np.savez(folder / "arrays.npz", **file, mine=np.zeros((201, 7), dtype=np.float32))
    assert load_solution(folder).trajectory["mine"].shape == (201, 7)


def test_a_log_in_any_encoding_is_read(folder):
    (folder / "solver.log").write_bytes(b"E = 1 \xb5m")
    assert "E = 1" in load_solution(folder).log


def test_plain_makes_strict_json():
    assert plain({"a": [math.nan, math.inf, np.float64(1), np.int64(2)], "b": np.eye(1)}) == {
        "a": [None, None, 1.0, 2],
        "b": [[1.0]],
    }


@pytest.mark.parametrize("packing", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize("honest", [True, False])
def test_arrays_that_unpack_to_more_than_the_trajectory_are_refused_first(folder, packing, honest):
    """40 MB in few bytes, its directory saying so or not."""
    with zipfile.ZipFile(folder / "arrays.npz", "a", packing) as archive:
        with archive.open("y.npy" if honest else "x.npy", "w", force_zip64=True) as member:
            for _ in range(40):
                member.write(bytes(10**6))
        if not honest:
            archive.getinfo("x.npy").file_size = 80
    tracemalloc.start()
    try:
        refused(folder, "arrays.npz", "damaged")
        assert tracemalloc.get_traced_memory()[1] < 3e7
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["solution.json", "solver.log", "arrays.npz", "problem.yaml"])
def test_pipes_in_a_folder_are_not_waited_for(folder, name):
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    refused(folder, name, "this is a pipe; expected a file")


def test_files_larger_than_any_solution_are_refused(folder):
    for name in ("solver.log", "solution.json"):
        with (folder / name).open("r+b" if name != "solver.log" else "wb") as file:
            file.truncate(LARGEST_FILE + 1)
        refused(folder, name, "larger than 200 MB")


@pytest.mark.parametrize(
    ("stored", "kind", "elsewhere"),
    [
        (StoredReplay, Replay, set()),
        (StoredVerdict, Verdict, {"crossings", "bounds"}),
        (StoredCrossing, Crossing, {"state"}),
        (StoredBound, BoundReport, {"bound", "name"}),  # its name is worked out
    ],
)
def test_what_is_stored_of_a_verdict_is_all_of_it(stored, kind, elsewhere):
    assert set(stored.model_fields) ^ {part.name for part in fields(kind)} == elsewhere


def test_numbers_that_are_none_are_null_in_the_file_and_nan_again():
    report = BoundReport(Bound("b", "q", 0.0, 1.0), math.nan, 0.5, (1, 0), False)
    written = json.dumps(plain(StoredBound.written(report)))
    read = StoredBound.model_validate_json(written).report(report.bound)
    assert json.loads(written)["worst"] is None
    assert (read.time, read.component, read.ok) == (0.5, (1, 0), False)
    assert all(math.isnan(value) for value in (read.worst, read.value, read.allowed))
