"""The folder that kernels are kept in. What lies there is run, so it counts only where nobody else can put it there.

A kernel's name holds a digest of its content, which shows damage and no more: whoever writes the file writes the name.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from nhpocp.flow.compiled import kernel_build

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
ADVICE = "NHPOCP_CACHE may name a folder of yours"
_KERNEL = re.compile(rf"[0-9a-f]{{32}}-[0-9a-f]{{32}}{re.escape(kernel_build.SUFFIX)}")


def cache_folder() -> Path:
    """Where kernels are kept: NHPOCP_CACHE, or the user's cache folder. Errors: `OSError` where nothing says where."""
    given = os.environ.get("NHPOCP_CACHE")
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        folder = Path(given).expanduser() if given else _of_user(home)
    except RuntimeError as error:  # of a user without a home directory, or of ~nobody
        words = f"NHPOCP_CACHE is {given!r}, in a home that is not known" if given else "the user has no home"
        raise OSError(errno.ENOENT, f"{words}; {ADVICE}") from error
    return folder.absolute()  # a bare name would be looked for among the system's libraries


def _of_user(home: str | None) -> Path:
    return (Path(home) if home else Path.home() / ".cache") / "nhpocp"


def our_folder() -> Path | None:
    """The cache's folder, its parents' links followed; None where there is none yet.

    Errors: `OSError` saying why it is not for us alone.
    """
    given = cache_folder()
    folder = given.parent.resolve() / given.name
    _check_way(folder)
    try:
        status = folder.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    if not stat.S_ISDIR(status.st_mode):
        raise _foreign(folder, "is no folder" if not stat.S_ISLNK(status.st_mode) else "is a link")
    _check_ours(folder, status)
    if os.name == "posix" and os.statvfs(folder).f_flag & getattr(os, "ST_NOEXEC", 0):
        raise _foreign(folder, "lies where nothing may be run (noexec)")
    return folder


def made_folder() -> Path:
    """`our_folder`, made where it is missing, with what leads there."""
    folder = our_folder()
    if folder is None:
        given = cache_folder()
        folder = given.parent.resolve() / given.name
        for place in reversed([folder, *folder.parents]):
            if not place.is_dir():
                with suppress(FileExistsError):  # another process was faster
                    place.mkdir(mode=0o700)
        folder = our_folder() or folder
    return folder


def kernels(folder: Path, key: str = "") -> list[Path]:
    """What has the name of a kernel, of any or of one key; nothing else is ever touched."""
    return sorted(
        path for path in folder.iterdir() if _KERNEL.fullmatch(path.name) and path.name.startswith(key)
    )


def content(kernel: Path) -> bytes:
    """What a kernel's file holds. Errors: `OSError` saying why it is none of ours."""
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with open(os.open(kernel, os.O_RDONLY | flags), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is no file")
        _check_ours(kernel, status)
        return file.read()


def cached() -> dict[str, Any]:
    """The cache's folder, its number of kernels and their bytes; where it is not used, why."""
    shown: dict[str, Any] = {"folder": None, "kernels": 0, "bytes": 0}
    try:
        shown["folder"] = str(cache_folder())
        folder = our_folder()
        sizes = [path.lstat().st_size for path in kernels(folder)] if folder else []
    except OSError as error:
        return {**shown, "trouble": error.strerror}
    return {**shown, "kernels": len(sizes), "bytes": sum(sizes)}


def clear_cache() -> int:
    """Removes every kernel, and builds that were given up, from a folder that is ours; the kernels' number."""
    try:
        folder = our_folder()
    except OSError:
        folder = None  # no folder of ours, no kernels
    if folder is None:
        return 0
    removed = kernels(folder)
    for path in removed:
        path.unlink(missing_ok=True)
    for workshop in folder.glob(f"{kernel_build.BUILDING}*"):
        remove_workshop(workshop)
    return len(removed)


def remove_workshop(place: Path) -> None:
    """A build that was given up; of a link the link alone."""
    if place.is_symlink() or place.is_file():
        with suppress(OSError):
            place.unlink()
    else:
        shutil.rmtree(place, ignore_errors=True)


def _check_way(folder: Path) -> None:
    """Raises where others can put another folder in this one's place: by renaming one that leads to it."""
    if os.name != "posix":
        return
    masters = {os.geteuid(), 0, os.stat("/").st_uid}  # inside a container root may have another number
    for place, status in _existing(folder):
        if status.st_uid not in masters:
            raise _foreign(place, "belongs to another user")
        shared = status.st_mode & OTHERS_WRITE and not status.st_mode & stat.S_ISVTX
        if shared and (status.st_mode & stat.S_IWOTH or not _private(status.st_gid)):
            raise _foreign(place, "can be written to by others")


def _existing(folder: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Every folder that leads to this one."""
    for place in folder.parents:
        with suppress(FileNotFoundError, NotADirectoryError):
            yield place, place.stat()


def _private(group: int) -> bool:
    """Whether a group is its user's own, which many systems give to everyone, with folders that it may write to."""
    import grp
    import pwd

    try:
        owners, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return owners.gr_name == user.pw_name and set(owners.gr_mem) <= {user.pw_name}


def _check_ours(path: Path, status: os.stat_result) -> None:
    """Raises where a file or folder is another user's, or others may write to it."""
    if os.name != "posix":
        return  # a user's folders are closed to others by other means
    if status.st_uid != os.geteuid():
        raise _foreign(path, "belongs to another user")
    if status.st_mode & OTHERS_WRITE:
        raise _foreign(path, "can be written to by others")


def _foreign(path: Path, why: str) -> OSError:
    return PermissionError(errno.EPERM, f"{path} {why}; {ADVICE}")
