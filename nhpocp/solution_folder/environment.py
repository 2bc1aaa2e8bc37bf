"""What a result may depend on besides its problem: machine, plugin, compiler."""

from __future__ import annotations

import shutil
import subprocess
from contextlib import suppress
from functools import cache
from typing import Any

from nhpocp.machine import machine

PATIENCE = 5.0  # seconds for a compiler to say its version


def environment(plugin: str | None = None) -> dict[str, Any]:
    """The machine and its versions, the NLP plugin that was used and the C compiler that is at hand."""
    return {**machine(), "plugin": plugin, "compiler": compiler()}


@cache
def compiler() -> str | None:
    """Path and first line of --version of the C compiler, None where none answers."""
    for path in filter(None, map(shutil.which, ("cc", "gcc", "clang"))):
        with suppress(OSError, subprocess.SubprocessError):
            said = subprocess.run(
                [path, "--version"],
                capture_output=True,
                timeout=PATIENCE,
                check=True,
                stdin=subprocess.DEVNULL,
            )
            lines = said.stdout.decode("utf-8", "replace").splitlines()
            return f"{path}: {lines[0].strip()}" if lines else path
    return None
