"""Nothing of others is run: what lies in the folder of kernels counts only where nobody else can put it there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nhpocp import provenance
from nhpocp.flow.compiled import kernel_build, kernel_cache, kernel_folder
from nhpocp.flow.compiled.kernel_cache import Place, Recipe

needs_compiler = pytest.mark.skipif(not provenance.c_compiler(), reason="no C compiler")
KERNEL = b"what would be run"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A folder for kernels in a folder of the user's, and a process that said nothing yet."""
    folder = tmp_path / "home" / "cache"
    folder.mkdir(parents=True, mode=0o700)
    (tmp_path / "home").chmod(0o755)
    monkeypatch.setenv("NHPOCP_CACHE", str(folder))
    monkeypatch.setattr(kernel_build, "FLAGS", (("-O0", "-fPIC", "-shared"),))
    kernel_cache._said.clear()
    yield folder
    kernel_cache._said.clear()


@pytest.fixture
def loaded():
    """The files that were loaded."""
    return []


def recipe(loaded) -> Recipe:
    def load(path: Path) -> bytes:
        loaded.append(path)
        return path.read_bytes()

    return Recipe(lambda: "identity", lambda: "int a;", load, lambda _: True)


def stored(folder: Path, content: bytes = KERNEL) -> Path:
    """A kernel under the name that it has to have."""
    path = folder / f"{kernel_cache._key('identity')}-{kernel_build.digest(content)}.so"
    path.write_bytes(content)
    path.chmod(0o755)
    return path


def looked(loaded) -> Place:
    place = Place()
    place.look(recipe(loaded), 0.0)
    return place


def shared(cache, monkeypatch, mode=0o777):
    cache.chmod(mode)


def shared_with_a_group(cache, monkeypatch):
    shared(cache, monkeypatch, 0o770)


def sticky(cache, monkeypatch):
    shared(cache, monkeypatch, 0o1777)


def of_another(cache, monkeypatch):
    another = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: another)


def led_to_by_a_shared_one(cache, monkeypatch):
    cache.parent.chmod(0o777)


def led_to_by_a_groups(cache, monkeypatch):
    monkeypatch.setattr(kernel_folder, "_private", lambda group: False)
    cache.parent.chmod(0o775)


def a_link(cache, monkeypatch):
    cache.rename(cache.parent / "real")
    cache.symlink_to(cache.parent / "real")


def through_a_link_to_a_shared_one(cache, monkeypatch):
    there = cache.parents[1] / "shared" / "there"
    there.mkdir(parents=True)
    there.parent.chmod(0o777)
    cache.rename(there / "cache")
    (cache.parent / "link").symlink_to(there)
    monkeypatch.setenv("NHPOCP_CACHE", str(cache.parent / "link" / "cache"))


FOREIGN = pytest.mark.parametrize(
    "spoil",
    [
        shared,
        shared_with_a_group,
        sticky,
        of_another,
        led_to_by_a_shared_one,
        led_to_by_a_groups,
        a_link,
        through_a_link_to_a_shared_one,
    ],
)


@needs_compiler
@FOREIGN
def test_a_folder_that_others_can_change_is_not_used(spoil, cache, loaded, caplog, monkeypatch):
    kernel = stored(cache)
    workshop = cache / f"{kernel_build.BUILDING}{kernel.name[:32]}"
    workshop.mkdir()
    spoil(cache, monkeypatch)
    place = Place()
    place.seconds = 1.0
    place.look(recipe(loaded), 0.0)
    place.get(lambda _: True)
    assert loaded == []
    assert place.kernel is None
    (said,) = [record.message for record in caplog.records]
    assert "there is no place for kernels" in said
    assert "CasADi's own evaluation is used" in said
    assert kernel_folder.cached()["trouble"] in said
    assert kernel_folder.clear_cache() == 0
    assert sum(1 for _ in cache.parents[1].rglob("*.so")) == 1
    assert sum(1 for _ in cache.parents[1].rglob(f"{kernel_build.BUILDING}*")) == 1


@needs_compiler
def test_a_folder_of_ours_is_used_wherever_it_lies(cache, loaded, caplog, monkeypatch):
    """Under sticky folders, through links to our own, in a folder of the user's own group, named from where we are."""
    kernel = stored(cache)
    monkeypatch.setattr(kernel_folder, "_private", lambda group: True)
    cache.parent.chmod(0o775)
    looked(loaded)
    cache.parent.chmod(0o1777)
    looked(loaded)
    (cache.parents[1] / "link").symlink_to(cache.parent)
    monkeypatch.setenv("NHPOCP_CACHE", str(cache.parents[1] / "link" / "cache"))
    looked(loaded)
    for here, named in ((cache, "."), (cache.parent, "cache"), (cache.parent, "./cache/")):
        monkeypatch.chdir(here)
        monkeypatch.setenv("NHPOCP_CACHE", named)
        assert looked(loaded).kernel == KERNEL
    assert loaded == [kernel] * 6
    assert caplog.text == ""


def linked(kernel: Path) -> None:
    kernel.rename(kernel.parents[1] / "elsewhere")
    kernel.symlink_to(kernel.parents[1] / "elsewhere")


def piped(kernel: Path) -> None:
    kernel.unlink()
    os.mkfifo(kernel)


@needs_compiler
@pytest.mark.parametrize(
    "spoil",
    [lambda kernel: kernel.chmod(0o775), lambda kernel: kernel.chmod(0o757), linked, piped],
    ids=["group", "others", "link", "pipe"],
)
def test_a_file_that_others_can_change_is_removed_and_built_anew(spoil, cache, loaded, caplog):
    kernel = stored(cache)
    spoil(kernel)
    assert looked(loaded).untried
    assert loaded == []
    assert not kernel.is_symlink()
    assert not kernel.exists()
    assert [record.message.count("was removed") for record in caplog.records] == [1]
    assert (cache.parent / "elsewhere").exists() == (spoil is linked)
    Place().get(recipe(loaded))
    assert len(loaded) == 1
    assert loaded[0].read_bytes() != KERNEL


@needs_compiler
def test_a_file_of_another_is_not_loaded(cache, loaded, caplog, monkeypatch):
    kernel, true = stored(cache), os.fstat

    def foreign(number):
        found = list(true(number))
        found[4] += 1
        return os.stat_result(found)

    monkeypatch.setattr(os, "fstat", foreign)
    with pytest.raises(PermissionError, match="belongs to another user"):
        kernel_folder.content(kernel)


@needs_compiler
@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_what_is_built_is_ours_alone_under_every_umask(umask, tmp_path, loaded, caplog, monkeypatch):
    folder = tmp_path / "not" / "yet" / "there"
    monkeypatch.setenv("NHPOCP_CACHE", str(folder))
    before = os.umask(umask)
    try:
        Place().get(recipe(loaded))
        Place().get(recipe(loaded))
    finally:
        os.umask(before)
    assert len(loaded) == 2
    assert caplog.text == ""
    assert [path.stat().st_mode & 0o022 for path in (folder, folder.parent, loaded[0])] == [0, 0, 0]


@pytest.fixture
def precious(tmp_path):
    """A folder whose files are not ours to remove, last touched long ago."""
    folder = tmp_path / "precious"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    stored(folder)
    (folder / f"{kernel_build.BUILDING}x").mkdir()
    os.utime(folder, (time.time() - 1e6,) * 2)
    return folder


@needs_compiler
def test_nothing_is_removed_through_a_link(cache, precious, loaded, monkeypatch):
    begun, names = [], sorted(path.name for path in precious.iterdir())
    monkeypatch.setattr(kernel_cache.subprocess, "Popen", lambda command, **_: begun.append(command))
    link = cache / f"{kernel_build.BUILDING}{kernel_cache._key('identity')}"
    link.symlink_to(precious)
    place = Place()
    place.seconds = 1.0
    place.look(recipe(loaded), 0.0)
    assert len(begun) == 1
    assert not link.is_symlink()  # it would be in the way for good
    for name in (link.name, f"{kernel_build.BUILDING}other", stored(cache).name):
        (cache / name).unlink(missing_ok=True)
        (cache / name).symlink_to(precious)
    kernel_folder.clear_cache()
    assert list(cache.iterdir()) == []
    assert sorted(path.name for path in precious.iterdir()) == names


def test_only_kernels_are_removed_from_a_folder_of_libraries(cache):
    for name in ("libm-2.31.so", "x-y.so", f"{'0' * 32}-{'g' * 32}.so", f"{'0' * 32}-{'0' * 32}.so.bak"):
        (cache / name).write_bytes(b"")
    stored(cache)
    assert kernel_folder.cached()["kernels"] == 1
    assert kernel_folder.clear_cache() == 1
    assert len(list(cache.iterdir())) == 4


@needs_compiler
def test_a_kernel_that_cannot_be_loaded_is_told_once_and_built_anew(cache, loaded, caplog):
    kernel = stored(cache)

    def unloadable(path):
        raise OSError("invalid ELF header")

    Place().get(recipe(loaded)._replace(loaded=unloadable))
    assert "cannot be loaded and was removed" in caplog.text
    assert not kernel.exists()
    caplog.clear()
    for _ in range(2):
        Place().get(recipe(loaded))
    assert len(loaded) == 2
    assert caplog.text == ""


@needs_compiler
def test_where_nothing_may_be_run_nothing_is_built(cache, loaded, caplog, monkeypatch):
    class NoExec:
        f_flag = os.ST_NOEXEC

    monkeypatch.setattr(os, "statvfs", lambda path: NoExec)
    Place().get(recipe(loaded))
    assert "noexec" in caplog.text
    assert list(cache.iterdir()) == []


AS_NOBODY = [
    *("setpriv", "--reuid=12345", "--regid=12345", "--clear-groups"),
    *("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"),  # this Python may be in root's home
]


def becomes_nobody() -> bool:
    if os.name != "posix" or os.geteuid() != 0 or shutil.which("setpriv") is None:
        return False
    return (
        subprocess.run(
            [*AS_NOBODY, sys.executable, "-c", ""], check=False, stderr=subprocess.DEVNULL
        ).returncode
        == 0
    )


@pytest.mark.skipif(not becomes_nobody(), reason="only root can become another user, with setpriv")
@pytest.mark.parametrize(
    ("home", "trouble"),
    [({}, "the user has no home"), ({"HOME": "/nonexistent"}, "takes no kernels (Permission denied)")],
)
def test_a_user_without_a_name_or_home_does_without_the_cache(home, trouble, tmp_path):
    """As in a container that is run under any number."""
    tmp_path.chmod(0o777)
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": os.pathsep.join(sys.path), **home}
    problem = "unicycle.yaml"  # beside, for this clone may be in root's home too
    shutil.copy(Path(__file__).parents[3] / "problems" / problem, tmp_path)
    quick = ["--set", "output.pictures=false", "--set", "solvers.compile=always"]
    for verb, words in (
        (["check", problem], ""),
        (["doctor"], ""),
        (["solve", problem, *quick, "-o", "out"], trouble),
    ):
        command = [*AS_NOBODY, sys.executable, "-m", "nhpocp", *verb]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == bool(words)
