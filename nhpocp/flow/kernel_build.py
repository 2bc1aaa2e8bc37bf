"""Builds one kernel in a folder of its own and moves it to its place whole; a program too, for the background.

Standard library only: as a program it is started by its path, without the package.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

PATIENCE = 300.0  # seconds for the compiler
SOURCE, SUFFIX = "kernel.c", ".so"
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


def build(workshop: Path, key: str, compiler: str) -> str:
    """Compiles the source in the workshop; "" or why it failed.

    The workshop goes, the kernel then stands beside it; its name ends in the digest of its content, which shows damage.
    """
    target, said = workshop / f"kernel{SUFFIX}", "no flags"
    try:
        for flags in FLAGS:
            command = [compiler, *flags, SOURCE, "-o", target.name, "-lm"]
            done = subprocess.run(
                command,
                cwd=workshop,
                capture_output=True,
                timeout=PATIENCE,
                check=False,
                stdin=subprocess.DEVNULL,
            )
            if done.returncode == 0 and target.exists():
                os.replace(target, workshop.parent / f"{key}-{digest(target.read_bytes())}{SUFFIX}")
                return ""
            lines = done.stderr.decode("utf-8", "replace").splitlines()
            said = lines[0] if lines else f"exit status {done.returncode}"
    except (OSError, subprocess.SubprocessError) as error:
        said = str(error)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    return said


if __name__ == "__main__":
    with suppress(AttributeError, OSError):
        os.nice(19)
    build(Path(sys.argv[1]), sys.argv[2], sys.argv[3])
