"""Builds one kernel in a folder of its own and moves it to its place whole; a program too, for the background.

Standard library only: as a program it is started by its path, without the package.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

PATIENCE = 300.0  # seconds for the compiler
STALE = 600.0  # seconds after which a build counts as given up, whoever was at it
SOURCE, OWNER, SUFFIX = "kernel.c", "owner", ".so"
BUILDING = ".building-"  # what the names of workshops begin with
FAST = (
    "-O3",
    "-march=native",
    "-fopenmp-simd",
    "-fno-tree-slp-vectorize",  # packing the numbers of one sample costs more than it saves
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fPIC",
    "-shared",
)
FLAGS = (  # the first that this compiler takes
    (*FAST, "-mprefer-vector-width=512"),  # where there are such
    FAST,
    ("-O2", "-fPIC", "-shared"),
)


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


def new_workshop(folder: Path, source: str) -> Path:
    """A workshop with a source, whole; errors: `OSError`, and nothing is left."""
    workshop = Path(tempfile.mkdtemp(prefix=BUILDING, dir=folder))
    try:
        (workshop / SOURCE).write_text(source, encoding="utf-8")
    except OSError:
        shutil.rmtree(workshop, ignore_errors=True)
        raise
    return workshop


def claimed(workshop: Path, key: str) -> Path | None:
    """The workshop under the one name that a key has, for this process to build in; None where another is at it.

    A rename brings the owner's name along: no claim is ever half made, on a full disk neither.
    """
    place = workshop.parent / f"{BUILDING}{key}"
    try:
        (workshop / OWNER).write_text(f"{platform.node()} {os.getpid()}", encoding="utf-8")
        workshop.rename(place)
    except OSError:
        shutil.rmtree(workshop, ignore_errors=True)
        return None
    return place


def busy(place: Path) -> bool:
    """Whether somebody builds at a place: not if its owner, a process of this machine, has gone, nor for ever.

    Caches lie on shared disks too, where other machines' processes cannot be seen and clocks differ.
    """
    try:
        age = time.time() - place.stat().st_mtime
        machine, _, process = (place / OWNER).read_text(encoding="utf-8").rpartition(" ")
        if abs(age) > STALE:
            return False
        if machine == platform.node() and os.name == "posix":  # elsewhere asking would end it
            os.kill(int(process), 0)
    except PermissionError:
        return True  # another user's
    except (OSError, ValueError, OverflowError):
        return False
    return True


def build(workshop: Path, key: str, compiler: Sequence[str]) -> str:
    """Compiles the source in the workshop; "" or why it failed.

    The workshop goes, the kernel then stands beside it; its name ends in the digest of its content, which shows damage.
    """
    target, said = workshop / f"kernel{SUFFIX}", "no flags"
    try:
        for flags in FLAGS:
            status, words = _run([*compiler, *flags, SOURCE, "-o", target.name, "-lm"], workshop)
            if status == 0 and target.exists():
                target.chmod(0o700)  # whatever the umask: a kernel that others may write to is not loaded
                os.replace(target, workshop.parent / f"{key}-{digest(target.read_bytes())}{SUFFIX}")
                return ""
            said = words.splitlines()[0] if words else f"exit status {status}"
    except (OSError, subprocess.SubprocessError) as error:
        said = str(error)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    return said


def _run(command: Sequence[str], folder: Path) -> tuple[int, str]:
    """Exit status and errors of a command, in a session of its own: Ctrl-C is not the compiler's to answer."""
    with subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            _, errors = process.communicate(timeout=PATIENCE)
        except BaseException:  # the compiler's own children too
            if os.name == "posix":
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise
    return process.returncode, errors.decode("utf-8", "replace").strip()


if __name__ == "__main__":
    with suppress(AttributeError, OSError):
        os.nice(19)
    at_work = claimed(Path(sys.argv[1]), sys.argv[2])
    if at_work:
        build(at_work, sys.argv[2], sys.argv[3:])
