"""Work in other processes that ends when nobody wants it any more.

Executors cannot be told: what has begun runs on, what was fetched ahead begins all the same, and processes wait for
ever for the next work of a parent that was killed.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import platform
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import Interruption, while_wanted

OFTEN = 0.05  # seconds between two looks at whether to stop
GRACE = 0.3  # seconds in which workers may end by themselves
DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux

T = TypeVar("T")


class NotSentError(InvalidProblemError):
    """Something cannot be sent to other processes; says why."""


@dataclass(frozen=True)
class Permit:
    """To work: it holds as long as a file is there. On another machine, where the file cannot be seen, it holds."""

    machine: str
    file: str

    def holds(self) -> bool:
        return self.machine != platform.node() or os.path.exists(self.file)


@contextmanager
def permit() -> Iterator[Permit]:
    """A permit that ends on leaving."""
    handle, file = tempfile.mkstemp(prefix="nhpocp-permit-")
    os.close(handle)
    try:
        yield Permit(platform.node(), file)
    finally:
        with suppress(OSError):
            os.unlink(file)


def processes(count: int | None = None, method: str | None = None) -> Executor:
    """So many processes, one for every core, begun by this ``method`` of multiprocessing, the system's own."""
    context = multiprocessing.get_context(method)
    return ProcessPoolExecutor(count or os.cpu_count(), mp_context=context, initializer=_begin_process)


@contextmanager
def own_executor(make: Callable[[], Executor]) -> Iterator[Executor]:
    """An executor for a while. What it has not begun is given up on leaving, and its processes have ended then."""
    executor = make()
    try:
        yield executor
    finally:
        with Interruption(patient=True):
            # what Python 3.14 has `kill_workers` for; there are none where work is done by threads
            started = list((getattr(executor, "_processes", None) or {}).values())
            executor.shutdown(wait=False, cancel_futures=True)
            until = time.monotonic() + GRACE
            for process in started:
                process.join(max(0.0, until - time.monotonic()))
            for process in started:
                process.kill()


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes and threads begun within it never hear Ctrl-C, not even before they can ignore it.

    Here it arrives afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which unblocks SIGINT in the thread that begins it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def packed(what: Any) -> bytes:
    """As bytes for other processes. Errors: `NotSentError`."""
    try:
        return pickle.dumps(what)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise _not_sent(error) from error


@lru_cache(maxsize=4)  # what is made for a system is kept beside it
def unpacked(payload: bytes) -> Any:
    """What was packed. Errors: `NotSentError`."""
    try:
        return pickle.loads(payload)
    except (pickle.UnpicklingError, AttributeError, ImportError) as error:
        raise _not_sent(error) from error


def _not_sent(error: Exception) -> NotSentError:
    return NotSentError(
        f"the problem cannot be sent to other processes ({error}); put its classes at the top of a module that can be "
        "imported"
    )


def submitted(executor: Executor, given: Permit, work: Callable[..., T], *arguments: Any) -> Future[T]:
    """Work handed to an executor; it begins, and goes on, while the permit holds."""
    return executor.submit(_permitted, given, work, *arguments)


def awaited(job: Future[T], interruption: Interruption) -> T:
    """What it has made of it. Ctrl-C ends the waiting as KeyboardInterrupt, whatever the worker does."""
    while not wait([job], timeout=OFTEN).done:
        interruption.check()
    return job.result()


def _permitted(given: Permit, work: Callable[..., T], *arguments: Any) -> T:
    _follow_parent(os.getpid())
    with while_wanted(given.holds):
        Interruption().check()
        return work(*arguments)


def _begin_process() -> None:
    """Of a pool of our own: Ctrl-C is the parent's to answer, and the end of the parent is the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    if sys.platform == "linux":  # in the middle of a long call too
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
    _follow_parent(os.getpid())


@cache  # for each process once
def _follow_parent(process: int) -> None:
    """Has a process of `multiprocessing` end with the one that started it."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
