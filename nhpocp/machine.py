"""The machine that a result was made on: versions, processor, memory."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PATIENCE = 5.0  # seconds for a compiler to say its version
PACKAGES = ("nhpocp", "casadi", "numpy", "scipy")


def machine() -> dict[str, Any]:
    """Versions and machine, as the report states them."""
    packages = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            packages[name] = version(name)
    return {
        **packages,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": _said_of_processor("model name") or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
    }


def processor() -> str:
    """What a program built for this very processor depends on: its kind, name and abilities."""
    abilities = _said_of_processor("flags") or _said_of_processor("Features")
    return " ".join([platform.system(), platform.machine(), _said_of_processor("model name"), abilities])


@cache
def _said_of_processor(what: str) -> str:
    """An entry of the first processor in Linux's list, "" elsewhere."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return next((line.partition(":")[2].strip() for line in lines if line.startswith(what)), "")
    return ""


def c_compiler() -> str | None:
    """Path of the C compiler: what CC names, else the system's; None where there is none that answers."""
    return _compiler(os.environ.get("CC"))[0]


def compiler() -> str | None:
    """Path and first line of --version of the C compiler, None where none answers."""
    path, version = _compiler(os.environ.get("CC"))
    return f"{path}: {version}" if path and version else path


@cache
def _compiler(named: str | None) -> tuple[str | None, str]:
    for path in filter(None, map(shutil.which, (named,) if named else ("cc", "gcc", "clang"))):
        with suppress(OSError, subprocess.SubprocessError):
            said = subprocess.run(
                [path, "--version"],
                capture_output=True,
                timeout=PATIENCE,
                check=True,
                stdin=subprocess.DEVNULL,
            )
            lines = said.stdout.decode("utf-8", "replace").splitlines()
            return path, lines[0].strip() if lines else ""
    return None, ""


def reset_peak_memory() -> bool:
    """Starts the process's peak anew, where the operating system (Linux) can."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return False
    return True


def peak_memory() -> float | None:
    """Peak resident memory of the process since the last reset [MB]."""
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(round(int(line.split()[1]) / 1024, 1) for line in lines if line.startswith("VmHWM"))
    return None


def environment(plugin: str | None = None) -> dict[str, Any]:
    """What a result may depend on besides its problem: the machine and its versions, the NLP plugin, the compiler."""
    return {**machine(), "plugin": plugin, "compiler": compiler()}
