"""Ctrl-C taken at a safe place.

Python raises KeyboardInterrupt wherever it stands, also inside CasADi's wrappers, which answer with a SystemError or a
half-made result. Solvers and verification keep the signal and look at it between two evaluations.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class Interruption:
    """Within it the first Ctrl-C is only noted and the second raises at once; inert outside the main thread."""

    def __init__(self) -> None:
        self.noted = False
        self._before: Any = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.noted:
            raise KeyboardInterrupt
        self.noted = True

    def check(self) -> None:
        """Raises KeyboardInterrupt if one was noted."""
        if self.noted:
            raise KeyboardInterrupt
