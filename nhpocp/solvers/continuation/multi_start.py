"""Several starts of one continuation, the later ones side by side."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import closing
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, ClassVar

from nhpocp.constructed import Constructed
from nhpocp.declared import check, count
from nhpocp.errors import expect
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution, telling
from nhpocp.solvers.continuation.confirmation import confirmed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.workers import (
    NotSentError,
    awaited,
    own_executor,
    packed,
    permit,
    processes,
    submitted,
    unpacked,
)

_log = logging.getLogger("nhpocp")


@dataclass(frozen=True)
class MultiStart(Constructed):
    """Solver: the continuation from ``starts`` controls; the first that reaches the goal counts, in their order.

    Start 1 is the problem's own, the others are seeded (`initial: auto` with the seeds after the solver's). Start 1
    runs here; only if it fails are the others handed to what ``executor`` makes. The result does not depend on it:
    where it fails, or the problem cannot be sent to it, they run here, too. Evaluations are those of all starts, and
    building and solving together take what the clock showed for all of them, side by side as they run.
    continuation: the method. executor: makes a `concurrent.futures.Executor`; a process a core unless said.
    """

    continuation: Continuation = field(default_factory=Continuation)
    starts: int = count(8, "tries: the problem's control, then seeded ones")
    executor: Callable[[], Executor] = processes
    name: ClassVar[str] = "jacobian"

    def __post_init__(self) -> None:
        expect(self.continuation, Continuation, "a Continuation", "MultiStart.continuation")
        check(self)

    @property
    def tolerance(self) -> float:
        return self.continuation.tolerance

    def settings(self) -> dict[str, Any]:
        return {**self.continuation.settings(), "starts": self.starts}

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        with Interruption() as interruption:
            return self._best(problem, progress, interruption).solution(self, problem)

    def _best(
        self, problem: PlanningProblem, progress: Progress | None, interruption: Interruption
    ) -> ContinuationResult:
        began = perf_counter()
        first = telling(progress, way=f"start 1 of {self.starts}" if self.starts > 1 else None)
        ended = [confirmed(self.continuation, problem, first)]
        stopped = False
        if ended[0].outcome is not Outcome.CONVERGED:
            try:
                interruption.check()
                with closing(self._others(problem, interruption)) as others:
                    for other in others:
                        ended.append(other)
                        if progress:  # they run elsewhere, and are heard of when they have ended
                            way = f"start {len(ended)} of {self.starts}: {other.outcome.value}"
                            progress({"k": len(other.records), "error": other.error, "way": way})
                        if other.outcome is Outcome.CONVERGED:
                            break
                        interruption.check()
            except KeyboardInterrupt:
                stopped = True
        best = ended[-1] if ended[-1].outcome is Outcome.CONVERGED else min(ended, key=lambda one: one.rank)
        tried = [
            {
                "way": f"start {i}",
                "outcome": one.outcome.value,
                "error": one.error,
                "evaluations": len(one.records),
            }
            for i, one in enumerate(ended, 1)
        ]
        records = [record | {"attempt": i} for i, one in enumerate(ended) for record in one.records]
        message = f"{best.message}; start {ended.index(best) + 1} of {self.starts}"
        outcome = Outcome.INTERRUPTED if stopped else best.outcome
        if outcome is not best.outcome:
            message = f"{STOPPED}; best so far: {message}"
        return replace(
            best,
            outcome=outcome,
            message=message,
            records=records,
            details={**best.details, "tried": tried},
            build_seconds=ended[0].build_seconds,
            solve_seconds=perf_counter() - began - ended[0].build_seconds,
        )

    def _others(
        self, problem: PlanningProblem, interruption: Interruption
    ) -> Generator[ContinuationResult, None, None]:
        """Starts 2, 3, … in order; those not yet begun are given up when no more are asked for."""
        base, seeded = self.continuation, replace(problem, initial=None, solvers={})
        seeds = range(base.seed + 1, base.seed + self.starts)
        begun = 0
        try:
            payload = packed((base, seeded))
            with own_executor(self.executor) as executor, permit() as given:
                jobs = [submitted(executor, given, _started, payload, seed) for seed in seeds]
                for job in jobs:
                    yield awaited(job, interruption)
                    begun += 1
        except (NotSentError, BrokenExecutor) as error:
            interruption.check()  # it may be why they broke
            _log.warning("nhpocp: %s; the starts are tried one after another", error)
            for seed in seeds[begun:]:
                yield confirmed(replace(base, seed=seed), seeded)


def _started(payload: bytes, seed: int) -> ContinuationResult:
    base, problem = unpacked(payload)
    return confirmed(replace(base, seed=seed), problem)
