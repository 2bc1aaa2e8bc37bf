"""Whatever ends the program, and wherever: the old result or the new one is there, whole."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from nhpocp import comparison, planning, whole
from nhpocp.cli.entry import status
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import load_problem
from nhpocp.solution_folder import check_target, load_solution, save_solution, target
from nhpocp.views import figures
from nhpocp.whole import BENCH, bench, sweep, write_file, write_files, write_text

posix = pytest.mark.skipif(os.name != "posix", reason="processes and locks of POSIX")
UNICYCLE = Path(__file__).parents[2] / "problems" / "unicycle.yaml"


@pytest.fixture(scope="module")
def old():
    problem = load_problem(UNICYCLE, ["output.pictures=false", "output.samples=11", "name=u"])
    return replace(planning.solve(problem), message="old")


@pytest.fixture(scope="module")
def new(old):
    return replace(old, message="new")


def tree(folder):
    """Everything under a folder with its content."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


# --- what killed runs left -------------------------------------------------------------------------------------------


@posix
def test_what_others_are_writing_is_left_to_them(tmp_path):
    with bench(tmp_path) as made:
        (made.new / "half").write_text("…")
        sweep(tmp_path)
        with bench(tmp_path):
            pass
        assert (made.new / "half").exists()
    assert list(tmp_path.iterdir()) == []


@posix
def test_nothing_is_swept_or_restored_through_links(tmp_path):
    mine = tmp_path / "mine"
    for name in ("new", "old"):
        (mine / name).mkdir(parents=True)
        (mine / name / "thesis.tex").write_text("years of work")
    before = tree(mine)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / f"{BENCH}link").symlink_to(mine)
    (tmp_path / "a" / f"{BENCH}inside").mkdir()
    for name in ("new", "old"):
        (tmp_path / "a" / f"{BENCH}inside" / name).symlink_to(mine / name)
    sweep(tmp_path / "a", lambda path: path.unlink())
    assert tree(mine) == before
    assert not (tmp_path / "a" / "thesis.tex").exists()


# --- full disks, links, files of others ------------------------------------------------------------------------------


def stump(file):
    """Half a file, and a full disk."""
    with open(file, "w") as stream:
        stream.write("half")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(
    "write", [write_file, lambda file, act: write_files(file.parent, lambda to: act(to / file.name))]
)
def test_a_full_disk_leaves_the_old_file(write, tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("old")
    with pytest.raises(OSError, match="No space"):
        write(file, stump)
    assert tree(tmp_path) == {"a.txt": b"old"}
    write(file, lambda scratch: scratch.write_text("new"))
    assert tree(tmp_path) == {"a.txt": b"new"}


@pytest.mark.parametrize("supported", [True, False])
def test_a_new_file_replaces_nothing(supported, tmp_path, monkeypatch):
    if not supported:
        monkeypatch.setattr(whole, "_system_renameat2", lambda: None)
    write_text(tmp_path / "a", "1", new=True)
    with pytest.raises(FileExistsError):
        write_text(tmp_path / "a", "2", new=True)
    assert tree(tmp_path) == {"a": b"1"}


@pytest.mark.parametrize("verb", [["init", "p.yaml"], ["schema", "-o", "s.json"]])
def test_first_files_that_do_not_fit_can_be_written_later(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", lambda file, *_, **__: stump(file))
        assert status(verb) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert status(verb) == 0


def test_plot_keeps_good_pictures_where_there_is_no_room(old, tmp_path, monkeypatch, capsys):
    folder = save_solution(old, tmp_path / "out")
    (folder / "controls.png").write_text("good")
    before = tree(tmp_path)
    monkeypatch.setattr(figures, "save", lambda _, file, *text: stump(file))
    assert status(["plot", str(folder)]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert tree(tmp_path) == before


def test_plot_replaces_links_and_follows_none(old, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "names_of", lambda _: ["controls"])
    outside = tmp_path / "thesis.png"
    outside.write_text("years of work")
    folder = save_solution(old, tmp_path / "out")
    for kind in ("png", "svg"):
        (folder / f"controls.{kind}").symlink_to(outside)
    assert status(["plot", str(folder)]) == 0
    assert outside.read_text() == "years of work"
    assert not (folder / "controls.png").is_symlink()
    assert (folder / "controls.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("place", ["report.html", "comparison.csv", "comparison.json", "u/animation.html"])
def test_compare_refuses_files_of_others_before_it_solves(place, tmp_path, monkeypatch, capsys):
    def solve(*_, **__):
        raise AssertionError("solved")

    monkeypatch.setattr(comparison, "compare", solve)
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_text("my own words")
    before = tree(tmp_path)
    assert status(["compare", str(UNICYCLE), "--set", "name=u", "-o", str(tmp_path), "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["file"] == str(tmp_path / place)
    assert "was not written by nhpocp" in error["message"]
    assert tree(tmp_path) == before


def test_a_target_is_looked_at_and_never_moved(old, tmp_path, monkeypatch):
    folder = save_solution(old, tmp_path / "out")
    moved = []
    for name in ("rename", "replace"):
        before = getattr(os, name)
        monkeypatch.setattr(os, name, lambda a, b, before=before: moved.append(Path(a)) or before(a, b))
    check_target(folder)
    assert moved
    assert folder not in moved


@posix
def test_what_is_written_into_a_folder_as_it_is_exchanged_survives(old, new, tmp_path, monkeypatch):
    folder = save_solution(old, tmp_path / "out")
    before = target.exchange

    def late(one, other):
        (folder / "thesis.tex").write_text("years of work")
        monkeypatch.setattr(target, "exchange", before)
        return before(one, other)

    if not before(save_solution(old, tmp_path / "a"), save_solution(old, tmp_path / "b")):
        late = before  # two renames, in whose midst nothing can be written there
        (folder / "thesis.tex").write_text("years of work")
    monkeypatch.setattr(target, "exchange", late)
    with pytest.raises(InvalidProblemError, match=r"'thesis\.tex' in this folder"):
        save_solution(new, folder)
    assert (folder / "thesis.tex").read_text() == "years of work"
    assert load_solution(folder).message == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "out"]


@posix
def test_a_folder_that_cannot_be_moved_is_refused_at_once(old, tmp_path, monkeypatch):
    folder = save_solution(old, tmp_path / "out")
    monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == folder)
    with pytest.raises(InvalidProblemError, match="busy"):
        check_target(folder)
