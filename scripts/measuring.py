"""How the benchmarks measure: interleaved rounds, fresh processes, medians; only ratios of one run mean something."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, TypeVar

from nhpocp.provenance import compiler, machine

Name = TypeVar("Name", bound=Hashable)
SCRIPTS = Path(__file__).parent
ROUND = 0.1  # seconds at least for one way in one round
WARM = 0.5  # seconds of calls before the first round: functions that pay only after a while are made by then


def warm(run: Callable[[], object], rounds: int) -> float:
    """Seconds of the last of some calls, two where there is one round only."""
    first, calls = perf_counter(), 0
    while calls < 2 or (rounds > 1 and perf_counter() - first < WARM):
        began = perf_counter()
        run()
        calls += 1
    return perf_counter() - began


def interleaved(
    runs: Mapping[Name, Callable[[], object]], rounds: int, once: Mapping[Name, float] | None = None
) -> dict[Name, list[float]]:
    """Seconds of one call, for each way and round; if several, a way is called until ``ROUND`` seconds are full.

    once: seconds of a call of each, of which the number of calls is made; those not `warm` yet are called before.
    """
    once = once or {name: warm(run, rounds) for name, run in runs.items()}
    repeats = {name: max(1, int(ROUND / once[name])) if rounds > 1 else 1 for name in runs}
    times: dict[Name, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            began = perf_counter()
            for _ in range(repeats[name]):
                run()
            times[name].append((perf_counter() - began) / repeats[name])
    return times


def medians(times: Mapping[Name, Sequence[float]]) -> dict[Name, float]:
    return {name: median(found) for name, found in times.items()}


@dataclass(frozen=True)
class Cold:
    """A whole process."""

    seconds: float
    megabytes: float  # peak resident memory


def cold(command: Sequence[str]) -> Cold:
    """Runs a command as a fresh process. Errors: `RuntimeError` where it fails."""
    launcher = [sys.executable, "-I", "-S", str(SCRIPTS / "cold.py"), *command]
    # as users run it: Python keeps what it has compiled
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(launcher, check=True, capture_output=True, text=True, env=environment)
    said = json.loads(done.stdout)
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
