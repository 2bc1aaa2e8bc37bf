"""Written whole or not at all: files and folders, whatever ends the program meanwhile.

All that is written is made on a bench, a hidden folder beside its place, and moved there by one rename:

    .nhpocp-XXXX/lock   held by its process while that lives
    .nhpocp-XXXX/new/   what is in the making: ours altogether
    .nhpocp-XXXX/old/   folders between this bench and their place, under their own names

What a killed process left is known by a lock that nobody holds: `sweep`.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows: no bench is known to be left behind, and none is swept
    fcntl = None  # type: ignore[assignment]

BENCH = ".nhpocp-"  # how the names of benches begin
NOREPLACE, EXCHANGE = 1, 2  # RENAME_… of Linux
_UNSUPPORTED = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}  # by this kernel, or by this file system
_HERE = -100  # AT_FDCWD


@dataclass(frozen=True)
class Bench:
    """Where something is made before it takes its place."""

    folder: Path

    @property
    def new(self) -> Path:
        """What is in the making."""
        return self.folder / "new"

    @property
    def old(self) -> Path:
        """Folders on their way, which may hold what others wrote."""
        return self.folder / "old"


def write_file(file: Path, write: Callable[[Path], Any], *, new: bool = False) -> bool:
    """Has ``write`` make a file elsewhere, and puts it in its place; whether there was any.

    A link that stands there is replaced, not followed. Errors: `OSError`; where the file has to be ``new`` and is not,
    `FileExistsError`.
    """
    with bench(file.parent) as made:
        scratch = made.new / file.name
        write(scratch)
        if not os.path.lexists(scratch):
            return False
        if new:
            _rename_new(scratch, file)
        else:
            scratch.replace(file)
    return True


def write_text(file: Path, text: str, *, new: bool = False) -> None:
    """A file of this text in UTF-8, with line ends as they are. Errors: those of `write_file`."""

    def write(scratch: Path) -> None:  # names of folders, which texts may hold, need not be text
        scratch.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")

    write_file(file, write, new=new)


def write_files(folder: Path, write: Callable[[Path], Any]) -> None:
    """Has ``write`` make files in another folder, and once all are complete puts each in its place."""
    with bench(folder) as made:
        write(made.new)
        for file in sorted(made.new.iterdir()):
            file.replace(folder / file.name)


@contextmanager
def bench(place: Path) -> Iterator[Bench]:
    """A bench in this folder, which is made if it is missing; those of killed processes are cleared up."""
    place.mkdir(parents=True, exist_ok=True)
    sweep(place)
    made, lock = _claimed(place)
    try:
        yield made
    finally:
        _clear(made)
        os.close(lock)


def _claimed(place: Path) -> tuple[Bench, int]:
    while True:
        folder = Path(tempfile.mkdtemp(prefix=BENCH, dir=place))
        try:
            lock = _locked(folder)
            if lock is not None:
                (folder / "new").mkdir()
                (folder / "old").mkdir()
                return Bench(folder), lock
        except FileNotFoundError:
            continue  # somebody's `sweep` came between
        except OSError:
            _clear(Bench(folder))
            raise


def _locked(folder: Path) -> int | None:
    """The open lock of a bench; None where another process holds it."""
    lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    try:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.stat(folder / "lock")  # it may have been swept meanwhile
    except BlockingIOError:
        os.close(lock)
        return None
    except FileNotFoundError:
        os.close(lock)
        raise
    except OSError:  # no locks on this file system: nobody will sweep there either
        pass
    return lock


def sweep(place: Path, remove: Callable[[Path], Any] | None = None) -> None:
    """Clears up after processes that were killed in this folder.

    A folder that they had moved away from its place, and put nothing there, goes back; others are for ``remove``.
    """
    if fcntl is None:
        return
    with suppress(OSError):
        for entry in list(os.scandir(place)):
            if entry.name.startswith(BENCH) and _is_our_folder(entry):
                with suppress(OSError):
                    _sweep(Bench(Path(entry.path)), place, remove)


def _is_our_folder(entry: os.DirEntry[str]) -> bool:
    """Nothing is restored or deleted through a link, or for somebody else."""
    return entry.is_dir(follow_symlinks=False) and entry.stat(follow_symlinks=False).st_uid == os.geteuid()


def _sweep(left: Bench, place: Path, remove: Callable[[Path], Any] | None) -> None:
    lock = os.open(left.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused where its process lives
        with suppress(OSError):
            for entry in [] if left.old.is_symlink() else list(os.scandir(left.old)):
                home = place / entry.name
                if not os.path.lexists(home):
                    os.rename(entry.path, home)
                elif remove and entry.is_dir(follow_symlinks=False):
                    remove(Path(entry.path))
        _clear(left)
    finally:
        os.close(lock)


def _clear(made: Bench) -> None:
    """Removes a bench; what stands in `old` stays, and its folder with it."""
    try:
        made.new.rmdir()  # the usual end
    except OSError:
        shutil.rmtree(made.new, ignore_errors=True)  # which follows no link
    with suppress(OSError):
        if made.old.exists():
            made.old.rmdir()
        (made.folder / "lock").unlink(missing_ok=True)
        made.folder.rmdir()


def exchange(one: Path, other: Path) -> bool:
    """Two folders take each other's place at one instant; False where the system cannot do that."""
    return _renameat2(one, other, EXCHANGE)


def _rename_new(scratch: Path, file: Path) -> None:
    if _renameat2(scratch, file, NOREPLACE):
        return
    if os.path.lexists(file):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(file))
    scratch.rename(file)


def _renameat2(source: Path, target: Path, flags: int) -> bool:
    rename = _system_renameat2()
    if rename is None:
        return False
    if rename(_HERE, os.fsencode(source), _HERE, os.fsencode(target), ctypes.c_uint(flags)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:
        return False
    raise OSError(number, os.strerror(number), str(target))


@cache
def _system_renameat2() -> Any:
    """Of Linux; None elsewhere."""
    try:
        return ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):
        return None
