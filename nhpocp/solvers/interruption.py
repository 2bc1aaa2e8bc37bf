"""Ctrl-C taken at a safe place.

Python raises KeyboardInterrupt wherever it stands, also inside CasADi's wrappers, which answer with a SystemError or a
half-made result. Solvers and verification keep the signal and look at it between two evaluations.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, ClassVar, Self

from nhpocp.errors import NhpocpError


class Interruption:
    """Within it the first Ctrl-C is only noted and the second raises at once; inert outside the main thread.

    Interruptions inside one another share what was noted: an inner one begins with the outer's signal, and the outer
    sees what arrived within the inner. While one of them is ``patient`` no signal raises.
    """

    _innermost: ClassVar[Interruption | None] = None

    def __init__(self, *, patient: bool = False) -> None:
        self.patient = patient
        self._root = self  # the outermost holds the handler, and counts for all
        self._outer: Interruption | None = None
        self._before: Any = None
        self._entered = self._raised = False
        self._signals = 0

    @property
    def noted(self) -> bool:
        """Whether a signal has arrived."""
        return self._root._signals > 0

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
        self._entered, Interruption._innermost = False, self._outer
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
        if self._raised and isinstance(error, Exception) and not isinstance(error, NhpocpError):
            raise KeyboardInterrupt from error  # what CasADi's wrappers made of it

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._signals += 1
        if self._signals > 1 and not self._any_patient():
            self._raised = True
            raise KeyboardInterrupt

    def _any_patient(self) -> bool:
        here: Interruption | None = Interruption._innermost or self
        while here is not None and not here.patient:
            here = here._outer
        return here is not None

    def check(self) -> None:
        """Raises KeyboardInterrupt if one was noted."""
        if self.noted:
            raise KeyboardInterrupt
