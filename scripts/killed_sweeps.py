#!/usr/bin/env python3
"""Sweeps killed (SIGKILL of the program, not of its workers) at random moments, and resumed.

A moment is a number of stored runs and some time after it, so that a busy machine has them all over the sweep.

After each: every run is stored exactly once, no process is left over, and rows say what those of an undisturbed sweep
do: parameters, outcome, costs and control; the largest relative difference of a number is printed.
Run: .venv/bin/python scripts/killed_sweeps.py [--moments 20] [--seed 0] [--workers 2]
Ends with 1 where a row is missing, twice there, or differs.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

from corners import CORNERS

from nhpocp.objectives.registry import costs_of_motion

ROOT = Path(__file__).parents[1]
PROGRAM = [sys.executable, "-m", "nhpocp"]
MARK = "NHPOCP_KILLED_SWEEP"  # by which the processes of a sweep are known
SAME = 1e-6  # relative: goals are planned in company, whose numbers are equal to rounding
COMPARED = ("variant", "parameters", "outcome", "converged", "seed", *costs_of_motion(), "solved_control")
STUDY = (
    CORNERS
    + """\
    solvers: {compile: never, jacobian: {max_iterations: 30}, nlp: {intervals: 10}}
    output: {pictures: false}
  axes:
    horizon: {linspace: [1, 2, 8]}
    goal.x: {linspace: [0.5, 2, 2]}
    goal.theta: [0, 30 deg]
  solvers: [jacobian, "jacobian:step_rule=euler", nlp]
"""
)


def rows(store: Path) -> list[dict[str, Any]]:
    """Every row, as it is stored."""
    if not store.exists():
        return []
    with closing(sqlite3.connect(store, timeout=30)) as connection:
        connection.row_factory = sqlite3.Row
        try:
            return [dict(row) for row in connection.execute("SELECT * FROM runs ORDER BY run")]
        except sqlite3.OperationalError:  # killed before there was a table
            return []


def numbers(value: Any) -> Iterable[Any]:
    """The leaves of a row's cell, JSON or not."""
    if isinstance(value, str) and value[:1] in ("{", "["):
        value = json.loads(value)
    if isinstance(value, dict):
        value = [part for pair in sorted(value.items()) for part in pair]
    if isinstance(value, list):
        for part in value:
            yield from numbers(part)
    else:
        yield value


def difference(one: Any, other: Any) -> float:
    """The largest relative difference between two cells; infinite where they are not alike at all."""
    pairs, worst = [list(numbers(one)), list(numbers(other))], 0.0
    if len(pairs[0]) != len(pairs[1]):
        return float("inf")
    size = max((abs(x) for x in pairs[0] if isinstance(x, int | float)), default=1.0) or 1.0
    for a, b in zip(*pairs, strict=True):
        if isinstance(a, float) and isinstance(b, float):
            worst = max(worst, abs(a - b) / size)
        elif a != b:
            return float("inf")
    return worst


def differences(found: list[dict[str, Any]], wanted: list[dict[str, Any]]) -> tuple[list[str], float]:
    """What is wrong with the rows of a resumed sweep, in words, and the largest relative difference."""
    numbers_of = [[row["run"] for row in table] for table in (found, wanted)]
    if numbers_of[0] != numbers_of[1]:
        return [f"runs {numbers_of[0]}"], float("inf")
    wrong, worst = [], 0.0
    for row, other in zip(found, wanted, strict=True):
        for name in COMPARED:
            far = difference(row[name], other[name])
            worst = max(worst, far)
            if far > SAME:
                wrong.append(f"run {row['run']}: {name}: {row[name]!r}, not {other[name]!r}"[:200])
    return wrong, worst


def begun(home: Path, workers: int) -> subprocess.Popen[bytes]:
    """A sweep, which goes on with what is stored."""
    call = [*PROGRAM, "sweep", "study.yaml", "-o", ".", "--resume", "--workers", str(workers)]
    return subprocess.Popen(
        call,
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT), MARK: str(home)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def left_over(home: Path) -> list[int]:
    """Living processes of the sweeps in this folder."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={home}".encode() in (place / "environ").read_bytes().split(b"\0"):
                found.append(int(place.name))
        except OSError:
            continue
    return found


def struck(home: Path, least: int, seconds: float, workers: int) -> tuple[int, list[str]]:
    """Kills a sweep so long after it has stored so many runs, and goes on with it.

    How many runs were stored then, and what went wrong.
    """
    process, wrong = begun(home, workers), []
    while len(rows(home / "study.sqlite")) < least and process.poll() is None:
        time.sleep(0.01)
    time.sleep(seconds)
    process.kill()
    process.communicate()
    until = time.monotonic() + 20
    while (left := left_over(home)) and time.monotonic() < until:
        time.sleep(0.05)
    if left:
        wrong.append(f"processes {left} were left over")
    stored = len(rows(home / "study.sqlite"))
    process = begun(home, workers)
    _, words = process.communicate(timeout=600)
    if b"Traceback" in words or process.returncode not in (0, 1):
        wrong.append(f"status {process.returncode}: {words.decode()[-300:]}")
    return stored, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    for name, number in (("moments", 20), ("seed", 0), ("workers", 2)):
        parser.add_argument(f"--{name}", type=int, default=number)
    chosen, bad, farthest = parser.parse_args(), 0, 0.0
    draw = random.Random(chosen.seed)
    with tempfile.TemporaryDirectory(prefix="nhpocp-kill-") as folder:
        homes = [Path(folder) / str(k) for k in range(chosen.moments + 1)]
        for home in homes:
            home.mkdir()
            (home / "study.yaml").write_text(STUDY)
        began = time.monotonic()
        begun(homes[0], chosen.workers).communicate()
        whole, wanted = time.monotonic() - began, rows(homes[0] / "study.sqlite")
        failed = sum(not row["converged"] for row in wanted)
        print(f"undisturbed: {len(wanted)} runs, {failed} of them failed, in {whole:.1f} s", flush=True)
        for home in homes[1:]:
            least = draw.randrange(len(wanted))
            seconds = draw.uniform(0.0, 0.3 if least else whole / 2)
            stored, wrong = struck(home, least, seconds, chosen.workers)
            more, worst = differences(rows(home / "study.sqlite"), wanted)
            farthest, bad = max(farthest, worst), bad + bool(wrong or more)
            words = "; ".join([*wrong, *more[:3]]) or "equal"
            print(f"killed with {stored:3d} runs stored: {words}", flush=True)
    print(f"{chosen.moments} kills, {bad} with faults; largest relative difference {farthest:.1e}")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
