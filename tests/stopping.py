"""Stops at chosen moments of every verb, and what became of them. A program too: `python tests/stopping.py 100`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PROBLEMS = Path(__file__).parents[1] / "problems"
MARK = "NHPOCP_STOPPED"  # in the environment of everything that a run begins
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SLOW = ("solvers.jacobian.gamma=1e-4", "solvers.jacobian.max_iterations=100000")
POOL = (
    *SLOW,
    "solvers.jacobian.step_rule=euler",
    "solvers.jacobian.starts=6",
    "solvers.jacobian.max_iterations=9000",
    "control.initial=[[0,0,0,0,0],[0,0,0,0,0],[0,0,0,0,0]]",  # has no rank: the others begin at once
)
# every verb, what it is given, and the last moment of a stop [s]
RUNS: dict[str, tuple[list[str], float]] = {
    "solve": (["solve", "paper.yaml", *SLOW], 6.0),
    "solve, drawing": (["solve", "paper.yaml", "solvers.jacobian.gamma=1"], 6.0),
    "solve, pool": (["solve", "paper.yaml", *POOL], 9.0),
    "solve, auto": (["solve", "paper_conjecture.yaml", "solvers.jacobian.step_rule=auto", *SLOW[1:]], 5.0),
    "solve, nlp": (["solve", "paper.yaml", "--solver", "nlp"], 9.0),
    "solve, nlp, compiled": (
        ["solve", "suslov_joint.yaml", "--solver", "nlp", "solvers.compile=always"],
        9.0,
    ),
    "solve, nlp, large": (
        ["solve", "parallel_robot.yaml", "--solver", "nlp", "solvers.nlp.intervals=200"],
        20.0,
    ),
    "compare": (["compare", "paper.yaml", "unicycle.yaml"], 20.0),
    "compare, pool": (["compare", "paper.yaml", *POOL], 9.0),
    "analyze": (["analyze", "paper.yaml"], 9.0),
    "verify": (["verify", "DIR"], 3.0),
    "plot": (["plot", "DIR"], 6.0),
    "animate": (["animate", "DIR", "--format", "gif"], 9.0),
    "check": (["check", "paper.yaml"], 0.8),
    "doctor": (["doctor"], 3.0),
    "systems": (["systems"], 1.0),
    "schema": (["schema"], 1.0),
    "init": (["init"], 1.0),
    "plan_many, pool": (["plan_many"], 9.0),
}
PROGRAM = """
import sys
from pathlib import Path
from nhpocp import planning
from nhpocp.cli import main
before = planning.solve
def solve(*arguments, **options):
    Path("begun").touch()
    return before(*arguments, **options)
planning.solve = solve
main()
"""
PLANNING = """
import sys
from concurrent.futures import ProcessPoolExecutor
from nhpocp.cli.entry import _stopped_alike
import nhpocp
if __name__ == "__main__":
    problem = nhpocp.load_problem({problem!r})
    rule = nhpocp.Continuation(step_rule=nhpocp.Euler(gamma=1e-4), max_iterations=2000)
    try:
        with _stopped_alike(), ProcessPoolExecutor(2) as pool:
            list(nhpocp.plan_many(problem, [problem.goal] * 40, rule, executor=pool, together=1))
    except KeyboardInterrupt:
        sys.exit(1)
"""


@dataclass(frozen=True)
class Stop:
    """What became of a run that was stopped."""

    run: str
    number: signal.Signals
    group: bool
    moment: float
    status: int
    seconds: float  # from the signal to the end
    processor_seconds: float  # of the process alone, in between
    left: list[int]  # processes that are there 5 s later
    outcomes: list[str]
    begun: bool
    messages: str

    @property
    def faults(self) -> list[str]:
        """What is not as it should be, whatever the time it took."""
        found = []
        if self.left:
            found.append(f"{len(self.left)} processes left")
        if self.status not in (0, 1, -self.number):
            found.append(f"exit status {self.status}")
        if "Traceback" in self.messages and self.status == 1 and self.begun:
            found.append("a traceback")
        if self.begun and not set(self.outcomes) & {"interrupted", "converged"}:
            found.append(f"outcomes {self.outcomes} though a solve had begun")
        return found


def stop(run: str, number: signal.Signals, group: bool, moment: float, home: Path, stored: Path) -> Stop:
    """Begins a run in a folder of its own and stops it; ``stored``: a solution folder."""
    arguments, _ = RUNS[run]
    mark = f"{MARK}={home}"
    process = subprocess.Popen(
        _command(arguments, home, stored),
        cwd=home,
        env={**os.environ, MARK: str(home), "NHPOCP_COMPILE": "never", "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=_as_from_a_terminal,
    )
    time.sleep(moment)
    before, began = _processor_seconds(process.pid), time.monotonic()
    if process.poll() is None:
        (os.killpg if group else os.kill)(process.pid, number)
    after = before
    while process.poll() is None:
        after = max(after, _processor_seconds(process.pid))
        time.sleep(0.005)
    seconds = time.monotonic() - began
    while (left := _marked(mark)) and time.monotonic() < began + seconds + 5.0:
        time.sleep(0.1)
    for one in left:
        os.kill(one, signal.SIGKILL)
    _, messages = process.communicate(timeout=60)
    outcomes = [json.loads(file.read_text())["outcome"] for file in home.rglob("solution.json")]
    begun = (home / "begun").exists()
    return Stop(
        run,
        number,
        group,
        moment,
        process.returncode,
        seconds,
        after - before,
        left,
        outcomes,
        begun,
        messages,
    )


def _command(arguments: list[str], home: Path, stored: Path) -> list[str]:
    if arguments == ["plan_many"]:
        script = home / "planning.py"
        script.write_text(PLANNING.format(problem=str(PROBLEMS / "paper.yaml")))
        return [sys.executable, str(script)]
    words = []
    for word in arguments:
        if word.endswith(".yaml"):
            word = str(PROBLEMS / word)
        words += ["--set", word] if "=" in word else [str(stored) if word == "DIR" else word]
    return [sys.executable, "-c", PROGRAM, *words]


def _as_from_a_terminal() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background of a script
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _processor_seconds(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _marked(mark: str) -> list[int]:
    """Living processes with that in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (place / "environ").read_bytes().split(b"\0"):
                found.append(int(place.name))
        except OSError:
            continue
    return found


def solution_folder(home: Path) -> Path:
    """A stored solution to verify, plot and animate."""
    folder = home / "stored"
    given = ["solve", str(PROBLEMS / "paper.yaml"), "--set", "output.pictures=false", "-o", str(folder)]
    subprocess.run([sys.executable, "-c", PROGRAM, *given], cwd=home, check=True, capture_output=True)
    return folder


def drawn(count: int, seed: int) -> list[tuple[str, signal.Signals, bool, float]]:
    """So many stops, all runs in turn: a run, a signal, whether the group gets it, and a moment."""
    chance, names, found = np.random.default_rng(seed), list(RUNS), []
    for k in range(count):
        run = names[k % len(names)]
        number = SIGNALS[int(chance.integers(len(SIGNALS)))]
        found.append((run, number, bool(chance.integers(2)), float(chance.uniform(0.1, RUNS[run][1]))))
    return found


def main() -> None:
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        os.environ.setdefault("NHPOCP_CACHE", str(home / "cache"))
        stored, ends = solution_folder(home), []
        for k, chosen in enumerate(drawn(count, seed)):
            place = home / str(k)
            place.mkdir()
            ended = stop(*chosen, place, stored)
            ends.append(ended)
            words = f"{ended.number.name:8} {'group' if ended.group else 'alone'} at {ended.moment:5.2f} s"
            took = f"{ended.seconds:5.2f} s, {ended.processor_seconds:5.2f} s of processor"
            outcome = f"{ended.status:3} {','.join(ended.outcomes) or '-'}"
            print(f"{ended.run:22} {words}: {took} {outcome} {'; '.join(ended.faults)}", flush=True)
            if ended.faults:
                print(ended.messages[-2000:], flush=True)
    late = [ended for ended in ends if ended.seconds > 2.0]
    slow = [ended for ended in ends if ended.processor_seconds > 2.0]
    bad = [ended for ended in ends if ended.faults]
    print(f"{count} stops: {len(late)} over 2 s, {len(slow)} over 2 s of processor, {len(bad)} with faults")


if __name__ == "__main__":
    main()
