"""How the benchmarks measure: interleaved rounds, fresh processes, medians; only ratios of one run mean something."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

from nhpocp.machine import compiler, machine

SCRIPTS = Path(__file__).parent
ROUND = 0.01  # seconds at least for one way in one round


def interleaved(
    runs: Mapping[str, Callable[[], object]], rounds: int, least: float = ROUND
) -> dict[str, list[float]]:
    """Seconds of one call, for each way and round; a way is called until ``least`` seconds are full.

    Each is called twice before, untimed: to warm up, and to see how often to call it.
    """
    repeats: dict[str, int] = {}
    times: dict[str, list[float]] = {name: [] for name in runs}
    for name, run in runs.items():
        run()
        began = perf_counter()
        run()
        repeats[name] = max(1, int(least / (perf_counter() - began)))
    for _ in range(rounds):
        for name, run in runs.items():
            began = perf_counter()
            for _ in range(repeats[name]):
                run()
            times[name].append((perf_counter() - began) / repeats[name])
    return times


def medians(times: Mapping[str, Sequence[float]]) -> dict[str, float]:
    return {name: median(found) for name, found in times.items()}


def seconds(runs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median time of one call of each."""
    return medians(interleaved(runs, rounds))


@dataclass(frozen=True)
class Cold:
    """A whole process."""

    seconds: float
    megabytes: float  # peak resident memory


def cold(command: Sequence[str]) -> Cold:
    """Runs a command as a fresh process. Errors: `RuntimeError` where it fails."""
    launcher = [sys.executable, "-I", "-S", str(SCRIPTS / "cold.py"), *command]
    said = json.loads(subprocess.run(launcher, check=True, capture_output=True, text=True).stdout)
    if said["status"] != 0:
        raise RuntimeError(f"{' '.join(command)} ended with status {said['status']}")
    return Cold(said["seconds"], said["megabytes"])


def cold_rounds(commands: Mapping[str, Sequence[str]], rounds: int) -> dict[str, Cold]:
    """Median time and memory of each command, in interleaved rounds; if several, one fills the caches first."""
    found: dict[str, list[Cold]] = {name: [] for name in commands}
    if rounds > 1:
        for command in commands.values():
            cold(command)
    for _ in range(rounds):
        for name, command in commands.items():
            found[name].append(cold(command))
    return {
        name: Cold(median(once.seconds for once in all_), median(once.megabytes for once in all_))
        for name, all_ in found.items()
    }


def circumstances() -> dict[str, Any]:
    """Date, machine, load and versions, as the tables state them."""
    load = [round(share, 2) for share in os.getloadavg()] if hasattr(os, "getloadavg") else None
    return {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "load": load,
        "compiler": compiler(),
        **machine(),
    }
