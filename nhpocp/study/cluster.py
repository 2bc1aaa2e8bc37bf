"""Workers of Dask, on this machine or on a cluster, as an executor."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any

from nhpocp.errors import InvalidProblemError, MissingDependencyError, one_line
from nhpocp.solvers.workers import deaf_to_ctrl_c

LOCAL = "local"
GRACE = 3.0  # seconds to wait for workers to end
PATIENCE = 30.0  # seconds to wait for a scheduler, and for the first worker
OPTION = "--dask"


class WorkerDiedError(Exception):
    """The workers that were given a job died; the others go on."""


class SchedulerLostError(Exception):
    """No worker can be reached any more."""


_alone = threading.Lock()  # of a worker with several threads


def _one_at_a_time(work: Callable[..., Any], *arguments: Any) -> Any:
    """What is kept for a system is for one thread."""
    with _alone:
        try:
            return work(*arguments)
        except KeyboardInterrupt:  # no longer wanted; it would end the worker
            return None


class DaskExecutor(Executor):
    """Hands work to the workers of a scheduler; what begins of it ends with `shutdown`, the workers stay.

    address: of the scheduler, such as tcp://10.0.0.1:8786, or `LOCAL` for a cluster of so many ``processes`` on this
    machine, which ends with it. Errors: `MissingDependencyError` without distributed, `InvalidProblemError` where no
    scheduler answers or none of its workers comes.
    """

    def __init__(self, address: str, processes: int | None = None) -> None:
        try:
            import distributed
        except ImportError:
            words = 'Dask needs distributed; install it with: pip install "nhpocp[cluster]"'
            raise MissingDependencyError(words) from None
        for logger in ("distributed", "distributed.client"):  # what they log ends in a future too
            logging.getLogger(logger).setLevel(logging.CRITICAL)
        self._begun: set[Future[Any]] = set()
        self._client: Any = None
        self._cluster: Any = None
        try:
            with deaf_to_ctrl_c():  # and the threads and processes that it begins
                self._cluster = _local_cluster(processes) if address == LOCAL else None
                self._client = distributed.Client(
                    self._cluster or address, timeout=PATIENCE, set_as_default=False
                )
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
            self.shutdown()
            words = f"no workers of Dask ({one_line(error)}); expected {LOCAL}, or the address of a scheduler"
            raise InvalidProblemError(f"{words} with workers, as tcp://10.0.0.1:8786", path=OPTION) from None

    @property
    def workers(self) -> int:
        """How many there are now. Errors: `SchedulerLostError`."""
        try:
            return max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
        except OSError as error:
            raise SchedulerLostError from error

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Errors, of the future: `WorkerDiedError`, `SchedulerLostError`."""
        ours: Future[Any] = Future()
        ours.set_running_or_notify_cancel()
        theirs = self._client.submit(_one_at_a_time, work, *arguments, **named, pure=False)
        theirs.add_done_callback(lambda done: _hand_over(done, ours))
        self._begun = {future for future in self._begun if not future.done()} | {ours}
        return ours

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        futures.wait(self._begun, GRACE)  # a worker that is closed at its work is waited for in vain
        for part in (self._client, self._cluster):
            if part is not None:
                with suppress(TimeoutError):
                    part.close(timeout=GRACE)
        self._client = self._cluster = None


def _local_cluster(processes: int | None) -> Any:
    import dask
    from distributed import LocalCluster

    # whose job it was is known at the first death, and `sweep` tries once more
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        return LocalCluster(
            n_workers=processes, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        )


def _hand_over(theirs: Any, ours: Future[Any]) -> None:
    """The end of a future of Dask's, in Dask's own thread."""
    from distributed import KilledWorker

    if theirs.status == "finished":
        ours.set_result(theirs.result())
        return
    error = theirs.exception() if theirs.status == "error" else None
    if isinstance(error, KilledWorker):
        error = WorkerDiedError(one_line(error))
    ours.set_exception(error or SchedulerLostError())
