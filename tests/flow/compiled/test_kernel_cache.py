"""Where kernels are kept and who builds them: homes, compilers, and builds that were given up."""

from __future__ import annotations

import errno
import json
import os
import platform
import pwd
import time
from pathlib import Path

import pytest

from nhpocp import provenance
from nhpocp.cli.entry import status
from nhpocp.flow.compiled import kernel_build, kernel_cache
from nhpocp.flow.compiled.kernels import Compiled, CompiledWhenReady
from tests.conftest import paper_problem
from tests.flow.compiled.test_kernels import end_point, forget, needs_compiler, stored

PROBLEM = str(Path(__file__).parents[3] / "problems" / "unicycle.yaml")
SETTINGS = ("--set", "output.pictures=false", "--set", "solvers.compile=always")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty cache, a process that knows of no kernel, and a folder to work in."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("NHPOCP_CACHE", str(folder))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(kernel_build, "FLAGS", (("-O0", "-fPIC", "-shared"),))
    forget()
    yield folder
    forget()


@pytest.fixture(params=["no home", "the home of nobody"])
def homeless(request, monkeypatch):
    """A user without an entry in the list of users, or a cache in the home of one who is not there."""

    def unknown(uid):
        raise KeyError(f"getpwuid(): uid not found: {uid}")

    for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA", "NHPOCP_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    if request.param != "no home":
        monkeypatch.setenv("HOME", "/")
        monkeypatch.setenv("NHPOCP_CACHE", "~nosuchuser/c")
    return "has no home" if request.param == "no home" else "'~nosuchuser/c', in a home that is not known"


# --- homes ------------------------------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("solver", ["jacobian", "nlp"])
def test_without_a_home_a_solve_is_interpreted_and_says_so_once(solver, homeless, caplog, capsys):
    assert status(["solve", PROBLEM, "--solver", solver, *SETTINGS]) == 0
    (said,) = [record.message for record in caplog.records]
    assert homeless in said
    assert "CasADi's own evaluation is used" in said
    assert "converged" in capsys.readouterr().out


@needs_compiler
def test_without_a_home_both_runs_of_a_comparison_converge(homeless, capsys):
    assert status(["compare", PROBLEM, *SETTINGS, "--json"]) == 0
    runs = json.loads(capsys.readouterr().out)["runs"]
    assert [run["outcome"] for run in runs] == ["converged", "converged"]


def test_without_a_home_doctor_says_what_is_missing(homeless, capsys):
    assert status(["doctor", "--clear-cache", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["cache"]
    assert (shown["folder"], shown["kernels"]) == (None, 0)
    assert homeless in shown["trouble"]


# --- compilers --------------------------------------------------------------------------------------------------------


@needs_compiler
def test_a_compiler_of_several_words_is_a_command(cache, tmp_path, monkeypatch):
    """`ccache gcc`, and a path with a blank in it."""
    real = provenance.c_compiler()[0]
    (tmp_path / "my tools").mkdir()
    wrapper = tmp_path / "my tools" / "wrap"
    wrapper.write_text('#!/bin/sh\nexec "$@"\n')
    wrapper.chmod(0o755)
    direct = tmp_path / "my tools" / "cc"
    direct.symlink_to(real)
    for number, named in enumerate((f"'{wrapper}' {real}", f"{real} -DUSELESS=1", str(direct)), 1):
        monkeypatch.setenv("CC", named)
        forget()
        end_point(Compiled())
        assert len(stored(cache)) == number  # the command is a part of what a kernel depends on
    assert provenance.c_compiler() == (str(direct),)


@pytest.mark.parametrize("named", ["nosuchcache gcc", "gcc 'without an end", "  "])
def test_a_command_that_is_no_compiler_is_named(named, cache, caplog, monkeypatch):
    monkeypatch.setenv("CC", named)
    end_point(Compiled())
    assert f"no C compiler was found (CC is {named!r})" in caplog.text


# --- who builds -------------------------------------------------------------------------------------------------------


@pytest.fixture
def begun(monkeypatch):
    """The workshops of builds that are begun, which nobody is sent to."""
    found = []
    monkeypatch.delenv("NHPOCP_COMPILE")
    monkeypatch.setattr(kernel_cache.subprocess, "Popen", lambda command, **_: found.append(command[4]))
    return found


def begin() -> None:
    """Asks for a kernel in the background, once CasADi's evaluation has cost something."""
    forget()
    system = paper_problem().system
    for _ in range(2):
        end_point(CompiledWhenReady(patience=1e-9), system)


def claim(folder: Path, key: str, owner: str, age: float = 0.0) -> Path:
    """A build that somebody is at, or was."""
    place = folder / f"{kernel_build.BUILDING}{key}"
    place.mkdir(parents=True)
    (place / kernel_build.SOURCE).write_text("")
    if owner:
        (place / kernel_build.OWNER).write_text(owner)
    os.utime(place, (time.time() - age,) * 2)
    return place


def gone() -> int:
    """The number of a process that has ended."""
    process = os.spawnlp(os.P_NOWAIT, "true", "true")
    os.waitpid(process, 0)
    return process


HERE = platform.node()


@pytest.mark.parametrize(
    ("owner", "age", "busy"),
    [
        (lambda: f"{HERE} {os.getpid()}", 0.0, True),
        (lambda: f"{HERE} {gone()}", 0.0, False),
        (lambda: f"{HERE} {os.getpid()}", 2 * kernel_build.STALE, False),  # a number that was given anew
        (lambda: f"{HERE} {os.getpid()}", -1e7, False),  # a clock that was wrong
        (lambda: "another.host 1", 0.0, True),
        (lambda: "another.host 1", 2 * kernel_build.STALE, False),
        (lambda: "another.host 1", -1e7, False),
        (lambda: "", 0.0, False),  # half written
    ],
)
def test_a_build_that_was_given_up_blocks_nobody(owner, age, busy, cache):
    place = claim(cache, "key", owner(), age)
    assert kernel_build.busy(place) == busy
    assert not kernel_build.busy(cache / "nothing")


@needs_compiler
def test_what_was_given_up_is_begun_again_and_what_is_not_is_left(cache, begun, monkeypatch):
    places, busy = [], kernel_build.busy
    monkeypatch.setattr(kernel_build, "busy", lambda place: places.append(place) or busy(place))
    begin()
    assert (begun[0] / kernel_build.SOURCE).read_text().strip()
    key = places[0].name.removeprefix(kernel_build.BUILDING)
    place = claim(cache, key, f"{HERE} {os.getpid()}")
    begin()
    assert len(begun) == 1
    (place / kernel_build.OWNER).write_text(f"{HERE} {gone()}")
    begin()
    assert len(begun) == 2
    assert set(places) == {place}
    assert not place.exists()


@needs_compiler
def test_a_full_disk_leaves_nothing_half_written(cache, begun, monkeypatch):
    def full(path, *_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    begin()
    assert list(cache.iterdir()) == []
    assert begun == []


@needs_compiler
def test_one_of_two_builders_gives_way(cache):
    cache.mkdir()
    first, second = (kernel_build.new_workshop(cache, "int a;") for _ in range(2))
    place = kernel_build.claimed(first, "key")
    assert place is not None
    assert kernel_build.busy(place)
    assert kernel_build.claimed(second, "key") is None
    assert list(cache.iterdir()) == [place]
    assert kernel_build.build(place, "key", provenance.c_compiler()) == ""
    assert [path.suffix for path in cache.iterdir()] == [".so"]
