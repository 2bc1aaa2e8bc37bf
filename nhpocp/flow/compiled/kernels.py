"""When a compiled kernel does the work: never, always, or once looking for one has paid. The answers are the same."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from time import perf_counter
from typing import Protocol, TypeVar
from weakref import proxy, ref

from nhpocp.arrays import Array
from nhpocp.flow.compiled import bundle_kernel, bundle_source, shot_source, sweep_kernel, sweep_source
from nhpocp.flow.compiled.bundle_kernel import BundleKernel
from nhpocp.flow.compiled.kernel_cache import Place, agree, nudged
from nhpocp.flow.compiled.shot_kernel import KernelShots, ShotKernel, identity, tried
from nhpocp.flow.compiled.sweep_kernel import SweepKernel
from nhpocp.flow.compiled.sweep_source import LANES
from nhpocp.flow.runge_kutta import Bundle, Ends, Scheme, Sweep, Swept, ends_of
from nhpocp.flow.shot import Shot, Shots
from nhpocp.kept import kept

TRIED_STEPS = 4  # of the first sweep, on which a kernel is tried
SOLVE = 4.6e-6  # seconds that a solve takes, roughly, for each instruction (`Shot.length`) of each interval

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T", Sweep, Bundle)
Trial = Callable[[], tuple[Array, Array]]


class Kernels(Protocol):
    """How a sweep, the ends of many, or the intervals of an NLP, are evaluated."""

    def swept(self, scheme: Scheme, sweep: Sweep) -> Swept:
        """What `Scheme.swept` gives."""
        ...

    def bundled(self, scheme: Scheme, bundle: Bundle) -> Ends:
        """What `Scheme.bundled` gives."""
        ...

    def shots(self, shot: Shot, intervals: int, trial: Trial) -> Shots:
        """The functions of so many intervals; ``trial`` gives variables and parameters (k, ·) to try a kernel on."""
        ...


class _Way(ABC):
    """All kinds of work, for one answer to when a kernel is wanted."""

    @abstractmethod
    def wanted(self, place: Place[K], agrees: Callable[[K], bool], foreseen: float) -> K | None:
        """The kernel of a place if it is to be used; the work to come is foreseen to take that many seconds without."""

    def swept(self, scheme: Scheme, sweep: Sweep) -> Swept:
        def agrees(kernel: SweepKernel) -> bool:
            trial = sweep.trial(TRIED_STEPS)
            return agree(kernel.swept(trial), scheme.swept(trial), scheme.swept(_nudged(trial)))

        return self._done(_of_sweeps(scheme), agrees, lambda k: k.swept(sweep), lambda: scheme.swept(sweep))

    def bundled(self, scheme: Scheme, bundle: Bundle) -> Ends:
        def agrees(kernel: BundleKernel) -> bool:
            trial = bundle.trial(LANES + 1, TRIED_STEPS)
            return agree(kernel.bundled(trial), scheme.bundled(trial), scheme.bundled(_nudged(trial)))

        def one_by_one() -> Ends:
            return ends_of([self.swept(scheme, sweep) for sweep in bundle.sweeps()])

        return self._done(_of_bundles(scheme), agrees, lambda k: k.bundled(bundle), one_by_one)

    def _done(
        self,
        place: Place[K],
        agrees: Callable[[K], bool],
        compiled: Callable[[K], R],
        otherwise: Callable[[], R],
    ) -> R:
        """What the kernel of a place gives, or CasADi's evaluation, whose time is taken down."""
        kernel = self.wanted(place, agrees, 0.0)
        if kernel:
            return compiled(kernel)
        began = perf_counter()
        found = otherwise()
        place.note(perf_counter() - began)
        return found

    def shots(self, shot: Shot, intervals: int, trial: Trial) -> Shots:
        place = _of_shots(sha256(identity(shot).encode()).digest())
        place.shot = ref(shot)
        foreseen = SOLVE * intervals * shot.length
        kernel = self.wanted(place, lambda kernel: tried(kernel, shot, *trial()), foreseen)
        return KernelShots(kernel, shot, intervals) if kernel else shot.interpreted(intervals, place.note)


@dataclass(frozen=True)
class Interpreted(_Way):
    """By CasADi's own evaluation, always."""

    def wanted(self, place: Place[K], agrees: Callable[[K], bool], foreseen: float) -> K | None:
        return None


@dataclass(frozen=True)
class Compiled(_Way):
    """By a kernel, which is built first if there is none yet: a few seconds."""

    def wanted(self, place: Place[K], agrees: Callable[[K], bool], foreseen: float) -> K | None:
        place.get(agrees)
        return place.kernel


@dataclass(frozen=True)
class CompiledWhenReady(_Way):
    """By a kernel once looking for one is likely to pay.

    The cache is asked when CasADi's evaluation has cost ``patience`` seconds or is about to, some six times as long as
    asking takes, which is all that a run can lose. What is not there is then built by a process of its own, at the
    lowest priority, and taken when later work finds it. NHPOCP_COMPILE=never in the environment switches this off.
    """

    patience: float = 0.15

    def wanted(self, place: Place[K], agrees: Callable[[K], bool], foreseen: float) -> K | None:
        due = place.untried and place.seconds + foreseen > self.patience
        if due and os.environ.get("NHPOCP_COMPILE") != "never":
            place.look(agrees, self.patience)
        return place.kernel


def _nudged(trial: T) -> T:
    """The same from a start and under controls that are `nudged`."""
    return trial._replace(start=nudged(trial.start), coefficients=nudged(trial.coefficients))


@kept(most=64)
def _of_sweeps(scheme: Scheme) -> Place[SweepKernel]:
    scheme = proxy(scheme)  # which this lies with
    return Place(
        lambda: sweep_kernel.identity(scheme),
        lambda: sweep_source.c_source(scheme),
        lambda path: SweepKernel(scheme, path),
    )


@kept(most=64)
def _of_bundles(scheme: Scheme) -> Place[BundleKernel]:
    scheme = proxy(scheme)
    return Place(
        lambda: bundle_kernel.identity(scheme),
        lambda: bundle_source.c_source(scheme),
        lambda path: BundleKernel(scheme, path),
    )


class _PlaceOfShots(Place[ShotKernel]):
    """One for all shots whose C text is the same, whatever their numbers of steps; it holds none of them."""

    shot: ref[Shot]  # the last that was asked for

    def __init__(self) -> None:
        super().__init__(
            lambda: identity(self._given()), lambda: shot_source.c_source(self._given()), ShotKernel
        )

    def _given(self) -> Shot:
        shot = self.shot()
        if shot is None:
            raise ReferenceError("a kernel is looked for while its shot is at hand")
        return shot


@lru_cache(maxsize=64)
def _of_shots(alike: bytes) -> _PlaceOfShots:
    return _PlaceOfShots()
