#!/usr/bin/env python3
"""Seeded nonsense for the command line: problem files spoilt by bytes and by structure, options, tampered folders.

Each call must end with exit status 0, 1 or 2, without an exception, within 20 s and 1 GB, and write nothing outside its
folder; with --json, standard output is one document. Prints what was broken, with the call and the seed.
Run: .venv/bin/python scripts/fuzz.py [--check 2000] [--solve 100] [--verify 70] [--seed 0]
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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from ruamel.yaml import YAML

from nhpocp.cli.entry import status
from nhpocp.provenance import peak_memory, reset_peak_memory

PROBLEMS = Path(__file__).parents[1] / "problems"
LONGEST = 20.0  # seconds of one call
MOST = 1024.0  # MB
NUMBERS = [0, -1, 1, 3, 1e-300, 1e-160, 1e-20, 1e20, 1e155, 1e200, -1e308, float("inf"), float("nan"), 2**70]
WORDS = [
    "",
    "~",
    "true",
    "auto",
    "-1 deg",
    "pi/0",
    "1e999",
    "../../out",
    "\u202e",
    "\x1b[2J",
    "=1+1",
    "[",
    "{a: 1}",
]
ODD: list[Any] = [*NUMBERS, *WORDS, None, True, [], {}, [[]], [1, "x"], {"": 0}]
KEYS = [
    *(
        "horizon",
        "error_length",
        "length_scale",
        "samples",
        "goal",
        "start",
        "via",
        "constraints",
        "name",
        "objective",
    ),
    *(
        "control.harmonics",
        "control.basis",
        "control.initial",
        "goal.x",
        "start.heading",
        "system.model",
        "output",
    ),
    *(
        "solvers.jacobian.tolerance",
        "solvers.jacobian.gamma",
        "solvers.jacobian.step_rule",
        "solvers.nlp.tolerance",
    ),
]
FLAGS = ["--solver", "--set", "--json", "--trace", "-o", "--debugg", "-h", "--", "", "\udcff"]


class Hang(BaseException):
    """A call that took too long."""


@dataclass(frozen=True)
class Broken:
    """A call and what it broke."""

    call: list[str]
    what: str

    def __str__(self) -> str:
        return f"{self.what}: nhpocp {' '.join(map(repr, self.call))}"


def spoilt_bytes(draw: random.Random, data: bytes) -> bytes:
    """A few bytes changed, taken out, put in, or a line said twice."""
    found = bytearray(data)
    for _ in range(draw.randint(1, 6)):
        place, what = draw.randrange(len(found) + 1), draw.randrange(4)
        if what == 0:
            del found[place : place + draw.randint(1, 30)]
        elif what == 1:
            found[place:place] = bytes(draw.randrange(256) for _ in range(draw.randint(1, 4)))
        elif what == 2:
            found[place:place] = draw.choice([b"\n", b": ", b"&a ", b"*a", b"!!x ", b"- ", b"\t", b"%", b'"'])
        else:
            lines = bytes(found).splitlines(keepends=True) or [b""]
            lines.insert(draw.randrange(len(lines) + 1), draw.choice(lines))
            found = bytearray(b"".join(lines))
    return bytes(found)


def spoilt_data(draw: random.Random, data: Any) -> Any:
    """Plain data with one of its parts replaced, left out or called otherwise."""
    if isinstance(data, dict) and data and draw.random() < 0.9:
        found, key = dict(data), draw.choice(list(data))
        value = found.pop(key)
        what = draw.random()
        if what < 0.8:
            found[key] = spoilt_data(draw, value)
        elif what < 0.9:
            found[f"{key}x"] = value
        return found
    if isinstance(data, list) and data and draw.random() < 0.7:
        place = draw.randrange(len(data))
        return [*data[:place], spoilt_data(draw, data[place]), *data[place + draw.randint(0, 1) :]]
    return draw.choice(ODD)


def spoilt_file(draw: random.Random, file: Path) -> bytes:
    """A problem file by bytes or by structure."""
    data = file.read_bytes()
    if draw.random() < 0.5:
        return spoilt_bytes(draw, data)
    stream = io.BytesIO()
    YAML(typ="safe").dump(spoilt_data(draw, YAML(typ="safe").load(data)), stream)
    return stream.getvalue()


def overrides(draw: random.Random, most: int) -> list[str]:
    """Some `--set KEY=VALUE`."""
    chosen = [(draw.choice(KEYS), draw.choice(ODD)) for _ in range(draw.randint(0, most))]
    return [part for key, value in chosen for part in ("--set", f"{key}={value}")]


def checks(draw: random.Random, home: Path) -> list[str]:
    file = home / "problem.yaml"
    file.write_bytes(spoilt_file(draw, draw.choice(sorted(PROBLEMS.glob("*.yaml")))))
    call = ["check", "problem.yaml", *overrides(draw, 2)]
    if draw.random() < 0.1:
        call.insert(draw.randrange(len(call) + 1), draw.choice(FLAGS))
    return [*call, "--json"]


def solves(draw: random.Random, home: Path) -> list[str]:
    file = home / "problem.yaml"
    source = PROBLEMS / draw.choice(["unicycle.yaml", "heisenberg.yaml", "paper.yaml"])
    file.write_bytes(spoilt_file(draw, source) if draw.random() < 0.3 else source.read_bytes())
    changes = ["--set", "output.pictures=false", *overrides(draw, 1)]
    key = draw.choice(
        ["horizon", "error_length", "length_scale", "solvers.jacobian.tolerance", "goal.x", "start.y"]
    )
    changes += ["--set", f"{key}={draw.choice(NUMBERS)}"]
    solver = draw.choice(["jacobian", "nlp"])
    return ["solve", "problem.yaml", "--solver", solver, *changes, "-o", "out", "--json"]


def verifies(stored: Path) -> Callable[[random.Random, Path], list[str]]:
    """Calls that verify copies of a stored solution, one of its files spoilt."""

    def verify(draw: random.Random, home: Path) -> list[str]:
        shutil.copytree(stored, home / "stored")
        file = draw.choice(sorted((home / "stored").iterdir()))
        if file.suffix == ".json" and draw.random() < 0.6:
            file.write_text(
                json.dumps(spoilt_data(draw, json.loads(file.read_text(encoding="utf-8")))), encoding="utf-8"
            )
        elif draw.random() < 0.1:
            file.unlink()
        else:
            file.write_bytes(spoilt_bytes(draw, file.read_bytes()))
        return ["verify", "stored", "--json"]

    return verify


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """`Hang` after the longest time; the end of the process where that is not heard."""

    def end(number: int, frame: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    faulthandler.dump_traceback_later(10 * LONGEST, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


def broken(call: list[str], top: Path) -> str:
    """What a call broke, "" for nothing; run in ``top``/inside."""
    out, errors, began = io.StringIO(), io.StringIO(), time.monotonic()
    measured = reset_peak_memory()
    try:
        with bounded(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            ended = status(call)
    except Hang:
        return f"no end within {time.monotonic() - began:.0f} s"
    except BaseException as error:  # noqa: BLE001 - the very thing that is looked for
        return f"{type(error).__name__}: {error}"
    if ended not in (0, 1, 2):
        return f"exit status {ended}"
    if "Traceback" in errors.getvalue():
        if Hang.__name__ in errors.getvalue():  # heard inside a callback of CasADi, which went on
            return f"no end within {LONGEST} s"
        return "a traceback on standard error"
    if measured and (peak_memory() or 0.0) > MOST:
        return f"{peak_memory():.0f} MB"
    if sorted(path.name for path in top.iterdir()) != ["inside"]:
        return "files outside its folder"
    if call[-1] == "--json" and call[-2] not in FLAGS and not {"-h", "--"} & set(call):
        try:
            json.loads(out.getvalue())
        except ValueError:
            return f"no JSON document: {out.getvalue()[:80]!r}"
    return ""


def fuzzed(make: Callable[[random.Random, Path], list[str]], count: int, seed: int) -> Iterator[Broken]:
    """What a number of calls break; each is drawn from its own seed."""
    here = Path.cwd()
    for k in range(count):
        with tempfile.TemporaryDirectory(prefix="nhpocp-fuzz-") as name:
            inside = Path(name) / "inside"
            inside.mkdir()
            os.chdir(inside)
            try:
                call = make(random.Random(f"{seed} {k}"), inside)
                what = broken(call, Path(name))
            finally:
                os.chdir(here)
        if what:
            yield Broken(call, f"seed {seed}, call {k}: {what}")


def fuzz(check: int, solve: int, verify: int, seed: int) -> Iterator[Broken]:
    """All kinds of calls."""
    yield from fuzzed(checks, check, seed)
    yield from fuzzed(solves, solve, seed)
    if verify:
        with tempfile.TemporaryDirectory(prefix="nhpocp-fuzz-") as name:
            stored = Path(name) / "stored"
            with contextlib.redirect_stdout(io.StringIO()):
                file = str(PROBLEMS / "unicycle.yaml")
                status(["solve", file, "--trace", "--set", "output.pictures=false", "-o", str(stored)])
            yield from fuzzed(verifies(stored), verify, seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    for kind, count in (("check", 2000), ("solve", 100), ("verify", 70), ("seed", 0)):
        parser.add_argument(f"--{kind}", type=int, default=count)
    chosen = vars(parser.parse_args())
    warnings.simplefilter("ignore", RuntimeWarning)  # as the program does
    found = 0
    for one in fuzz(**chosen):
        print(one, flush=True)
        found += 1
    print(", ".join(f"{name} {number}" for name, number in chosen.items()), f"- {found} broken")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
