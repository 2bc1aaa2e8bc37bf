"""Ctrl-C, SIGTERM and SIGHUP at any moment; systems that cannot be sent; workers whose parent has gone."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nhpocp
from nhpocp import interruption
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers import workers
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.evaluation import Evaluator
from nhpocp.solvers.continuation.multi_start import MultiStart, processes
from nhpocp.solvers.continuation.step_rules import Adaptive, Euler
from tests import stopping
from tests.conftest import Integrators, paper_problem

needs_proc = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="reads processes there")


def unsendable(**changes) -> PlanningProblem:
    """A problem whose system is of a class made in a function; its own start has no rank."""

    class Local(Integrators):
        model = "local"

    values = {"start": {"x": 0.0, "y": 0.0}, "goal": {"x": 1.0, "y": 2.0}, "initial": np.zeros((2, 5))}
    return PlanningProblem(system=Local(), **{**values, **changes})


def blocked(problem) -> PlanningProblem:
    """Its start 1 fails at once: no rank."""
    return replace(problem, initial=np.zeros((3, 5)))


SLOWLY = Continuation(step_rule=Euler(gamma=1e-4), max_iterations=100_000)


# --- what cannot be sent ----------------------------------------------------------------------------------------------


def test_starts_of_a_system_that_cannot_be_sent_run_here_and_say_so(caplog):
    with pytest.raises((AttributeError, pickle.PicklingError)):
        pickle.dumps(unsendable().system)
    rule = Continuation(step_rule=Adaptive(), max_iterations=1, tolerance=1e-30)
    solution = MultiStart(rule, 3).solve(unsendable())
    assert len(solution.details["tried"]) == 3
    assert "put its classes at the top of a module" in caplog.text
    here = MultiStart(rule, 3, lambda: ThreadPoolExecutor(1)).solve(unsendable())
    assert here.details["tried"] == solution.details["tried"]


def test_what_cannot_be_read_elsewhere_runs_here_too(monkeypatch, caplog):
    """A class that the other process does not find, as those of an interactive session."""
    monkeypatch.setattr(
        sys.modules["__main__"], "Elsewhere", type("Elsewhere", (Adaptive,), {}), raising=False
    )
    here = sys.modules["__main__"].Elsewhere
    here.__module__, here.__qualname__ = "__main__", "Elsewhere"
    payload = workers.packed(here)
    monkeypatch.delattr(sys.modules["__main__"], "Elsewhere")
    with pytest.raises(workers.NotSentError, match="put its classes"):
        workers.unpacked(payload)


def test_a_pool_that_breaks_does_not_end_a_solve(caplog):
    class Breaking(ThreadPoolExecutor):
        def submit(self, *_, **__):
            raise BrokenProcessPool("gone")

    solution = MultiStart(Continuation(step_rule=Adaptive()), 4, Breaking).solve(blocked(paper_problem()))
    assert solution.outcome is Outcome.CONVERGED
    assert "gone; the starts are tried one after another" in caplog.text


def test_goals_of_a_system_that_cannot_be_sent_are_refused_in_words():
    problem = unsendable()
    with ThreadPoolExecutor(1) as pool, pytest.raises(nhpocp.InvalidProblemError, match="put its classes"):
        next(nhpocp.plan_many(problem, [problem.goal], executor=pool))
    plans = nhpocp.plan_many(problem, [problem.goal])  # here there is nothing to send
    assert next(plans).outcome is not Outcome.INTERRUPTED


# --- stops within this process ----------------------------------------------------------------------------------------


def pressed_after(seconds):
    """Ctrl-C, some time from now."""
    main = threading.main_thread().ident
    timer = threading.Timer(seconds, signal.pthread_kill, (main, signal.SIGINT))
    timer.daemon = True
    timer.start()


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("executor", [processes, lambda: ThreadPoolExecutor(2)])
def test_ctrl_c_while_others_work_ends_as_interrupted(executor):
    pressed_after(1.0)
    solution = nhpocp.solve(blocked(paper_problem()), MultiStart(SLOWLY, 4, executor))
    assert solution.outcome is Outcome.INTERRUPTED
    assert "Stopped by hand" in solution.message
    assert not multiprocessing.active_children()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_begins_no_more_chunks():
    problem = paper_problem()
    with ThreadPoolExecutor(1) as pool:
        plans = nhpocp.plan_many(problem, [problem.goal] * 20, SLOWLY, executor=pool, together=1)
        pressed_after(0.7)
        with pytest.raises(KeyboardInterrupt):
            list(plans)
        began = time.process_time()
    assert time.process_time() - began < 20  # one such chunk takes minutes


def test_plans_that_nobody_asks_for_any_more_are_given_up():
    problem = paper_problem()
    goals = [problem.goal] * 3
    with ThreadPoolExecutor(1) as pool:
        plans = nhpocp.plan_many(
            problem, goals, Continuation(step_rule=Adaptive()), executor=pool, together=1
        )
        assert next(plans).outcome is Outcome.CONVERGED
        plans.close()
        assert pool.submit(int).result(timeout=60) == 0


def test_a_stop_while_functions_are_built_is_an_interrupted_solution(monkeypatch):
    monkeypatch.setattr(interruption, "PATIENCE", 0.1)

    class Building(Continuation):
        def solve(self, problem, progress=None):
            signal.raise_signal(signal.SIGINT)
            while True:
                time.sleep(0.01)

    solution = nhpocp.solve(paper_problem(), Building())
    assert solution.outcome is Outcome.INTERRUPTED
    assert not np.any(solution.control.coefficients)


def test_a_stop_waits_for_no_record_of_a_long_search(monkeypatch, tmp_path):
    looked_at = []
    whole = Evaluator.looked_at

    def counted(self, evaluation):
        looked_at.append(evaluation)
        return whole(self, evaluation)

    monkeypatch.setattr(Evaluator, "looked_at", counted)

    def progress(record):
        if record["k"] == 20:
            signal.raise_signal(signal.SIGINT)

    solution = nhpocp.solve(paper_problem(), Continuation(step_rule=Euler(gamma=1e-4)), progress)
    assert solution.outcome is Outcome.INTERRUPTED
    nhpocp.save_solution(solution, tmp_path / "stopped")
    assert len(nhpocp.load_solution(tmp_path / "stopped").iterations) == 21
    assert not looked_at


# --- workers without a parent -----------------------------------------------------------------------------------------

ORPHANS = """
import os, signal, sys, time
from concurrent.futures import ProcessPoolExecutor
import multiprocessing
from nhpocp.solvers import workers
if __name__ == "__main__":
    context = multiprocessing.get_context(sys.argv[1])
    own = sys.argv[2] == "own"
    pool = workers.processes() if own else ProcessPoolExecutor(1, mp_context=context)
    with workers.permit() as given:
        jobs = [workers.submitted(pool, given, time.sleep, seconds) for seconds in (0, 0, 3600)]
        jobs[0].result()
        os.kill(os.getpid(), signal.SIGKILL)
"""


@needs_proc
@pytest.mark.parametrize(("method", "whose"), [("fork", "own"), ("fork", "theirs"), ("spawn", "theirs")])
def test_workers_end_with_a_parent_that_was_killed(method, whose, tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    environment = {**os.environ, stopping.MARK: str(tmp_path)}
    done = subprocess.run(
        [sys.executable, str(script), method, whose], env=environment, check=False, stdout=subprocess.DEVNULL
    )
    assert done.returncode == -signal.SIGKILL
    until = time.monotonic() + 20
    while (left := stopping._marked(f"{stopping.MARK}={tmp_path}")) and time.monotonic() < until:
        time.sleep(0.05)
    assert left == []


# --- stops from outside -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return stopping.solution_folder(tmp_path_factory.mktemp("stored"))


SHORT = [
    ("solve", signal.SIGTERM, True, 2.0),
    ("solve, pool", signal.SIGTERM, False, 3.0),
    ("solve, pool", signal.SIGINT, True, 3.0),
    ("compare, pool", signal.SIGHUP, True, 3.0),
    ("plan_many, pool", signal.SIGTERM, False, 3.0),
    ("analyze", signal.SIGHUP, False, 1.0),
    ("verify", signal.SIGINT, False, 1.0),
]


@needs_proc
@pytest.mark.parametrize(("run", "number", "group", "moment"), SHORT)
def test_a_stop_ends_a_run_and_its_workers(run, number, group, moment, stored, tmp_path):
    """All moments and verbs: `python tests/stopping.py 100`, which says how long each took."""
    ended = stopping.stop(run, number, group, moment, tmp_path, stored)
    assert ended.faults == [], ended.messages
    assert ended.processor_seconds < 10  # a guard against hanging
