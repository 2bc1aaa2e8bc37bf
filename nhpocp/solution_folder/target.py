"""Where a solution folder may be written, and what may be deleted for it: files that nhpocp wrote itself, no others."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from nhpocp.errors import InvalidProblemError

DATA = ("problem.yaml", "solution.json", "trajectory.csv", "iterations.csv", "arrays.npz", "solver.log")
PICTURES = ("controls", "relative_pose", "convergence", "margins", "robot", "failure")
ANIMATIONS = ("animation.html", "animation.gif", "animation.mp4")
ANALYSIS = ("analysis.json", "map.npz")  # of `nhpocp analyze`, and its pictures
ANALYSIS_PICTURES = ("singularity_map", "along_guess", "agility")
COMPARISON = ("report.html", "comparison.csv", "comparison.json")  # beside the folders of the problems
_DRAWN = (*PICTURES, *ANALYSIS_PICTURES)
OWN = {
    *DATA,
    *ANIMATIONS,
    *ANALYSIS,
    *(f"{name}.{kind}" for name in _DRAWN for kind in ("png", "svg", "pdf")),
}
SCRATCH = ".nhpocp-"  # prefix of the folders beside a target, while it is written


def folder_name(name: str) -> str:
    """A problem's or a variant's name as one folder name: `nlp:control=basis` is nlp-control-basis."""
    safe = "".join(character if character.isalnum() or character in "-_." else "-" for character in name)
    return safe if safe.strip(".") and safe not in COMPARISON else f"{safe.strip('.') or 'problem'}-"


def check_target(folder: Path) -> None:
    """Tries whether a solution folder can be written here, and leaves everything as it was.

    Errors: `InvalidProblemError` for a folder that holds anything that nhpocp did not write, or that cannot be created
    or replaced.
    """
    try:
        target = real_target(folder)
        require_replaceable(target, folder)
        _try_to_write(target)
    except OSError as error:
        raise unwritable(folder, error) from error


def unwritable(folder: Path, error: OSError) -> InvalidProblemError:
    """An OSError of writing in our words."""
    return InvalidProblemError(f"cannot write here: {error.strerror or error}", file=str(folder))


def real_target(folder: Path) -> Path:
    """The folder behind symbolic links: a link is kept, what it names is replaced."""
    try:
        return folder.resolve()
    except RuntimeError as error:  # Python < 3.13 answers so to links in a circle
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from error


def require_replaceable(target: Path, named: Path) -> None:
    """Raises `InvalidProblemError`, speaking of ``named``, unless ``target`` is missing, empty or all ours."""
    if not target.exists():
        return
    if not target.is_dir():
        raise InvalidProblemError("this is a file; choose another folder with -o", file=str(named))
    foreign = sorted(entry.name for entry in os.scandir(target) if not _ours(entry))
    if foreign:
        raise InvalidProblemError(
            f"{foreign[0]!r} in this folder was not written by nhpocp, so the folder is left alone; "
            "choose another with -o",
            file=str(named),
        )
    if any(target.iterdir()) and not (is_solution_folder(target) or _says_so(target / "analysis.json")):
        raise InvalidProblemError(
            "this folder was not written by nhpocp and is left alone; choose another with -o", file=str(named)
        )
    if Path.cwd().is_relative_to(target):
        raise InvalidProblemError(
            "this is the current folder, which cannot be replaced from inside; choose another with -o",
            file=str(named),
        )


def _ours(entry: os.DirEntry[str]) -> bool:
    return entry.name in OWN and entry.is_file(follow_symlinks=False)


def is_solution_folder(folder: Path) -> bool:
    """Whether a solution of ours lies here; a problem.yaml alone may be the user's own."""
    return _says_so(folder / "solution.json")


def _says_so(file: Path) -> bool:
    """Whether a file is JSON that nhpocp wrote."""
    try:
        head = file.read_text(encoding="utf-8")[:200]
    except (OSError, UnicodeDecodeError):
        return False
    return '"schema_version"' in head


def write_whole(target: Path, write: Callable[[Path], None]) -> None:
    """Has a folder written beside its place and moved there once complete, or not at all.

    Errors: `OSError`, and `InvalidProblemError` where something else has come to stand there.
    """
    home = real_target(target)
    scratch = scratch_folder(home)
    try:
        write(scratch)
        scratch.chmod(0o777 & ~_umask())
        replace(scratch, home, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def scratch_folder(target: Path) -> Path:
    """A new empty folder beside a target, from where a rename moves it into place."""
    target.parent.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=SCRATCH, dir=target.parent))


def _try_to_write(target: Path) -> None:
    """Creates, renames and removes: permissions, mount points and sticky folders have too many rules to predict."""
    created = [parent for parent in target.parents if not parent.exists()]  # the deepest first
    try:
        scratch = scratch_folder(target)
        try:
            if target.exists():
                target.rename(scratch / "old")
                (scratch / "old").rename(target)
            else:
                scratch.rename(target)
                target.rename(scratch)
        finally:
            scratch.rmdir()
    finally:
        for parent in created:
            with suppress(OSError):
                parent.rmdir()


def replace(scratch: Path, target: Path, named: Path) -> None:
    """Puts a complete folder in place of what is there."""
    if not target.exists():
        scratch.rename(target)
        return
    require_replaceable(target, named)  # once more: a solve takes its time
    aside = scratch_folder(target)
    old = aside / "old"
    try:
        target.rename(old)
        try:
            scratch.rename(target)
        except OSError:
            old.rename(target)
            raise
        _remove_own(old)
    finally:
        with suppress(OSError):  # whatever is still inside stays
            aside.rmdir()


def _remove_own(folder: Path) -> None:
    """Deletes our files by name; anything else stays, and its folder with it."""
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            if _ours(entry):
                Path(entry.path).unlink()
        folder.rmdir()
