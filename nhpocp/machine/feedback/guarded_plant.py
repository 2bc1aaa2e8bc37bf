"""A plant as the steering sees it: whatever goes wrong with a machine is one error, and no machine is waited for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import NhpocpError, one_line
from nhpocp.machine.feedback.plant import Plant, TrialPlant
from nhpocp.systems.system import System

T = TypeVar("T")


class PlantError(NhpocpError):
    """A machine that failed, or did not answer in time."""


class GuardedPlant:
    """A `Plant` that raises `PlantError` for whatever another raises, and where that does not answer in time.

    patience: seconds of the clock that `measure` and `command` may take; `advance` may take them beside its own. None:
    they are waited for. What hangs is left to itself: Python ends no thread.
    """

    def __init__(self, plant: Plant, patience: float | None = None) -> None:
        self.plant, self.patience = plant, patience
        self._trial = plant if isinstance(plant, TrialPlant) and isinstance(plant.system, System) else None

    def measure(self) -> Mapping[str, Any]:
        return self._guarded("measure", self.plant.measure)

    def command(self, set_points: Array) -> None:
        self._guarded("command", lambda: self.plant.command(set_points))

    def advance(self, seconds: float) -> None:
        self._guarded("advance", lambda: self.plant.advance(seconds), seconds)

    @property
    def system(self) -> System | None:
        """Of a `TrialPlant`, with its own parameters; None of any other."""
        return self._trial.system if self._trial else None

    @property
    def point(self) -> Array | None:
        """Of a `TrialPlant`, the packed state (size,) as it is; None of any other."""
        trial = self._trial
        return self._guarded("point", lambda: np.array(trial.point, dtype=float)) if trial else None

    def _guarded(self, name: str, method: Callable[[], T], own: float = 0.0) -> T:
        try:
            return method() if self.patience is None else _within(self.patience + own, method)
        except Exception as error:  # a machine is anybody's code
            raise PlantError(f"{name}() raised {one_line(error)}") from error


def _within(seconds: float, method: Callable[[], T]) -> T:
    """What a method returns, or raises; `TimeoutError` after so long."""
    returned: list[T] = []
    raised: list[BaseException] = []

    def call() -> None:
        try:
            returned.append(method())
        except BaseException as error:  # noqa: BLE001 - it is raised where it was called
            raised.append(error)

    thread = threading.Thread(target=call, daemon=True)  # one that hangs shall not keep the program
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        raise TimeoutError(f"no answer after {seconds:g} s")
    if raised:
        raise raised[0]
    return returned[0]
