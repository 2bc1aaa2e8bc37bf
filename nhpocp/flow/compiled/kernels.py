"""When a compiled kernel does the work: never, always, or once looking for one has paid. The answers are the same."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from time import perf_counter
from typing import TypeVar
from weakref import proxy

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constructed import Constructed
from nhpocp.flow.compiled import shot_source, sweep_source
from nhpocp.flow.compiled.c_functions import LANES, numbers_apart
from nhpocp.flow.compiled.kernel_cache import Place, Recipe, agree, nudged
from nhpocp.flow.compiled.shot_kernel import KernelShots, ShotKernel, tried
from nhpocp.flow.compiled.sweep_kernel import SweepKernel
from nhpocp.flow.runge_kutta import Bundle, Ends, Grid, Scheme, Sweep, Swept
from nhpocp.flow.shot import Shot, Shots
from nhpocp.kept import kept

TRIED_STEPS = 4  # of the first sweep, on which a kernel is tried
# times what a path began with: one that has met a pole and runs away tells nothing, for it multiplies what rounds there
AWAY = 1e9
SOLVE = 4.6e-6  # seconds that a solve takes, roughly, for each instruction (`Shot.length`) of each interval

K = TypeVar("K")
R = TypeVar("R")
Trial = Callable[[], tuple[Array, Array]]


class Kernels(Constructed):
    """How sweeps and the intervals of an NLP are evaluated; when by a kernel is for a subclass to say."""

    @abstractmethod
    def wanted(self, place: Place[K], recipe: Recipe[K], foreseen: float) -> K | None:
        """The kernel of a place if it is to be used; the work to come is foreseen to take that many seconds without."""

    def for_long_work(self) -> Kernels:
        """Whose turn it is where thousands of sweeps are sure to come, so that waiting for a kernel pays."""
        return self

    def swept(self, scheme: Scheme, sweep: Sweep) -> Swept:
        """What `Scheme.swept` gives."""
        recipe = _recipe(scheme, sweep.start, sweep.grid, sweep.coefficients)
        return self._done(_of_sweeps(scheme), recipe, lambda k: k.swept(sweep), lambda: scheme.swept(sweep))

    def bundled(self, scheme: Scheme, bundle: Bundle) -> Ends:
        """What `Scheme.bundled` gives."""
        recipe = _recipe(scheme, bundle.start, bundle.grid, bundle.coefficients[0])
        return self._done(
            _of_sweeps(scheme), recipe, lambda k: k.bundled(bundle), lambda: scheme.bundled(bundle)
        )

    def _done(
        self, place: Place[K], recipe: Recipe[K], compiled: Callable[[K], R], otherwise: Callable[[], R]
    ) -> R:
        """What the kernel of a place gives, or CasADi's evaluation, whose time is taken down."""
        kernel = self.wanted(place, recipe, 0.0)
        if kernel:
            return compiled(kernel)
        began = perf_counter()
        result = otherwise()
        place.note(perf_counter() - began)
        return result

    def shots(self, shot: Shot, intervals: int, trial: Trial) -> Shots:
        """The functions of so many intervals; ``trial`` gives variables and parameters (k, ·) to try a kernel on."""
        identity = shot_source.identity(shot)
        place = _of_shots(sha256(identity.encode()).digest())
        recipe = Recipe(
            lambda: identity,
            lambda: shot_source.c_source(shot),
            ShotKernel,
            lambda kernel: tried(kernel, shot, *trial()),
        )
        kernel = self.wanted(place, recipe, SOLVE * intervals * shot.length)
        return KernelShots(kernel, shot, intervals) if kernel else shot.interpreted(intervals, place.note)


@dataclass(frozen=True)
class Interpreted(Kernels):
    """By CasADi's own evaluation, always."""

    def wanted(self, place: Place[K], recipe: Recipe[K], foreseen: float) -> K | None:
        return None


@dataclass(frozen=True)
class Compiled(Kernels):
    """By a kernel, which is built first if there is none yet: a few seconds."""

    def wanted(self, place: Place[K], recipe: Recipe[K], foreseen: float) -> K | None:
        place.get(recipe)
        return place.kernel


@dataclass(frozen=True)
class CompiledWhenReady(Kernels):
    """By a kernel once looking for one is likely to pay.

    The cache is asked when CasADi's evaluation has cost ``patience`` seconds or is about to, as long as asking takes
    for a robot: all that a run can lose. What is not there is then built by a process of its own, at the lowest
    priority, and taken when later work finds it. NHPOCP_COMPILE=never in the environment switches this off.
    patience: in seconds [time of the clock]. Raises nothing: what cannot be compiled is evaluated by CasADi.
    """

    patience: float = 0.04

    def for_long_work(self) -> Kernels:
        return self if os.environ.get("NHPOCP_COMPILE") == "never" else Compiled()

    def wanted(self, place: Place[K], recipe: Recipe[K], foreseen: float) -> K | None:
        due = place.untried and place.seconds + foreseen > self.patience
        if due and os.environ.get("NHPOCP_COMPILE") != "never":
            place.look(recipe, self.patience)
        return place.kernel


def _recipe(scheme: Scheme, start: Array, grid: Grid, coefficients: Array) -> Recipe[SweepKernel]:
    """Of the kernel of sweeps, tried on short ones, abreast and alone, under controls near the given one."""

    def agrees(kernel: SweepKernel) -> bool | None:
        trial = Bundle.trial(start, grid.first(TRIED_STEPS), coefficients, LANES + 1)
        nearby = trial._replace(start=nudged(trial.start), coefficients=nudged(trial.coefficients))
        expected = scheme.bundled(trial)
        told = agree(kernel.bundled(trial), expected, scheme.bundled(nearby))
        away = not np.abs(expected.states).max() < AWAY * (1.0 + np.abs(start).max())
        return told or (None if away else told)

    return Recipe(
        lambda: _shared(scheme)[0],
        lambda: _shared(scheme)[0],
        lambda path: SweepKernel(proxy(scheme), path, _shared(scheme)[1]),  # it is kept with the scheme
        agrees,
    )


@kept(most=4)  # for the moment
def _shared(scheme: Scheme) -> tuple[str, Array]:
    return numbers_apart(sweep_source.c_source(scheme))


@kept(most=64)
def _of_sweeps(scheme: Scheme) -> Place[SweepKernel]:
    return Place()


@lru_cache(maxsize=64)  # of no owner: shots of many problems, and of any number of steps, have one C text
def _of_shots(digest: bytes) -> Place[ShotKernel]:
    return Place()
