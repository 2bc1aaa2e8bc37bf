"""Ctrl-C taken at a safe place.

Python raises KeyboardInterrupt wherever it stands, also inside CasADi's wrappers, which answer with a SystemError or a
half-made result. Solvers and verification keep the signal and look at it between two evaluations.
"""

from __future__ import annotations

import _thread
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType, TracebackType
from typing import Any, ClassVar, Self

from nhpocp.errors import NhpocpError

STOPPED = "Stopped by hand"  # the words for it
PATIENCE = 0.6  # seconds that a noted signal may wait for somebody to look at it
_wanted: ContextVar[Callable[[], bool] | None] = ContextVar("wanted", default=None)


class Interruption:
    """Within it the first Ctrl-C is only noted and the second raises at once; inert outside the main thread.

    What is noted and not answered within `PATIENCE` raises too, and so again: the build of a function or a long
    verification looks at nothing. Interruptions inside one another share what was noted: an inner one begins with the
    outer's signal, and the outer sees what arrived within the inner. No signal raises where one is ``patient``: the
    innermost that says so or the contrary counts.
    """

    _innermost: ClassVar[Interruption | None] = None

    def __init__(self, *, patient: bool | None = None) -> None:
        self.patient = patient
        self._root = self  # the outermost holds the handler, and counts for all
        self._outer: Interruption | None = None
        self._before: Any = None
        self._entered = self._raised = False
        self._signals = 0
        # of the thread that reminds: whether there is one, whether a signal is its own, and whether it is too late
        self._reminded = self._reminding = self._over = False
        self._lock = _thread.allocate_lock()

    @property
    def noted(self) -> bool:
        """Whether a signal has arrived, or what is worked for has been given up (`while_wanted`)."""
        wanted = _wanted.get()
        return self._root._signals > 0 or not (wanted is None or wanted())

    @property
    def insisted(self) -> bool:
        """Whether Ctrl-C was pressed more than once."""
        return self._root._signals > 1

    @property
    def outermost(self) -> bool:
        """Whether nobody outside will look at what was noted."""
        return self._root is self

    def __enter__(self) -> Self:
        if threading.current_thread() is not threading.main_thread():
            return self
        self._outer, self._entered = Interruption._innermost, True
        if self._outer is None:
            self._before = signal.signal(signal.SIGINT, self._note)
        else:
            self._root = self._outer._root
        Interruption._innermost = self
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if not self._entered:
            return
        if self._before is not None:
            self.patient = True
            with self._lock:
                self._over = True
        self._entered, Interruption._innermost = False, self._outer
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
        if self._root._raised and isinstance(error, Exception) and not isinstance(error, NhpocpError):
            raise KeyboardInterrupt from error  # what CasADi's wrappers made of it

    def _note(self, number: int, frame: FrameType | None) -> None:
        reminder, self._reminding = self._reminding, False
        self._signals += not reminder
        if not self._reminded:
            self._reminded = True
            # `threading` holds locks that a handler may not wait for
            _thread.start_new_thread(self._remind, ())
        if (reminder or self._signals > 1) and not self._is_patient():
            self._raised = True
            raise KeyboardInterrupt

    def _remind(self) -> None:
        """Signals again what nobody has answered."""
        while True:
            time.sleep(PATIENCE)
            with self._lock:
                if self._over:
                    return
                self._reminding = True
                if os.name == "posix":  # which wakes the main thread up, too
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
                else:
                    _thread.interrupt_main()

    def _is_patient(self) -> bool:
        here: Interruption | None = Interruption._innermost or self
        while here is not None and here.patient is None:
            here = here._outer
        return here is not None and bool(here.patient)

    def check(self) -> None:
        """Raises KeyboardInterrupt if one was noted."""
        if self.noted:
            raise KeyboardInterrupt


@contextmanager
def while_wanted(wanted: Callable[[], bool]) -> Iterator[None]:
    """Interruptions within it, of this thread, count as noted from when that says no."""
    token = _wanted.set(wanted)
    try:
        yield
    finally:
        _wanted.reset(token)


def _forget() -> None:
    """In a forked process: what the parent noted is none of its business."""
    here = Interruption._innermost
    if here is not None:
        Interruption._innermost = None
        signal.signal(signal.SIGINT, here._root._before)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
