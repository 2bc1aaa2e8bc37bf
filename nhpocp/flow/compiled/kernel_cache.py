"""Where compiled kernels are kept, and what is done when one is odd: one policy for every kind of kernel.

A kernel is C code built by the system's compiler and kept in the user's cache folder, under a name that is a hash of
all it depends on. Whatever goes wrong with it costs one line on standard error; the answers stay the same.
"""

from __future__ import annotations

import hashlib
import logging
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.compiled import kernel_build, kernel_folder
from nhpocp.provenance import c_compiler, compiler, processor, without_compiler

# a fraction of the largest number, or of what a function is given: far above rounding, far below a mistake
CLOSE = 1e-9
WILD = 1e-4  # a fraction of the largest number, a hundred thousand times the nudge: of paths that run away
UNTOLD = 50  # in succession, on which a kernel cannot be tried, before it is given up

_log = logging.getLogger("nhpocp")
_said: set[str] = set()

K = TypeVar("K")


class NotCompilableError(Exception):
    """There can be no kernel of some functions; says why."""


class Recipe(NamedTuple, Generic[K]):
    """How a kernel is made of what asks for it."""

    identity: Callable[[], str]  # all that the C text depends on, or `NotCompilableError`
    source: Callable[[], str]  # that text, or `NotCompilableError`
    loaded: Callable[[Path], K]  # the kernel of a file, `OSError` or `AttributeError` where it is none
    agrees: Callable[[K], bool | None]  # whether it says what CasADi says; None where that cannot be told


class Place(Generic[K]):
    """What a process knows of one kernel."""

    def __init__(self) -> None:
        self.kernel: K | None = None
        self.seconds = 0.0  # that CasADi's evaluation has cost so far
        self.untried = True
        self._key, self._building, self._untold = "", False, 0

    def get(self, recipe: Recipe[K]) -> None:
        """Takes the kernel, which is built if there is none yet."""
        if self.untried:
            self._take(recipe, self._stored(recipe) or self._built(recipe))

    def look(self, recipe: Recipe[K], patience: float) -> None:
        """Takes the stored kernel; where there is none, has it built and looks again after that many seconds of work.

        What has cost nothing yet may never be asked for again, and is not built.
        """
        stored = self._stored(recipe)
        if stored:
            self._take(recipe, stored)
        elif self.untried and not self._building and self.seconds > 0:
            self._building = True
            self._begin(recipe)
        self.seconds -= patience

    def note(self, seconds: float) -> None:
        """Takes down what CasADi's evaluation has cost."""
        self.seconds += seconds

    def _named(self, recipe: Recipe[K]) -> bool:
        """Whether there is a name; it is made once."""
        if not self._key and self.untried:
            if not c_compiler():
                self._give_up(without_compiler())
                return False
            try:
                kernel_folder.our_folder()
            except OSError as error:
                self._give_up(f"there is no place for kernels ({error.strerror})")
                return False
            identity = self._said(recipe.identity)
            self._key = _key(identity) if identity else ""
        return bool(self._key)

    def _stored(self, recipe: Recipe[K]) -> Path | None:
        """The kernel in the cache, ours and undamaged; what is not is removed, or it would be met at every run."""
        if not self._named(recipe):
            return None
        with suppress(OSError):
            folder = kernel_folder.our_folder()
            for path in kernel_folder.kernels(folder, self._key) if folder else []:
                if not (fault := _fault(path)):
                    return path
                path.unlink()
                notice(f"the kernel {path} {fault} and was removed")
        return None

    def _said(self, text: Callable[[], str]) -> str:
        try:
            return text()
        except NotCompilableError as error:
            self._give_up(str(error))
            return ""

    def _built(self, recipe: Recipe[K]) -> Path | None:
        """The kernel, built now."""
        text = self._said(recipe.source) if self._named(recipe) else ""
        if not text:
            return None
        try:
            workshop = kernel_build.new_workshop(kernel_folder.made_folder(), text)
        except OSError as error:
            self._give_up(f"{kernel_folder.cache_folder()} takes no kernels ({error.strerror})")
            return None
        said = kernel_build.build(workshop, self._key, c_compiler())
        stored = None if said else self._stored(recipe)
        if stored is None:
            self._give_up(f"the C compiler failed ({said or 'its kernel has gone'})")
        return stored

    def _begin(self, recipe: Recipe[K]) -> None:
        """Has the kernel built by a process of its own, which may outlive this one; unless one is at it already."""
        with suppress(OSError):  # nobody asked for this kernel
            place = kernel_folder.made_folder() / f"{kernel_build.BUILDING}{self._key}"
            if kernel_build.busy(place):
                return
            kernel_folder.remove_workshop(place)  # given up
            text = self._said(recipe.source)
            if not text:
                return
            workshop = kernel_build.new_workshop(place.parent, text)
            command = [sys.executable, "-I", "-S", kernel_build.__file__]
            try:
                subprocess.Popen(
                    [*command, workshop, self._key, *c_compiler()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            except OSError:
                shutil.rmtree(workshop, ignore_errors=True)

    def _take(self, recipe: Recipe[K], path: Path | None) -> None:
        """Loads a kernel and uses it from now on, if it says what CasADi says."""
        if path is None:
            return
        self.untried = False
        try:
            kernel = recipe.loaded(path)
        except (OSError, AttributeError) as error:
            with suppress(OSError):
                path.unlink()
            self._give_up(f"the kernel {path} cannot be loaded and was removed ({error})")
            return
        agrees = recipe.agrees(kernel)
        if agrees:
            self.kernel = kernel
        elif agrees is None and self._untold < UNTOLD:
            self._untold, self.untried = self._untold + 1, True
        elif agrees is None:
            self._give_up(f"the kernel {path} cannot be tried on numbers that run away")
        else:
            with suppress(OSError):
                path.unlink()
            self._give_up(f"the kernel {path} disagrees with CasADi and was removed")

    def _give_up(self, why: str) -> None:
        self.untried = False
        notice(f"{why}: CasADi's own evaluation is used, slower")


def agree(compiled: Sequence[Array], expected: Sequence[Array], nearby: Sequence[Array]) -> bool | None:
    """Whether a kernel's numbers are CasADi's up to rounding; None where that cannot be told.

    It cannot where CasADi's overflow and theirs do otherwise, or where the nudge alone moves them as far as `WILD`.

    ``nearby``: CasADi's numbers where what it is given is `nudged`. Large terms that all but cancel, as in the gaps of
    a solved path, leave rounding that is large beside the result; it is small beside what the nudge makes of it.
    """
    triples = list(zip(compiled, expected, nearby, strict=True))
    with np.errstate(all="ignore"):
        close = all(
            np.allclose(a, b, rtol=0.0, atol=CLOSE * _largest(b) + _largest(c - b), equal_nan=True)
            for a, b, c in triples
        )
        wild = any(_largest(c - b) > WILD * _largest(b) for _, b, c in triples)
    # a sum in another order may be ∞ - ∞ where CasADi's is not
    told = not wild and all(np.isfinite(b).all() for b in (*expected, *nearby))
    return close or (False if told else None)


def _largest(numbers: Array) -> float:
    return float(np.max(np.abs(numbers), where=np.isfinite(numbers), initial=1e-300))


def nudged(numbers: Array) -> Array:
    """Each of them more or less by a fraction `CLOSE` of itself."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], np.shape(numbers))
    return np.asarray(numbers) * (1.0 + CLOSE * signs)


def _fault(path: Path) -> str:
    """What keeps a kernel's file from being used; "" where nothing does."""
    try:
        content = kernel_folder.content(path)
    except OSError as error:
        return f"is not used ({error.strerror})"
    sound = kernel_build.digest(content) == path.stem.rpartition("-")[2]
    return "" if sound else "is damaged"


def _key(identity: str) -> str:
    """A hash of all that a kernel depends on: text and sizes, CasADi, compiler, flags, processor."""
    parts = (identity, ca.CasadiMeta.version(), compiler(), kernel_build.FLAGS, processor())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def notice(text: str) -> None:
    """One line on standard error, once."""
    if text not in _said:
        _said.add(text)
        _log.warning("nhpocp: %s", text)
