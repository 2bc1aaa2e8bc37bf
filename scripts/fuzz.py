#!/usr/bin/env python3
"""Seeded nonsense for the command line: problems, settings, studies, solution folders and stores, spoilt by chance.

Each call must end with exit status 0, 1 or 2 (3 where an optional part is missing), without an exception, within 10 s
of the processor and 1 GB, and write nothing but its output; with --json, standard output is one document. Prints what
was broken, with the call and the seed, then how many inputs of each kind were tried and broke something.
Run: .venv/bin/python scripts/fuzz.py [--inputs 2000] [--kinds KIND …] [--seed 0]
Ends with 1 where anything was broken.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from unittest import mock

from corners import CORNERS
from spoiling import (
    NUMBERS,
    ODD,
    spoil_cells,
    spoil_database_bytes,
    spoil_journal,
    spoil_tables,
    spoilt_bytes,
    spoilt_data,
    spoilt_yaml,
)

from nhpocp.cli.entry import status
from nhpocp.errors import InvalidProblemError
from nhpocp.machine.export.registry import FORMATS
from nhpocp.provenance import peak_memory, reset_peak_memory
from nhpocp.study.store import COLUMNS
from nhpocp.study.study import read_study

PROBLEMS = Path(__file__).parents[1] / "problems"
LONGEST = 10.0  # seconds of the processor of one call; twelve times as many of the clock
MOST = 1024.0  # MB
KEYS = [
    *("horizon", "error_length", "length_scale", "samples", "goal", "start", "via", "constraints", "name"),
    *("objective", "control.harmonics", "control.basis", "control.initial", "goal.x", "start.heading"),
    *("system.model", "output", "solvers.jacobian.tolerance", "solvers.jacobian.gamma"),
    *("solvers.jacobian.step_rule", "solvers.nlp.tolerance"),
]
FLAGS = ["--solver", "--set", "--json", "--trace", "-o", "--debugg", "-h", "--", "", "\udcff"]
OUTPUTS = {"out", "results", "report.html", "comparison.tex", "study.sqlite"}
OUTPUTS |= {f"study.sqlite-{name}" for name in ("wal", "shm", "journal")}
STUDY = (
    CORNERS
    + """\
    horizon: {min: 0.5, max: 3, initial: 1}
    solvers: {compile: never, jacobian: {max_iterations: 40}}
    output: {pictures: false, samples: 11}
  axes:
    goal.x: {linspace: [0.5, 2, 3]}
    goal.theta: [0, 30 deg]
  solvers: [jacobian]
"""
)
RULES = """\
nhpocp: 1
study:
  problem: unicycle.yaml
  axes:
    goal.x: {range: [0.5, 2, 0.5]}
    goal.y: {uniform: [0.5, 2], samples: 3, sampling: sobol, seed: 2}
    solvers.jacobian.gamma: {logspace: [0.01, 1, 3]}
    horizon: {loguniform: [0.5, 2]}
  solvers: [jacobian, "nlp:initial=jacobian"]
  samples: 4
  sampling: latin_hypercube
  seed: 1
  order: nearest
"""
Make = Callable[[random.Random, Path, Path], list[str]]


class Hang(BaseException):
    """A call that took too long."""


@dataclass(frozen=True)
class Broken:
    """A call and what it broke."""

    call: list[str]
    what: str

    def __str__(self) -> str:
        return f"{self.what}: nhpocp {' '.join(map(repr, self.call))}"


def overrides(draw: random.Random, most: int) -> list[str]:
    """Some `--set KEY=VALUE`."""
    chosen = [(draw.choice(KEYS), draw.choice(ODD)) for _ in range(draw.randint(0, most))]
    return [part for key, value in chosen for part in ("--set", f"{key}={value}")]


# --- kinds of inputs: what is spoilt, and the call that meets it. `stored` holds what was made before -----------------


def problem_bytes(draw: random.Random, home: Path, stored: Path) -> list[str]:
    text = draw.choice(sorted(PROBLEMS.glob("*.yaml"))).read_bytes()
    (home / "problem.yaml").write_bytes(spoilt_bytes(draw, text))
    call = ["check", "problem.yaml", *overrides(draw, 1)]
    if draw.random() < 0.1:
        call.insert(draw.randrange(len(call) + 1), draw.choice(FLAGS))
    return call


def problem_structure(draw: random.Random, home: Path, stored: Path) -> list[str]:
    text = draw.choice(sorted(PROBLEMS.glob("*.yaml"))).read_bytes()
    (home / "problem.yaml").write_bytes(spoilt_yaml(draw, text))
    return ["check", "problem.yaml"]


def settings(draw: random.Random, home: Path, stored: Path) -> list[str]:
    shutil.copy(draw.choice(sorted(PROBLEMS.glob("*.yaml"))), home / "problem.yaml")
    return ["check", "problem.yaml", *(overrides(draw, 3) or ["--set", draw.choice(KEYS)])]


def solves(draw: random.Random, home: Path, stored: Path) -> list[str]:
    file = home / "problem.yaml"
    text = (PROBLEMS / draw.choice(["unicycle.yaml", "heisenberg.yaml", "paper.yaml"])).read_bytes()
    file.write_bytes(spoilt_yaml(draw, text) if draw.random() < 0.3 else text)
    # 1000 iterations of IPOPT towards 1e200 are no hang, and take a minute
    bounds = [f"solvers.{name}.max_iterations=100" for name in ("jacobian", "nlp")]
    changes = [part for word in ["output.pictures=false", *bounds] for part in ("--set", word)]
    changes += overrides(draw, 1)
    key = draw.choice(
        ["horizon", "error_length", "length_scale", "solvers.jacobian.tolerance", "goal.x", "start.y"]
    )
    changes += ["--set", f"{key}={draw.choice(NUMBERS)}"]
    return ["solve", "problem.yaml", "--solver", draw.choice(["jacobian", "nlp"]), *changes, "-o", "out"]


def solution_folders(draw: random.Random, home: Path, stored: Path) -> list[str]:
    shutil.copytree(stored / "solution", home / "solution")
    file = draw.choice(sorted((home / "solution").iterdir()))
    if file.suffix == ".json" and draw.random() < 0.6:
        file.write_text(json.dumps(spoilt_data(draw, json.loads(file.read_text(encoding="utf-8")))))
    elif draw.random() < 0.1:
        file.unlink()
    else:
        file.write_bytes(spoilt_bytes(draw, file.read_bytes()))
    exported = ["export", "solution", "--format", draw.choice(list(FORMATS)), "--rate", "20", "-o", "out"]
    calls = [["verify", "solution"]] * 3 + [["compare", "--from", "solution", "-o", "out"], exported]
    return draw.choice(calls)


def study_bytes(draw: random.Random, home: Path, stored: Path) -> list[str]:
    text = draw.choice([STUDY, RULES]).encode()
    return _study_call(draw, home, spoilt_bytes(draw, text))


def study_structure(draw: random.Random, home: Path, stored: Path) -> list[str]:
    text = draw.choice([STUDY, RULES]).encode()
    return _study_call(draw, home, spoilt_yaml(draw, text))


def _study_call(draw: random.Random, home: Path, text: bytes) -> list[str]:
    """Swept now and then, where that is a matter of a few runs."""
    (home / "study.yaml").write_bytes(text)
    problem = (PROBLEMS / "unicycle.yaml").read_bytes()
    (home / "unicycle.yaml").write_bytes(spoilt_yaml(draw, problem) if draw.random() < 0.1 else problem)
    if draw.random() < 0.15:
        with contextlib.suppress(InvalidProblemError):
            if len(read_study(home / "study.yaml")) <= 6:
                return ["sweep", "study.yaml", "-o", "out"]
    return ["check", "study.yaml"]


def store_bytes(draw: random.Random, home: Path, stored: Path) -> list[str]:
    return _store_call(draw, home, stored, spoil_database_bytes)


def store_tables(draw: random.Random, home: Path, stored: Path) -> list[str]:
    return _store_call(draw, home, stored, spoil_tables)


def store_cells(draw: random.Random, home: Path, stored: Path) -> list[str]:
    return _store_call(draw, home, stored, lambda draw, file: spoil_cells(draw, file, COLUMNS))


def store_journal(draw: random.Random, home: Path, stored: Path) -> list[str]:
    return _store_call(draw, home, stored, spoil_journal)


def _store_call(
    draw: random.Random, home: Path, stored: Path, spoil: Callable[[random.Random, Path], None]
) -> list[str]:
    order = draw.choice(["given", "nearest"])
    file = home / "study.sqlite"
    shutil.copy(stored / f"{order}.sqlite", file)
    shutil.copy(stored / f"{order}.yaml", home / "study.yaml")
    spoil(draw, file)
    run = str(draw.randint(1, 7))
    return draw.choice(
        [
            ["export", "study.sqlite", "-o", "out"],
            ["export", "study.sqlite", "--format", "parquet", "-o", "out"],
            ["sweep", "study.yaml", "-o", ".", "--resume"],
            ["solve", "--from", "study.sqlite", "--run", run, "-o", "out"],
            ["check", "study.sqlite"],
        ]
    )


KINDS: dict[str, tuple[Make, int]] = {  # with their shares
    "problem_bytes": (problem_bytes, 20),
    "problem_structure": (problem_structure, 20),
    "settings": (settings, 12),
    "solves": (solves, 2),
    "solution_folders": (solution_folders, 4),
    "study_bytes": (study_bytes, 12),
    "study_structure": (study_structure, 12),
    "store_bytes": (store_bytes, 6),
    "store_tables": (store_tables, 6),
    "store_cells": (store_cells, 6),
    "store_journal": (store_journal, 3),
}


# --- calls ------------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """`Hang` after the longest time; the end of the process where that is not heard."""

    def end(number: int, frame: FrameType | None) -> None:
        raise Hang

    timers = {
        signal.SIGALRM: (signal.ITIMER_REAL, 12 * LONGEST),
        signal.SIGPROF: (signal.ITIMER_PROF, LONGEST),
    }
    before = {number: signal.signal(number, end) for number in timers}
    for timer, seconds in timers.values():
        signal.setitimer(timer, seconds)
    faulthandler.dump_traceback_later(20 * LONGEST, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        for number, (timer, _) in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])
        faulthandler.cancel_dump_traceback_later()


def broken(call: list[str], top: Path) -> str:
    """What a call broke, "" for nothing; run in ``top``/inside."""
    inputs = {path.name for path in (top / "inside").iterdir()}
    out, errors, began = io.StringIO(), io.StringIO(), time.monotonic()
    measured = reset_peak_memory()
    try:
        with bounded(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            ended = status(call)
    except Hang:
        return f"no end within {time.monotonic() - began:.0f} s"
    except BaseException as error:  # noqa: BLE001 - the very thing that is looked for
        return f"{type(error).__name__}: {error}"
    if ended not in (0, 1, 2, 3) or (ended == 3 and "pip install" not in errors.getvalue()):
        return f"exit status {ended}"
    if "Traceback" in errors.getvalue():
        if Hang.__name__ in errors.getvalue():  # heard inside a callback of CasADi, which went on
            return f"no end within {LONGEST} s"
        return "a traceback on standard error"
    if measured and (peak_memory() or 0.0) > MOST:
        return f"{peak_memory():.0f} MB"
    made = {path.name for path in (top / "inside").iterdir()} - inputs
    if [path.name for path in top.iterdir()] != ["inside"] or not made <= OUTPUTS:
        return f"files beside its output: {sorted(made - OUTPUTS)}"
    if call[-1] == "--json" and call[-2] not in FLAGS and not {"-h", "--"} & set(call):
        try:
            json.loads(out.getvalue())
        except ValueError:
            return f"no JSON document: {out.getvalue()[:80]!r}"
    return ""


def fuzzed(make: Make, count: int, seed: int, stored: Path, first: int = 0) -> Iterator[Broken]:
    """What a number of calls break; each is drawn from its own seed."""
    here = Path.cwd()
    for k in range(first, first + count):
        with tempfile.TemporaryDirectory(prefix="nhpocp-fuzz-") as name:
            inside = Path(name) / "inside"
            inside.mkdir()
            os.chdir(inside)
            try:
                call = [*make(random.Random(f"{seed} {k}"), inside, stored), "--json"]
                what = broken(call, Path(name))
            finally:
                os.chdir(here)
        if what:
            yield Broken(call, f"{make.__name__}, seed {seed}, call {k}: {what}")


@contextlib.contextmanager
def prepared() -> Iterator[Path]:
    """A folder with a stored solution and two studies' stores; within, sweeps work in this process."""
    here = mock.patch("nhpocp.study.sweep.processes", side_effect=lambda *_: ThreadPoolExecutor(1))
    with tempfile.TemporaryDirectory(prefix="nhpocp-fuzz-") as name, here:
        stored = Path(name)
        file, words = str(PROBLEMS / "unicycle.yaml"), io.StringIO()
        with contextlib.redirect_stdout(words), contextlib.redirect_stderr(words):
            given = ["--trace", "--set", "output.pictures=false", "-o", str(stored / "solution")]
            assert status(["solve", file, *given]) == 0, words.getvalue()
            for order in ("given", "nearest"):
                study = stored / f"{order}.yaml"
                study.write_text(f"{STUDY}  order: {order}\n")
                assert status(["sweep", str(study), "-o", str(stored)]) == 0, words.getvalue()
                (stored / "study.sqlite").rename(stored / f"{order}.sqlite")
        yield stored


def fuzz(counts: Mapping[str, int], seed: int, first: int = 0) -> Iterator[Broken]:
    """So many calls of each kind."""
    with prepared() as stored:
        for kind, count in counts.items():
            yield from fuzzed(KINDS[kind][0], count, seed, stored, first)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="of a kind: the number of the first call")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # as the program does
    shares = {kind: KINDS[kind][1] for kind in chosen.kinds}
    counts = {k: -(-chosen.inputs * share // sum(shares.values())) for k, share in shares.items()}
    found: Counter[str] = Counter()
    for one in fuzz(counts, chosen.seed, chosen.first):
        print(one, flush=True)
        found[str(one).partition(",")[0]] += 1
    print(", ".join(f"{kind} {count}" for kind, count in counts.items()))
    print(f"{sum(counts.values())} inputs, {found.total()} broken {dict(found) or ''}".rstrip())
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
