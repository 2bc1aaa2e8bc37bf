"""The compiled sweep over all steps of an integrator, called with NumPy arrays."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow import kernel_source, runge_kutta
from nhpocp.flow.kernel_cache import address, identified
from nhpocp.flow.kernel_source import LANES
from nhpocp.flow.runge_kutta import Grid, Scheme, Sweep, Swept


def identity(scheme: Scheme) -> str:
    """All that the C text depends on."""
    return identified(scheme.functions, (kernel_source, runge_kutta))


class SweepKernel:
    """A loaded kernel. Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, scheme: Scheme, path: Path) -> None:
        library = ctypes.PyDLL(str(path))
        self._sweep = library.nhpocp_sweep
        self._sweep.restype = None
        self._sweep.argtypes = [
            ctypes.c_longlong if kind == "i" else ctypes.c_void_p for kind in "ippiipppipppp"
        ]
        self._scheme, self._work = scheme, (np.zeros(0), 0)  # and where it is
        self._places: WeakKeyDictionary[Grid, tuple[int, int, int]] = WeakKeyDictionary()

    def swept(self, sweep: Sweep) -> Swept:
        """As `Kernels.swept`."""
        scheme, grid = self._scheme, sweep.grid
        steps, (count, size) = len(grid.h), grid.table.shape
        points = (steps + 1) * bool(sweep.stops)  # that are watched
        _work, work_at = self._room(steps, count)  # held: another thread may ask for more meanwhile
        h, nodes, table = self._places.get(grid) or self._placed(grid)
        stops, stops_at = _stops(sweep.stops)
        entries = size * scheme.rows * scheme.inputs
        first = (steps + 1) * scheme.size
        second = first + len(stops) * entries
        found = np.empty(second + points * scheme.watches)
        found[: scheme.size] = sweep.start
        coefficients = np.array(sweep.coefficients, dtype=float, order="C")
        at = address(found)
        self._sweep(
            steps,
            h,
            nodes,
            count,
            size,
            table,
            address(coefficients),
            at,
            len(stops),
            stops_at,
            work_at,
            at + 8 * first,
            at + 8 * second,
        )
        path, derivatives, watched = found[:first], found[first:second], found[second:]
        derivatives = derivatives.reshape(len(stops), size, scheme.rows, scheme.inputs).transpose(0, 2, 3, 1)
        return Swept(
            path.reshape(steps + 1, scheme.size),
            derivatives.reshape(len(stops), scheme.rows, scheme.inputs * size),
            watched.reshape(points, scheme.watches),
        )

    def _room(self, steps: int, count: int) -> tuple[Array, int]:
        """Memory for so many steps and nodes, and where it is."""
        scheme = self._scheme
        samples = LANES * -(-4 * steps // LANES)
        wanted = samples * (scheme.size + scheme.inputs + scheme.entries)
        wanted += count * scheme.inputs * (scheme.rows + 1)
        if self._work[0].size < wanted:
            more = np.zeros(wanted)
            self._work = more, address(more)
        return self._work

    def _placed(self, grid: Grid) -> tuple[int, int, int]:
        """Where the arrays of a grid are: asking takes as long as some steps do."""
        found = self._places[grid] = address(grid.h), address(grid.nodes), address(grid.table)
        return found


@lru_cache(maxsize=64)
def _stops(stops: tuple[int, ...]) -> tuple[Array, int]:
    """The numbers of steps as the kernel reads them, and where they are."""
    numbers = np.array(stops, dtype=np.int64)
    return numbers, address(numbers)
