"""Where a solution folder may be written, and what may be deleted for it: files that nhpocp wrote itself, no others."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.registry import FORMATS, MACHINES
from nhpocp.problem_file.document import open_file
from nhpocp.whole import Bench, bench, exchange, sweep

DATA = (
    "problem.yaml",
    "solution.json",
    "trajectory.csv",
    "columns.csv",
    "iterations.csv",
    "arrays.npz",
    "solver.log",
)
PICTURES = ("controls", "relative_pose", "convergence", "margins", "distances", "robot", "trees", "failure")
KINDS = ("png", "svg", "pdf")  # of picture files
ANIMATIONS = ("animation.html", "animation.gif", "animation.mp4")
MOTIONS = tuple(each.file_name for each in (FORMATS | MACHINES).values())  # of `nhpocp export`
ANALYSIS = ("analysis.json", "map.npz")  # of `nhpocp analyze`, and its pictures
ANALYSIS_PICTURES = ("singularity_map", "along_guess", "agility")
SIMULATION = (
    "simulation"  # of `nhpocp simulate`: a folder inside that of the solution, of these files and a picture
)
SIMULATION_FILES = ("simulation.json", "simulation.csv", "simulation.npz")
CALIBRATION = ("calibration.json", "residuals.csv", "fitted.yaml")  # of `nhpocp calibrate`, and its picture
CALIBRATION_PICTURE = "residuals"
COMPARISON = (
    "report.html",
    "comparison.csv",
    "comparison.tex",
    "comparison.json",
)  # beside the folders of the problems
# what stands near the beginning or the end of such a file of ours, the first version's included; a table's is its head
SIGNED = {
    "report.html": (b'content="nhpocp compare"', b'content="nhpocp sweep"', b"dl.facts { display: grid;"),
    "comparison.csv": (b"name,solver,variant,",),
    "comparison.tex": (b"% nhpocp compare", b"% nhpocp sweep"),
    "comparison.json": (b'"schema_version"',),
    "animation.html": (b"nhpocp animate",),
    "steer.json": (b'"schema_version"',),  # of `nhpocp steer`, as its table
    "steer.csv": (b"cycle,", b"machine,outcome,"),
}
_DRAWN = (*PICTURES, *ANALYSIS_PICTURES, SIMULATION, CALIBRATION_PICTURE)
OWN = {
    *DATA,
    *ANIMATIONS,
    *MOTIONS,
    *ANALYSIS,
    *SIMULATION_FILES,
    *CALIBRATION,
    *(f"{name}.{kind}" for name in _DRAWN for kind in KINDS),
}


SIGNATURES = (
    "solution.json",
    "analysis.json",
    "simulation.json",
    "calibration.json",
)  # one of which is in every folder of ours


def folder_name(name: str) -> str:
    """A problem's or a variant's name as one folder name: `nlp:control=basis` is nlp-control-basis."""
    safe = "".join(character if character.isalnum() or character in "-_." else "-" for character in name)
    return safe if safe.strip(".") and safe not in COMPARISON else f"{safe.strip('.') or 'problem'}-"


def check_target(folder: Path) -> None:
    """Whether a solution folder can be written here: tried beside it, while what stands there is only looked at.

    What killed runs left is cleared up first, and a folder that one had moved away goes back.
    Errors: `InvalidProblemError` for a folder that holds anything that nhpocp did not write, or that cannot be created
    or replaced.
    """
    try:
        target = real_target(folder)
        clear_up(target)
        require_replaceable(target, folder)
        _require_movable(target)
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
    if any(target.iterdir()) and not any(_says_so(target / name) for name in SIGNATURES):
        raise InvalidProblemError(
            "this folder was not written by nhpocp and is left alone; choose another with -o", file=str(named)
        )
    if Path.cwd().is_relative_to(target):
        raise InvalidProblemError(
            "this is the current folder, which cannot be replaced from inside; choose another with -o",
            file=str(named),
        )


def _ours(entry: os.DirEntry[str]) -> bool:
    if entry.name == SIMULATION and entry.is_dir(follow_symlinks=False):
        return all(_ours(inner) and inner.is_file(follow_symlinks=False) for inner in os.scandir(entry))
    return entry.name in OWN and entry.is_file(follow_symlinks=False)


def is_solution_folder(folder: Path) -> bool:
    """Whether a solution of ours lies here; a problem.yaml alone may be the user's own."""
    return _says_so(folder / "solution.json")


def _says_so(file: Path) -> bool:
    """Whether a file is JSON that nhpocp wrote."""
    try:
        with open_file(file) as stream:
            return b'"schema_version"' in stream.read(200)
    except OSError:
        return False


def clear_up(target: Path) -> None:
    """What killed runs left beside a folder and within it."""
    for place in (target.parent, target):
        sweep(place, remove_own)


def require_own(file: Path) -> None:
    """Errors: `InvalidProblemError` where something other than such a file of ours stands here (`SIGNED`)."""
    if file.is_dir():
        raise InvalidProblemError("a folder stands where this file goes", file=str(file))
    try:
        with open_file(file) as stream:
            head, size = stream.read(4096), os.fstat(stream.fileno()).st_size
            stream.seek(max(0, size - 4096))
            ends = head + stream.read(4096)
    except FileNotFoundError:
        return
    except OSError as error:
        raise unwritable(file, error) from error
    if ends and not any(words in ends for words in SIGNED[file.name]):
        raise InvalidProblemError(
            "this file was not written by nhpocp and is left alone; choose another folder with -o",
            file=str(file),
        )


def write_whole(target: Path, write: Callable[[Path], None]) -> None:
    """Has a folder written beside its place and moved there once complete, or not at all.

    Errors: `OSError`, and `InvalidProblemError` where something else has come to stand there.
    """
    home = real_target(target)
    with bench(home.parent) as made:
        scratch = made.new / home.name
        scratch.mkdir()
        write(scratch)
        _replace(made, home, target)


def _replace(made: Bench, home: Path, named: Path) -> None:
    """Puts the complete folder of a bench in place of what is there."""
    scratch, old = made.new / home.name, made.old / home.name
    if not home.exists():
        scratch.rename(home)
        return
    require_replaceable(home, named)  # once more: a solve takes its time
    scratch.rename(old)  # after the exchange the other folder stands there, which others may have written to
    exchanged = False
    try:
        exchanged = exchange(old, home)
    finally:
        if not exchanged:
            old.rename(scratch)
    if exchanged:
        _check_left(old, home, named)
    else:
        _move_in(scratch, home, old)
    remove_own(old)


def _check_left(old: Path, home: Path, named: Path) -> None:
    """Puts the old folder back if somebody has written to it at the last moment."""
    try:
        require_replaceable(old, named)
    except InvalidProblemError:
        exchange(old, home)
        remove_own(old)
        raise


def _move_in(scratch: Path, home: Path, old: Path) -> None:
    """Where two folders cannot be exchanged; `sweep` brings back what a process that is killed in between leaves."""
    home.rename(old)
    try:
        scratch.rename(home)
    except OSError:
        old.rename(home)
        raise


def _require_movable(target: Path) -> None:
    """Raises what a rename would raise, by the rules that can be read: it is not tried with what stands there."""
    if not target.exists():
        return
    if os.path.ismount(target):
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
    if not os.access(target, os.W_OK | os.X_OK):  # to move it, and to remove what it holds
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))
    around = target.parent.stat()
    sticky = os.name == "posix" and around.st_mode & stat.S_ISVTX
    if sticky and os.geteuid() not in (0, around.st_uid, target.stat().st_uid):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))


def _try_to_write(target: Path) -> None:
    """Creates, renames and removes a folder of this name: names, permissions and quotas have many rules."""
    created = [parent for parent in target.parents if not parent.exists()]  # the deepest first
    try:
        with bench(target.parent) as made:
            trial = made.new / target.name
            trial.mkdir()
            trial.rename(made.new / "trial")
            (made.new / "trial").rmdir()
    finally:
        for parent in created:
            with suppress(OSError):
                parent.rmdir()


def remove_own(folder: Path) -> None:
    """Deletes our files by name; anything else stays, and its folder with it."""
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            if _ours(entry) and entry.is_dir(follow_symlinks=False):
                remove_own(Path(entry.path))
            elif _ours(entry):
                Path(entry.path).unlink()
        folder.rmdir()
