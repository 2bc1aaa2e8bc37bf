"""What people see: progress and summaries in a pseudo-terminal, nothing of them in a pipe."""

from __future__ import annotations

import fcntl
import io
import json
import os
import pty
import re
import select
import shlex
import signal
import struct
import sys
import termios
import threading
import time
from dataclasses import replace
from pathlib import Path

import click
import pytest

from nhpocp import planning
from nhpocp.cli.entry import cli
from nhpocp.cli.progress import TerminalPanel as Panel
from nhpocp.cli.progress import progress
from nhpocp.cli.summary import comparison_lines, next_commands, report, task
from nhpocp.cli.terminal import put
from nhpocp.comparison import Comparison, Entry, compare
from nhpocp.deferred import Deferred
from nhpocp.outcome import Outcome
from nhpocp.problem_file import load_problem, read
from nhpocp.solution_folder import load_solution
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.views.progress import duration, sparkline

PAPER = Path(__file__).parents[2] / "problems" / "paper.yaml"
UNICYCLE = Path(__file__).parents[2] / "problems" / "unicycle.yaml"
PLAIN = ["--set", "output.pictures=false"]
PROGRAM = [sys.executable, "-c", "from nhpocp.cli import main; main()"]


def in_a_terminal(arguments, cwd, columns=80, press=None, **environment):
    """(exit status, everything that the terminal was sent); ``press``: Ctrl-C once this has been seen."""
    pid, screen = pty.fork()
    if pid == 0:
        os.chdir(cwd)
        unset = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES")
        kept = {name: value for name, value in os.environ.items() if name not in unset}
        os.execve(PROGRAM[0], [*PROGRAM, *map(str, arguments)], {**kept, "TERM": "xterm", **environment})
    fcntl.ioctl(screen, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    seen, pressed, until = b"", False, time.monotonic() + 120
    while time.monotonic() < until:
        if not select.select([screen], [], [], 1)[0]:
            continue
        try:
            part = os.read(screen, 65536)
        except OSError:  # Linux says so when the other side is gone
            break
        if not part:
            break
        seen += part
        if press and not pressed and press in plain(seen):
            os.write(screen, b"\x03")
            pressed = True
    else:
        os.kill(pid, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    os.close(screen)
    return status, seen.decode()


def plain(sent):
    """Without colours and movements of the cursor."""
    text = sent.decode(errors="replace") if isinstance(sent, bytes) else sent
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)


# --- in a terminal ----------------------------------------------------------------------------------------------------


def test_ctrl_c_ends_the_progress_and_keeps_what_was_found(tmp_path):
    """With a step so small that the time left is foretold before the key is pressed; 60 columns."""
    slow = ["--set", "solvers.jacobian.gamma=1e-4", "--set", "solvers.jacobian.max_iterations=1000000"]
    arguments = ["solve", PAPER, *slow, *PLAIN, "-o", "out"]
    status, sent = in_a_terminal(arguments, tmp_path, 60, "to the goal\r", NO_COLOR="1")
    said = plain(sent)
    assert status == 1
    assert "paper by jacobian · to the goal (euler)" in said
    assert re.search(r"update \d+  E 1\.\d+e\+00  wanted 0\.001  [▁▂▃▄▅▆▇█]{8,}", said)
    assert re.search(r"γ 0\.0001  step [\d.e-]+  σ_min\(J\) 0\.\d+  rank 6", said)
    assert re.search(r"\d s so far  about \d+ (s|min) to the goal", said)
    assert "paper by jacobian: interrupted" in said
    assert "\x1b[?25h" in sent  # the cursor is back
    assert not re.search(r"\x1b\[[0-9;]*3[0-7]m", sent)  # NO_COLOR
    written = [line for line in said.splitlines() if not line.lstrip().startswith("nhpocp ")]
    assert max(len(line.rpartition("\r")[2]) for line in written) <= 60
    assert load_solution(tmp_path / "out").outcome is Outcome.INTERRUPTED


def test_the_second_phase_shows_its_cost_and_the_worst_bound_and_a_stop_draws_nothing(tmp_path):
    wanted = [
        "constraints.leg_length=[20,50]",
        "constraints.leg_speed=31",
        "solvers.jacobian.objective=effort",
    ]
    overrides = [word for one in [*wanted, "solvers.jacobian.step_rule=auto"] for word in ("--set", one)]
    arguments = ["solve", PAPER, *overrides, "-o", "out"]
    status, sent = in_a_terminal(arguments, tmp_path, 90, "bounds: leg_speed", NO_COLOR="1")
    said = plain(sent)
    assert status == 1
    assert re.search(r"to the least effort", said)
    assert re.search(r"cost \d\.\d+  bounds: leg_speed by [\d.e-]+ of its limit", said)
    assert said.strip().splitlines()[-1].strip() == "no pictures were drawn; `nhpocp plot out` draws them"
    assert not list((tmp_path / "out").glob("*.png"))
    assert load_solution(tmp_path / "out").outcome is Outcome.INTERRUPTED


@pytest.mark.parametrize("columns", [60, 100])
def test_a_comparison_ends_with_a_table_files_and_commands(columns, solved, capsys, monkeypatch):
    failed = replace(solved, outcome=Outcome.ITERATION_LIMIT, verdict=replace(solved.verdict, ok=False))
    comparison = Comparison(
        [Entry(failed, "jacobian", "out/unicycle/jacobian"), Entry(solved, "nlp:a=b", "out/b")]
    )
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    comparison_lines(
        comparison,
        [Path("out/report.html"), Path("out/comparison.csv"), Path("out/comparison.json")],
        {"unicycle": task(UNICYCLE, ["name=my own"])},
    )
    lines = [line.rstrip() for line in plain(capsys.readouterr().out).splitlines()]
    said = "\n".join(lines)
    assert max(len(line) for line in lines if not line.startswith("  nhpocp ")) <= columns
    assert re.search(r"iteration_limit +\d\.\de-\d\d +11\.25", said)
    assert ("gap" in said) == (columns == 100)
    for name in ("report.html", "comparison.csv", "comparison.json", "unicycle/jacobian", "b"):
        assert f"  out/{name}" in lines
    assert lines[-2] == f"  nhpocp solve {UNICYCLE} --set 'name=my own' --set solvers.jacobian.step_rule=auto"


def test_the_pose_that_a_free_goal_was_met_at_stands_in_the_table(solved, capsys, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    report(solved, Path("out"))
    assert "pose reached" not in capsys.readouterr().out
    goal = {"x": solved.problem.goal["x"]}
    report(replace(solved, problem=replace(solved.problem, goal=goal)), Path("out"))
    said = " ".join(plain(capsys.readouterr().out).split())
    assert f"pose reached {solved.pose_reached}" in said


def test_a_comparison_tells_which_run_of_how_many():
    records = []
    compare([load_problem(UNICYCLE)], ["jacobian", "jacobian"], progress=records.append)
    runs = [(one["name"], one["variant"], one["run"], one["runs"]) for one in records]
    assert list(dict.fromkeys(runs)) == [("unicycle", "jacobian", 1, 2), ("unicycle", "jacobian", 2, 2)]


def test_nothing_of_it_in_a_pipe(capsys):
    with progress(quiet=False) as show:
        assert show is None
    assert capsys.readouterr() == ("", "")


# --- the panel --------------------------------------------------------------------------------------------------------


def record(k, error, **more):
    known = {"k": k, "error": error, "tolerance": 1e-3, "phase": "to the goal (euler)", **more}
    return Deferred(lambda: {"gamma": 0.1, "sigma_jacobian": 0.25}, known)


def heard(records, pace=1.0):
    """A panel, as if a record had come every ``pace`` seconds."""
    panel = Panel("mine")
    for one in records:
        panel.hear(one)
    panel.since -= pace * panel.calls
    panel.began -= pace * panel.calls
    return panel


def test_no_line_is_wider_than_the_terminal():
    panel = heard([record(k, 0.9**k, name="a" * 30, variant="jacobian", run=1, runs=2) for k in range(40)])
    for width in (20, 40, 60, 80, 100):
        lines = panel.lines(width)
        assert len(lines) == 4
        assert max(map(len, lines)) <= width
    assert "run 1 of 2" in panel.lines(80)[0]
    assert panel.lines(80)[2] == "γ 0.1  σ_min(J) 0.25"


def test_deferred_entries_are_looked_at_now_and_then_only():
    looks = []
    panel = Panel()
    for k in range(1000):
        panel.hear(Deferred(lambda: looks.append(1) or {}, {"k": k, "error": 0.5, "tolerance": 1e-3}))
    assert 1 <= len(looks) < 100


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([record(k, 0.9**k, expected=60 - k, at_most=500 - k) for k in range(20)], "about 41 s to the goal"),
        ([record(k, 0.9, expected=60, at_most=500 - k) for k in range(40)], "at most 8 min in this phase"),
        ([record(k, 0.9, expected=None, at_most=None) for k in range(40)], ""),
        ([record(k, 0.9, expected=60 - k, way="try 2: a seeded start") for k in range(20)], ""),
        ([record(k, 0.9, expected=60 - k) for k in range(2)], ""),
    ],
    ids=["foretold", "slower than foretold", "no limit", "one try of several", "too early"],
)
def test_time_left_is_said_only_where_something_justifies_it(records, words):
    panel = heard(records)
    assert panel.lines(80)[3] == f"{duration(len(records))} so far" + (f"  {words}" if words else "")


def test_another_try_and_another_phase_begin_anew():
    panel = heard([record(k, 0.5) for k in range(9)])
    panel.hear(record(0, 1.0, way="try 2: a seeded start"))
    assert panel.errors == [1.0]
    panel.hear(record(1, 1e-9, way="try 2: a seeded start", phase="to the least effort"))
    assert panel.errors == [1.0, 1e-9]
    assert panel.calls == 1
    panel.hear({"k": None, "error": None, "stage": "verifying"})
    assert "verifying" in panel.lines(80)[0]
    assert panel.lines(80)[1].startswith("update 1")


def test_the_course_is_logarithmic():
    assert sparkline([1, 1e-1, 1e-2, 1e-3, 0], 1e-3, 10) == "█▆▃▁▁"
    assert sparkline([10.0**-k for k in range(8)], 1e-7, 4, "_.:-=+*#") == "*=:_"
    assert sparkline([0.5], 1.0, 8) == "▁"


# --- what the solvers tell --------------------------------------------------------------------------------------------


def told(name, solver, **changes):
    """The records of a solve, and the solution."""
    problem = load_problem(name)
    records = []
    found = planning.solve(problem, replace(problem.solvers[solver], **changes), records.append)
    return records, found


def test_the_updates_left_of_euler_are_foretold():
    records, solution = told(PAPER, "jacobian")
    steps = [one for one in records if "stage" not in one]
    assert [one["k"] for one in steps] == list(range(solution.evaluations))
    assert all(abs(one["k"] + one["expected"] - 69) < 3 for one in steps[:60])
    assert [one["at_most"] for one in steps[:2]] == [500, 499]
    assert records[-1]["stage"] == "verifying"
    assert "expected" not in dict(solution.iterations[0])


def test_ipopts_lines_arrive_as_they_are_kept():
    """Of both starts, though only one of them is kept."""
    records, solution = told(UNICYCLE, "nlp", intervals=10, starts=2)
    ways = [
        [{name: one[name] for name in solution.iterations[0]} for one in records if one.get("way") == way]
        for way in ("start 1 of 2", "start 2 of 2")
    ]
    assert solution.iterations in ways
    assert all(ways)


def test_fatrop_says_that_it_cannot_be_stopped():
    records, _ = told(UNICYCLE, "nlp", intervals=10, optimizer=Fatrop())
    (stage,) = [one["stage"] for one in records if "Ctrl-C" in one.get("stage", "")]
    panel = heard([record(0, 0.5), {"k": None, "error": None, "stage": stage}])
    assert "fatrop is at work, and Ctrl-C waits until it has ended" in panel.lines(100)[0]


# --- what to do next --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solved():
    return told(UNICYCLE, "jacobian")[1]


@pytest.mark.parametrize("outcome", Outcome, ids=lambda outcome: outcome.value)
def test_every_outcome_has_commands_that_can_be_typed(outcome, solved):
    """Verbs that exist, settings that `check` takes, and never the run that has just failed."""
    converged = outcome is Outcome.CONVERGED
    for solver, settings in (
        ("jacobian", {"step_rule": "euler", "steps": 100}),
        ("jacobian", {"step_rule": "auto", "steps": 100}),
        ("nlp", {"initial": "problem", "intervals": 50}),
        ("nlp", {"initial": "jacobian", "intervals": 50, "max_iterations": 7}),
    ):
        ended = replace(
            solved,
            outcome=outcome,
            solver=solver,
            settings=settings,
            verdict=replace(solved.verdict, ok=converged),
        )
        commands = next_commands(ended, Path("my results/x"), task(UNICYCLE, ["name=my own"]))
        assert commands
        for command in commands:
            program, verb, *arguments = shlex.split(command)
            assert program == "nhpocp"
            parsed = cli.commands[verb].make_context(verb, list(arguments)).params
            if overrides := parsed.get("overrides"):
                read(UNICYCLE, overrides)
            again = verb == "solve" and parsed["solver"] == solver and overrides == ("name=my own",)
            assert not again or outcome is Outcome.INTERRUPTED


def test_commands_know_their_verbs():
    with pytest.raises(click.UsageError):
        cli.commands["verify"].make_context("verify", ["x", "--set", "a=b"])


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_signal_cuts_no_document_of_an_unbuffered_output(monkeypatch):
    """`python -u` writes to the pipe itself, which takes 64 kB at a time and less when a signal arrives."""
    reading, writing = os.pipe()
    main, received = threading.main_thread().ident, []

    def read():
        time.sleep(0.3)  # until the pipe is full
        signal.pthread_kill(main, signal.SIGUSR1)
        time.sleep(0.1)
        with open(reading, "rb") as stream:
            received.append(stream.read())

    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    reader = threading.Thread(target=read)
    reader.start()
    data = {"words": "ü" * 200_000}
    try:
        with io.TextIOWrapper(io.FileIO(writing, "w"), encoding="utf-8", write_through=True) as stream:
            monkeypatch.setattr(sys, "stdout", stream)
            put(data)
            monkeypatch.undo()
        reader.join()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert json.loads(received[0]) == data
