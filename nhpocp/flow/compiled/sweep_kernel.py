"""The compiled sweep over all steps of an integrator, called with NumPy arrays."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow import runge_kutta
from nhpocp.flow.compiled import sweep_source
from nhpocp.flow.compiled.kernel_cache import address, identified
from nhpocp.flow.compiled.sweep_source import LANES
from nhpocp.flow.runge_kutta import Grid, Scheme, Sweep, Swept


def identity(scheme: Scheme) -> str:
    """All that the C text depends on."""
    return identified(scheme.functions, (sweep_source, runge_kutta))


class SweepKernel:
    """A loaded kernel. Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, scheme: Scheme, path: Path) -> None:
        library = ctypes.PyDLL(str(path))
        self._sweep = library.nhpocp_sweep
        self._sweep.restype = None
        self._sweep.argtypes = [
            ctypes.c_longlong if kind == "i" else ctypes.c_void_p for kind in "ippippipppp"
        ]
        self._scheme, self._work = scheme, (np.zeros(0), 0)  # and where it is
        self._places: WeakKeyDictionary[Grid, tuple[int, int]] = WeakKeyDictionary()

    def swept(self, sweep: Sweep) -> Swept:
        """As `Kernels.swept`."""
        scheme, grid = self._scheme, sweep.grid
        steps, count, stops = len(grid.h), len(grid.samples), len(sweep.stops)
        points = (steps + 1) * bool(stops)  # that are watched
        _work, work_at = self._room(steps)  # held: another thread may ask for more meanwhile
        h, nodes = self._places.get(grid) or self._placed(grid)
        numbers, stops_at = _stops(sweep.stops)
        entries = count * scheme.rows * scheme.inputs
        first = (steps + 1) * scheme.size
        second = first + stops * entries
        found = np.empty(second + points * scheme.watches)
        found[: scheme.size] = sweep.start
        controls = np.ascontiguousarray(grid.samples.controls(sweep.coefficients))
        at = address(found)
        self._sweep(
            steps,
            h,
            nodes,
            count,
            address(controls),
            at,
            len(numbers),
            stops_at,
            work_at,
            at + 8 * first,
            at + 8 * second,
        )
        path, gathered, watched = found[:first], found[first:second], found[second:]
        derivatives = [
            sweep.by_coefficients(part) for part in gathered.reshape(stops, count, scheme.rows, scheme.inputs)
        ]
        shape = stops, scheme.rows, sweep.coefficients.size
        return Swept(
            path.reshape(steps + 1, scheme.size),
            np.reshape(derivatives, shape),
            watched.reshape(points, scheme.watches),
        )

    def _room(self, steps: int) -> tuple[Array, int]:
        """Memory for so many steps, and where it is."""
        scheme = self._scheme
        samples = LANES * -(-4 * steps // LANES)
        wanted = samples * (scheme.size + scheme.inputs + scheme.entries)
        if self._work[0].size < wanted:
            more = np.zeros(wanted)
            self._work = more, address(more)
        return self._work

    def _placed(self, grid: Grid) -> tuple[int, int]:
        """Where the arrays of a grid are: asking takes as long as some steps do."""
        found = self._places[grid] = address(grid.h), address(grid.nodes)
        return found


@lru_cache(maxsize=64)
def _stops(stops: tuple[int, ...]) -> tuple[Array, int]:
    """The numbers of steps as the kernel reads them, and where they are."""
    numbers = np.array(stops, dtype=np.int64)
    return numbers, address(numbers)
