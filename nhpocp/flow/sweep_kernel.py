"""The compiled sweep over all steps of an integrator, called with NumPy arrays."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from nhpocp.flow import kernel_source, runge_kutta
from nhpocp.flow.kernel_cache import address, identified
from nhpocp.flow.kernel_source import LANES
from nhpocp.flow.runge_kutta import Scheme, Sweep, Swept


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
        self._scheme, self._work = scheme, np.zeros(0)

    def swept(self, sweep: Sweep) -> Swept:
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
        watched = np.empty((steps + 1, scheme.watches))
        coefficients = np.array(sweep.coefficients, dtype=float, order="C")
        self._sweep(
            steps,
            address(sweep.h),
            address(sweep.nodes),
            count,
            size,
            address(sweep.table),
            address(coefficients),
            address(path),
            len(stops),
            address(stops),
            address(self._work),
            address(derivatives),
            address(watched),
        )
        derivatives = derivatives.transpose(0, 2, 3, 1).reshape(len(stops), scheme.rows, scheme.inputs * size)
        return Swept(path, derivatives, watched)
