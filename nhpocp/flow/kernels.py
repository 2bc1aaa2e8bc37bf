"""Compiled kernels of the sweep over all steps: when to use one, where they are kept, what is done when one is odd.

A kernel is C code (`c_source`) built by the system's compiler and kept in the user's cache folder, under a name that is
a hash of all it depends on. Whatever goes wrong with it costs one line on standard error; the answers stay the same.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow import kernel_build
from nhpocp.flow.kernel_source import LANES, c_source
from nhpocp.flow.runge_kutta import Scheme, Sweep
from nhpocp.machine import c_compiler, compiler, processor

VERSION = 2  # of the C functions' arguments
CLOSE = 1e-9  # between a kernel and CasADi's own evaluation, relative to the largest number
TRIED_STEPS = 4  # of the first sweep, on which a kernel is tried
STALE = 600.0  # seconds after which a build counts as given up

_log = logging.getLogger("nhpocp")
_said: set[str] = set()


class Kernels(Protocol):
    """How a sweep is evaluated; the answers are the same."""

    def swept(self, scheme: Scheme, sweep: Sweep) -> tuple[Array, Array]:
        """The path (steps + 1, n) and the derivatives (stops, rows, m·size) that `Scheme.swept` gives."""
        ...


@dataclass(frozen=True)
class Interpreted:
    """By CasADi's own evaluation, always."""

    def swept(self, scheme: Scheme, sweep: Sweep) -> tuple[Array, Array]:
        return scheme.swept(sweep)


@dataclass(frozen=True)
class Compiled:
    """By a kernel, which is built first if there is none yet: a second or two."""

    def swept(self, scheme: Scheme, sweep: Sweep) -> tuple[Array, Array]:
        place = _place(scheme)
        if place.untried:
            stored = place.stored()
            place.take(sweep, stored if stored or not place.untried else place.built())
        return place.swept(sweep)


@dataclass(frozen=True)
class CompiledWhenReady:
    """By a kernel once looking for one has paid: no run is slower for it.

    The cache is asked when CasADi's evaluation has cost ``patience`` seconds, ten times as long as asking takes. What
    is not there is then built by a process of its own, at the lowest priority, and taken when a later sweep finds it.
    NHPOCP_COMPILE=never in the environment switches this off.
    """

    patience: float = 0.3

    def swept(self, scheme: Scheme, sweep: Sweep) -> tuple[Array, Array]:
        place = _place(scheme)
        if place.untried and place.seconds > self.patience and os.environ.get("NHPOCP_COMPILE") != "never":
            place.look(sweep, self.patience)
        return place.swept(sweep)


class _Place:
    """What a process knows of one scheme's kernel."""

    def __init__(self, scheme: Scheme) -> None:
        self.scheme = scheme
        self.seconds = 0.0  # that CasADi's evaluation has cost so far
        self.untried = True
        self._kernel: Kernel | None = None
        self._key, self._source, self._building = "", "", False

    def swept(self, sweep: Sweep) -> tuple[Array, Array]:
        if self._kernel:
            return self._kernel.swept(sweep)
        began = perf_counter()
        found = self.scheme.swept(sweep)
        self.seconds += perf_counter() - began
        return found

    def look(self, sweep: Sweep, patience: float) -> None:
        """Takes the stored kernel; where there is none, has it built and looks again after the same time."""
        stored = self.stored()
        if stored:
            self.take(sweep, stored)
        elif self.untried and not self._building:
            self._building = True
            self.begun()
        self.seconds -= patience

    def _names(self) -> bool:
        """Whether there is a source and a name for it; both are made once."""
        if not self._key and self.untried:
            if c_compiler() is None:
                self._give_up("no C compiler was found")
                return False
            try:
                self._source = c_source(self.scheme)
            except NotImplementedError as error:
                self._give_up(str(error))
                return False
            self._key = _key(self._source)
        return bool(self._key)

    def stored(self) -> Path | None:
        """The kernel in the cache, undamaged."""
        if not self._names():
            return None
        with suppress(OSError):
            for path in sorted(cache_folder().glob(f"{self._key}-*{kernel_build.SUFFIX}")):
                if kernel_build.digest(path.read_bytes()) == path.stem.rpartition("-")[2]:
                    return path
                notice(f"the kernel {path} is damaged and was removed")
                path.unlink()
        return None

    def built(self) -> Path | None:
        """The kernel, built now."""
        if not self._names():
            return None
        try:
            workshop = Path(tempfile.mkdtemp(prefix=".building-", dir=_made_folder()))
            (workshop / kernel_build.SOURCE).write_text(self._source, encoding="utf-8")
        except OSError as error:
            self._give_up(f"{cache_folder()} takes no kernels ({error.strerror})")
            return None
        said = kernel_build.build(workshop, self._key, str(c_compiler()))
        found = None if said else self.stored()
        if found is None:
            self._give_up(f"the C compiler failed ({said or 'its kernel has gone'})")
        return found

    def begun(self) -> None:
        """Has the kernel built by a process of its own, which may outlive this one; unless one is at it already."""
        with suppress(OSError):  # nobody asked for this kernel
            workshop = _made_folder() / f".building-{self._key}"
            if workshop.exists() and time.time() - workshop.stat().st_mtime > STALE:
                _removed(workshop)
            workshop.mkdir()
            (workshop / kernel_build.SOURCE).write_text(self._source, encoding="utf-8")
            subprocess.Popen(
                [sys.executable, "-I", "-S", kernel_build.__file__, workshop, self._key, str(c_compiler())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )

    def take(self, sweep: Sweep, path: Path | None) -> None:
        """Loads a kernel and uses it from now on, if it says what CasADi says."""
        if path is None:
            return
        self.untried = False
        try:
            kernel = Kernel(self.scheme, path)
        except (OSError, AttributeError) as error:
            self._give_up(f"the kernel {path} cannot be loaded ({error})")
            return
        trial = sweep.first(TRIED_STEPS)
        if _agree(kernel.swept(trial), self.scheme.swept(trial)):
            self._kernel = kernel
        else:
            with suppress(OSError):
                path.unlink()
            self._give_up(f"the kernel {path} disagrees with CasADi and was removed")

    def _give_up(self, why: str) -> None:
        self.untried = False
        notice(f"{why}: CasADi's own evaluation is used, slower")


class Kernel:
    """A loaded kernel. Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, scheme: Scheme, path: Path) -> None:
        library = ctypes.PyDLL(str(path))
        self._sweep = library.nhpocp_sweep
        self._sweep.restype = None
        self._sweep.argtypes = [
            ctypes.c_longlong if kind == "i" else ctypes.c_void_p for kind in "ippiipppippp"
        ]
        self._scheme, self._work = scheme, np.zeros(0)

    def swept(self, sweep: Sweep) -> tuple[Array, Array]:
        """As `Kernels.swept`."""
        scheme, steps, (count, size) = self._scheme, len(sweep.h), sweep.table.shape
        samples = LANES * -(-4 * steps // LANES)
        wanted = samples * (scheme.size + scheme.inputs + scheme.entries)
        wanted += count * scheme.inputs * (scheme.rows + 1)
        if self._work.size < wanted:
            self._work = np.zeros(wanted)
        path = np.empty((steps + 1, scheme.size))
        path[0] = sweep.start
        stops = np.array(sweep.stops, dtype=np.int64)
        derivatives = np.empty((len(stops), size, scheme.rows, scheme.inputs))
        coefficients = np.array(sweep.coefficients, dtype=float, order="C")
        self._sweep(
            steps,
            _address(sweep.h),
            _address(sweep.nodes),
            count,
            size,
            _address(sweep.table),
            _address(coefficients),
            _address(path),
            len(stops),
            _address(stops),
            _address(self._work),
            _address(derivatives),
        )
        return path, derivatives.transpose(0, 2, 3, 1).reshape(len(stops), scheme.rows, -1)


@lru_cache(maxsize=64)
def _place(scheme: Scheme) -> _Place:
    return _Place(scheme)


def _address(array: Array) -> int:
    return ctypes.addressof(ctypes.c_char.from_buffer(array))  # array.ctypes takes three times as long


def _agree(found: tuple[Array, Array], expected: tuple[Array, Array]) -> bool:
    with np.errstate(all="ignore"):
        return all(
            np.allclose(a, b, rtol=0.0, atol=CLOSE * np.nanmax(np.abs(b), initial=1e-300), equal_nan=True)
            for a, b in zip(found, expected, strict=True)
        )


def _key(source: str) -> str:
    """A hash of all that a kernel depends on: text and sizes, CasADi, compiler, flags, processor."""
    parts = (VERSION, source, ca.CasadiMeta.version(), compiler(), kernel_build.FLAGS, processor())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def notice(text: str) -> None:
    """One line on standard error, once."""
    if text not in _said:
        _said.add(text)
        _log.warning("nhpocp: %s", text)


def cache_folder() -> Path:
    """Where kernels are kept: NHPOCP_CACHE, or the user's cache folder."""
    given = os.environ.get("NHPOCP_CACHE")
    if given:
        return Path(given).expanduser()
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(home) if home else Path.home() / ".cache") / "nhpocp"


def _made_folder() -> Path:
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    return folder


def cached() -> dict[str, Any]:
    """The cache's folder, its number of kernels and their bytes."""
    sizes = []
    with suppress(OSError):
        sizes = [path.stat().st_size for path in cache_folder().glob(f"*-*{kernel_build.SUFFIX}")]
    return {"folder": str(cache_folder()), "kernels": len(sizes), "bytes": sum(sizes)}


def clear_cache() -> int:
    """Removes every kernel, and builds that were given up; their number."""
    kernels = list(cache_folder().glob(f"*-*{kernel_build.SUFFIX}"))
    for path in kernels:
        path.unlink(missing_ok=True)
    for workshop in cache_folder().glob(".building-*"):
        _removed(workshop)
    return len(kernels)


def _removed(workshop: Path) -> None:
    for path in workshop.iterdir():
        path.unlink(missing_ok=True)
    workshop.rmdir()
