"""The machine that a result was made on: versions, processor, memory."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from nhpocp.errors import TooLargeError

ROOM = 0.8  # of the free memory: what one piece of work may take
PATIENCE = 5.0  # seconds for a compiler to say its version
PACKAGES = ("nhpocp", "casadi", "numpy", "scipy")


def machine() -> dict[str, Any]:
    """Versions and machine, as the report states them."""
    return {
        **_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": _said_of_processor("model name") or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
    }


@cache
def _versions() -> dict[str, str]:
    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


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


def c_compiler() -> tuple[str, ...]:
    """The command of the C compiler: what CC says, else the system's; empty where there is none that answers."""
    return _compiler(os.environ.get("CC"))[0]


def compiler() -> str | None:
    """Command and first line of --version of the C compiler, None where none answers."""
    command, version = _compiler(os.environ.get("CC"))
    said = " ".join(command)
    return f"{said}: {version}" if said and version else said or None


def without_compiler() -> str:
    """Why there is no C compiler, in words."""
    named = os.environ.get("CC")
    return (
        f"no C compiler was found (CC is {named!r})" if named else "no C compiler was found (cc, gcc, clang)"
    )


@cache
def _compiler(named: str | None) -> tuple[tuple[str, ...], str]:
    for command in (_words(named),) if named else (("cc",), ("gcc",), ("clang",)):
        path = shutil.which(command[0]) if command else None
        if path is None:
            continue
        command = (path, *command[1:])
        with suppress(OSError, subprocess.SubprocessError):
            said = subprocess.run(
                [*command, "--version"],
                capture_output=True,
                timeout=PATIENCE,
                check=True,
                stdin=subprocess.DEVNULL,
            )
            lines = said.stdout.decode("utf-8", "replace").splitlines()
            return command, lines[0].strip() if lines else ""
    return (), ""


def _words(named: str) -> tuple[str, ...]:
    """A command as the shell reads it, `ccache gcc` or `gcc -m64`; a path with blanks is one word if it is there."""
    if shutil.which(named):
        return (named,)
    with suppress(ValueError):  # quotes that do not end
        return tuple(shlex.split(named))
    return ()


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


def free_memory() -> float | None:
    """Bytes that this process may still take, where the operating system (Linux) says so."""
    limits = []
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        limits += [1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable")]
    with suppress(OSError, ValueError):  # a container's own limit
        group = Path("/sys/fs/cgroup")
        limit, used = ((group / f"memory.{name}").read_text(encoding="ascii") for name in ("max", "current"))
        limits.append(float(int(limit) - int(used)))
    return min(limits, default=None)


def afford(size: float, what: str) -> None:
    """Errors: `TooLargeError` where ``what`` takes more bytes than there is room for."""
    free = free_memory()
    if free is not None and size > ROOM * free:
        raise TooLargeError(
            f"{what} would take about {size / 1e9:.2g} GB of memory, and {free / 1e9:.2g} GB are free"
        )


def environment(plugin: str | None = None) -> dict[str, Any]:
    """What a result may depend on besides its problem: the machine and its versions, the NLP plugin, the compiler."""
    return {**machine(), "plugin": plugin, "compiler": compiler()}
