"""A planner of `nhpocp export --format c-planner`, compiled with `planner_driver.c` and asked for plans."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

DRIVER = Path(__file__).with_name("planner_driver.c")
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
Question = tuple[np.ndarray, np.ndarray, np.ndarray | None]  # start, goal, first control or None


@dataclass(frozen=True)
class Answer:
    """What a planner says of one question; joints, speeds: at the times that were asked for, (times, joints)."""

    status: str
    updates: int
    evaluations: int
    error: float
    seconds: float
    coefficients: np.ndarray
    end: np.ndarray
    joints: np.ndarray
    speeds: np.ndarray


class CompiledPlanner:
    """The program of one planner."""

    def __init__(self, source: Path, flags: Sequence[str]) -> None:
        """source: the C file, its header beside it; the program stands there too.

        Errors: `RuntimeError` without a compiler, or with what it says.
        """
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise RuntimeError("no C compiler here")
        header = source.with_suffix(".h").read_text(encoding="utf-8")
        (name,) = set(re.findall(r"^struct (\w+)_plan \{", header, re.MULTILINE))
        self.sizes = {
            what: int(n) for what, n in re.findall(rf"#define {name.upper()}_(\w+) (\d+)\n", header)
        }
        self._program = source.with_suffix("")
        known = [f"-DNAME={name}", f"-DUPPER={name.upper()}", f'-DHEADER="{source.with_suffix(".h")}"']
        known += ["-DJOINTS"] if "JOINTS" in self.sizes else []
        made = [compiler, *flags, *known, str(DRIVER), str(source), "-lm", "-o", str(self._program)]
        done = subprocess.run(made, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr)

    def plans(self, questions: Iterable[Question], repeats: int = 1, times: int = 0) -> list[Answer]:
        """An answer to each; errors: `RuntimeError` where the program ends early, with what it says."""
        own = np.full(self.sizes["COEFFICIENTS"], np.nan)
        lines = []
        for start, goal, first in questions:
            parts = start, goal, own if first is None else np.ravel(first)
            lines.append(" ".join(repr(float(number)) for part in parts for number in part))
        command = [str(self._program), str(repeats), str(times)]
        done = subprocess.run(command, input="\n".join(lines), capture_output=True, text=True, check=False)
        if done.returncode or done.stderr:
            raise RuntimeError(done.stderr or f"exit status {done.returncode}")
        return [self._answer(line.split()) for line in done.stdout.splitlines()]

    def _answer(self, words: Sequence[str]) -> Answer:
        numbers = np.array([float(word) for word in words[3:]])
        count, size, joints = (self.sizes.get(name, 0) for name in ("COEFFICIENTS", "STATE", "JOINTS"))
        coefficients, end, rest = np.split(numbers[2:], [count, count + size])
        motion = rest.reshape(-1, 2, joints) if joints else np.empty((0, 2, 0))
        known = str(words[0]), int(words[1]), int(words[2]), float(numbers[0]), float(numbers[1])
        return Answer(*known, coefficients, end, motion[:, 0], motion[:, 1])
