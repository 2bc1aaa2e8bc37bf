"""The machine that a result was made on: versions, processor, memory."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("nhpocp", "casadi", "numpy", "scipy")


def machine() -> dict[str, Any]:
    """Versions and machine, as the report states them."""
    packages = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            packages[name] = version(name)
    cpu = platform.processor()
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        cpu = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), cpu)
    return {
        **packages,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": cpu or platform.machine(),
        "cores": os.cpu_count(),
    }


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
