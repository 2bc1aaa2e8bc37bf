"""A study's runs, handed to processes and stored as they finish."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Any

from nhpocp.interruption import Interruption
from nhpocp.provenance import environment
from nhpocp.solvers.workers import OFTEN, awaited, deaf_to_ctrl_c, own_executor, permit, processes, submitted
from nhpocp.study import STORE
from nhpocp.study.cluster import SchedulerLostError, WorkerDiedError
from nhpocp.study.order import Piece, one_by_one
from nhpocp.study.rounds import Round, rounds
from nhpocp.study.run import Job, Source, failed_row, performed
from nhpocp.study.store import Row, Store
from nhpocp.study.study import Study
from nhpocp.study.trials import Trial

AHEAD = 1  # jobs that wait in the queue beside those that are worked on
DIED = "the process that worked on it died twice, as for lack of memory; `nhpocp solve` on this problem shows more"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Submit = Callable[..., Future[list[Row]]]


@dataclass
class Tally:
    """How far a sweep is. runs: of the study; stored: of those, at its beginning and since; trials: that are judged."""

    runs: int
    stored: int
    converged: int
    began: float = field(default_factory=perf_counter)
    done: int = 0  # in this sweep
    stopped: str = ""  # why, where it was
    trials: list[Trial] = field(default_factory=list)

    @property
    def failed(self) -> int:
        return self.stored - self.converged

    @property
    def seconds(self) -> float:
        return perf_counter() - self.began

    @property
    def rate(self) -> float:
        """Runs a second, of this sweep."""
        return self.done / max(self.seconds, 1e-9)

    def add(self, rows: list[Row]) -> None:
        self.stored, self.done = self.stored + len(rows), self.done + len(rows)
        self.converged += sum(row["converged"] for row in rows)


Listener = Callable[[Tally], Any] | None


def opened(study: Study, folder: Path, resume: bool) -> Store:
    """The store of a study in its folder: a new one, or with ``resume`` the one that is there.

    Errors: `InvalidProblemError` as of `Store.create`, `MissingDependencyError` where there is no optimiser.
    """
    if study.optimise:
        from nhpocp.study.optimiser import check_place

        check_place(folder / STORE, resume)
    return Store.create(folder / STORE, study, resume)


def sweep(
    study: Study,
    store: Store,
    workers: int,
    progress: Listener = None,
    make: Callable[[], Executor] | None = None,
) -> Tally:
    """Performs the runs that a store does not have yet, and stores each once.

    workers: processes, of one thread each. progress: is told of every change. make: another executor for them, which
    may say how many ``workers`` it has. Ctrl-C ends it, and so does the loss of all workers at once; what was stored
    stays, and the tally says why it ``stopped``. A run whose process dies is begun once more, alone; if it dies again
    its row says so. Errors: `InvalidProblemError` where the store cannot be written to, and whatever ends the
    executor as a whole.
    """
    make = make or partial(processes, workers, "spawn")
    outcomes = store.outcomes()
    tally = Tally(len(study), sum(outcomes.values()), outcomes.get("converged", 0))
    with (
        Interruption(patient=False) as interruption,
        _one_thread(),
        rounds(study, store, tally.trials) as following,
    ):
        course = _Course(following, store, tally, progress)
        try:
            while course.goes_on():
                interruption.check()
                with own_executor(make) as executor, permit() as given:
                    many = partial(getattr, executor, "workers", workers)
                    course.begin(many())
                    course.run(partial(submitted, executor, given), many, interruption)
        except KeyboardInterrupt:
            tally.stopped = "by hand"
        except SchedulerLostError:
            tally.stopped = "since Dask's scheduler was lost"
    return tally


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes begun within it have one thread for their linear algebra."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class _Course:
    """What is still to be done, and what is being done.

    suspects: runs that were under way when a process died; they are begun again one at a time, so that it is known
    which of them it was if one dies again.
    """

    def __init__(self, following: Iterator[Round], store: Store, tally: Tally, progress: Listener) -> None:
        self.following, self.store, self.tally, self.progress = following, store, tally, progress
        self.session: int | None = None
        self.suspects: deque[Piece] = deque()
        self.waiting: deque[Piece] = deque()
        self.pieces: Iterator[Piece] = iter(())

    def goes_on(self) -> bool:
        """Whether anything is left to begin. Asked where nothing is under way, so that a round ends before the next."""
        while not (self.suspects or self.left()):
            following = next(self.following, None)
            if following is None:
                return False
            self.study, self.pieces = following
            self.source, self.chained = Source.of(self.study), self.study.order == "nearest"
        return True

    def begin(self, workers: int) -> None:
        """Notes in the store, once, by whom the runs are performed."""
        if self.session is None:
            self.session = self.store.begin(workers, environment())

    def left(self) -> bool:
        """Whether anything of this round waits."""
        if not self.waiting:
            self.waiting.extend(islice(self.pieces, 1))
        return bool(self.waiting)

    def run(self, submit: Submit, workers: Callable[[], int], stop: Interruption) -> None:
        """Works until nothing is left, or a process of a pool has died: then the executor is of no more use."""
        under_way: dict[Future[list[Row]], Piece] = {}
        try:
            while self.goes_on():
                while self.left() or self.suspects or under_way:
                    if self.suspects and not under_way:
                        self._again(submit, stop)
                        continue
                    while not self.suspects and len(under_way) < workers() + AHEAD and self.left():
                        job = self._begun(submit, self.waiting[0])
                        under_way[job] = self.waiting.popleft()
                    ended = wait(under_way, OFTEN, FIRST_COMPLETED).done
                    for job in sorted(ended, key=lambda job: job.exception() is not None):  # rows first
                        try:
                            self._keep(job.result())
                        except WorkerDiedError:  # it is known whose work it was
                            self.suspects.extend(one_by_one(under_way[job], self.chained))
                        del under_way[job]
                    stop.check()
                stop.check()
        except BrokenProcessPool:
            for piece in under_way.values():
                self.suspects.extend(one_by_one(piece, self.chained))

    def _again(self, submit: Submit, stop: Interruption) -> None:
        piece = self.suspects[0]
        job = self._begun(submit, piece, tries=2)
        self.suspects.popleft()
        try:
            self._keep(awaited(job, stop))
        except (BrokenProcessPool, WorkerDiedError) as error:
            self._keep([failed_row(self.study, piece.runs[0], DIED, tries=2)])
            if isinstance(error, BrokenProcessPool):
                raise

    def _begun(self, submit: Submit, piece: Piece, tries: int = 1) -> Future[list[Row]]:
        start = self.store.control(piece.before) if piece.before else None
        with deaf_to_ctrl_c():
            return submit(performed, self.source, Job(piece.runs, self.chained, start, tries))

    def _keep(self, rows: list[Row]) -> None:
        self.store.add({**row, "session": self.session} for row in rows)
        self.tally.add(rows)
        if self.progress:
            self.progress(self.tally)
