"""Sweeps, tables and folders of runs where the machine refuses: one line says so, and the sweep goes on afterwards."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import shutil
import signal
import sys
from datetime import UTC, datetime, timedelta

import pytest

from nhpocp.cli import entry
from nhpocp.study import run, store
from nhpocp.study.store import Store
from nhpocp.study.study import read_study_text
from nhpocp.study.sweep import sweep
from tests.study.test_sweep import UNICYCLE, alike, begun, here, rows

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits and capabilities of Linux")
SWEEP = ["sweep", "corners.yaml", "-o", "out", "--resume"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a study and its store."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "corners.yaml").write_text(UNICYCLE)
    study = read_study_text(UNICYCLE, "corners.yaml")
    with Store.create(folder / "study.sqlite", study, resume=False) as opened:
        assert sweep(study, opened, 1, make=here).converged == 12
    return folder


@pytest.fixture
def folder(whole, tmp_path, monkeypatch):
    """With a study; its sweeps work in the process that begins them."""
    monkeypatch.setattr("nhpocp.study.sweep.processes", lambda *_: here())
    shutil.copy(whole / "corners.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ended(arguments, arrange=lambda: None):
    """(exit status, messages) of a verb in a process of its own, arranged so before."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        words, status = io.StringIO(), 99
        try:
            with contextlib.redirect_stderr(words), contextlib.redirect_stdout(io.StringIO()):
                arrange()
                status = entry.status(arguments)
        finally:
            os.write(writing, (words.getvalue() or "-").encode()[-4000:])
            os._exit(status)
    os.close(writing)
    with open(reading, encoding="utf-8") as said:
        words = said.read()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), words.strip("-")


def room(size):
    """No file may grow beyond so many bytes."""
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def memory(megabytes):
    """So much more, and no thread but those there are."""
    import resource

    with open("/proc/self/statm", encoding="ascii") as pages:
        now = int(pages.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + megabytes * 2**20, resource.RLIM_INFINITY))


def without_privileges():
    """Root heeds the modes of files, as others do."""
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    assert ctypes.CDLL(None).capset(header, (ctypes.c_uint32 * 6)()) == 0


@pytest.mark.parametrize("size", [0, 5000, 45_000])
def test_a_sweep_goes_on_once_the_disk_has_room(size, folder, whole):
    status, words = ended(SWEEP, lambda: room(size))
    assert status == 2
    assert words.startswith("out/study.sqlite: cannot use this store: ")
    assert words.count("\n") == 1
    assert ended(SWEEP) == (0, "")
    alike(rows(folder / "out/study.sqlite"), rows(whole / "study.sqlite"))


@pytest.mark.parametrize("megabytes", [1, 10, 60])
def test_a_sweep_without_memory_ends_in_words(megabytes, folder):
    status, words = ended(SWEEP, lambda: memory(megabytes))
    assert status in (0, 1, 2)
    assert "Traceback" not in words
    assert ended(SWEEP)[0] in (0, 1)
    assert [row["run"] for row in rows(folder / "out/study.sqlite")] == list(range(1, 13))


def test_a_library_that_finds_no_memory_is_told_in_a_line(tmp_path, monkeypatch, capsys):
    store = tmp_path / "study.sqlite"
    store.touch()

    def fail(*_):
        raise ImportError("libopenblas.so: failed to map segment from shared object")

    monkeypatch.setattr(Store, "open", fail)
    assert entry.status(["export", str(store)]) == 1
    assert capsys.readouterr().err == "out of memory: a library finds no room\n"


def test_a_full_disk_has_no_room_for_a_table_or_a_folder(folder, whole):
    store = str(whole / "study.sqlite")
    status, words = ended(["export", store, "-o", "runs.csv"], lambda: room(500))
    assert (status, words) == (2, "runs.csv: cannot write here: File too large\n")
    status, words = ended(["solve", "--from", store, "--run", "3", "-o", "one"], lambda: room(500))
    assert (status, words) == (2, "one: cannot write here: File too large\n")
    assert [path.name for path in folder.iterdir()] == ["corners.yaml"]


def test_where_nothing_may_be_written_stores_are_read_all_the_same(folder, whole):
    shut = folder / "shut"
    shutil.copytree(whole, shut)
    shut.chmod(0o555)
    try:
        denied = "cannot write here: Permission denied\n"
        for arguments, place in [
            (["sweep", "corners.yaml", "-o", "shut/new"], "shut/new/study.sqlite"),
            (["export", "shut/study.sqlite"], "shut/study.csv"),
            (["solve", "--from", "shut/study.sqlite", "--run", "3", "-o", "shut/one"], "shut/one"),
        ]:
            assert ended(arguments, without_privileges) == (2, f"{place}: {denied}")
        assert ended(["export", "shut/study.sqlite", "-o", "runs.csv"], without_privileges) == (0, "")
    finally:
        shut.chmod(0o755)
    assert len((folder / "runs.csv").read_text().splitlines()) == 13


def test_a_clock_that_goes_back_changes_no_row(folder, whole, monkeypatch):
    class Backwards(datetime):
        hours = 0

        @classmethod
        def now(cls, tz=None):
            cls.hours += 1
            return datetime(2026, 1, 2, tzinfo=UTC) - timedelta(hours=cls.hours)

    monkeypatch.setattr(run, "datetime", Backwards)
    monkeypatch.setattr(store, "datetime", Backwards)
    monkeypatch.setattr("nhpocp.study.sweep.perf_counter", lambda: float(-Backwards.hours))
    study = read_study_text(UNICYCLE, "corners.yaml")
    with Store.create(folder / "study.sqlite", study, resume=False) as opened:
        assert sweep(study, opened, 1, make=here).rate > 0
        (began,) = (row["finished"] for row in opened.rows("run = 1"))
    assert began < "2026-01-02"
    alike(rows(folder / "study.sqlite"), rows(whole / "study.sqlite"))


def test_a_strange_machine_and_a_strange_path(tmp_path):
    """No home, no compiler, no display, decimal commas, a plugin that cannot be loaded, and workers that have none."""
    folder = tmp_path / "a b\n'ü\" $(x)"
    folder.mkdir()
    few = UNICYCLE.replace("[0.5, 2, 4]", "[1, 2, 2]").replace("[0, 30 deg, -pi/4]", "[0]")
    (folder / "läufe 1.yaml").write_text(few, encoding="utf-8")
    plugin = tmp_path / "plugins" / "bad-1.dist-info"
    plugin.mkdir(parents=True)
    (plugin / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1\n")
    (plugin / "entry_points.txt").write_text("[nhpocp.systems]\nferry = nowhere:Ferry\n")
    strange = {"PATH": "/nonexistent", "HOME": "/nonexistent", "LC_ALL": "de_DE.UTF-8", "DISPLAY": ":99"}
    path = os.pathsep.join([os.getcwd(), str(plugin.parent)])
    process = begun("sweep", "läufe 1.yaml", "--workers", 1, cwd=folder, **strange, PYTHONPATH=path)
    out, errors = process.communicate(timeout=240)
    assert (process.returncode, errors) == (0, "")
    assert "2 of 2 runs: 2 solved and verified" in out
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        assert entry.status(["export", "results/corners/study.sqlite", "-o", "ä\n.csv"]) == 0
    first = (folder / "ä\n.csv").read_text().splitlines()[1].split(",")
    assert float(first[3]) == 1.0
