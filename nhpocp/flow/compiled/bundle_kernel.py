"""The compiled ends of many paths, called with NumPy arrays."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow import runge_kutta
from nhpocp.flow.compiled import bundle_source, sweep_source
from nhpocp.flow.compiled.kernel_cache import address, identified
from nhpocp.flow.compiled.sweep_source import LANES
from nhpocp.flow.runge_kutta import Bundle, Ends, Scheme


def identity(scheme: Scheme) -> str:
    """All that the C text depends on."""
    return identified(scheme.functions, (bundle_source, sweep_source, runge_kutta))


class BundleKernel:
    """A loaded kernel. Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, scheme: Scheme, path: Path) -> None:
        library = ctypes.PyDLL(str(path))
        self._bundle = library.nhpocp_bundle
        self._bundle.restype = None
        self._bundle.argtypes = [
            ctypes.c_longlong if kind == "i" else ctypes.c_void_p for kind in "ippipippppp"
        ]
        self._scheme, self._work = scheme, np.zeros(0)

    def bundled(self, bundle: Bundle) -> Ends:
        """As `Kernels.bundled`."""
        scheme, grid, (number, inputs, size) = self._scheme, bundle.grid, bundle.coefficients.shape
        steps, count, groups = len(grid.h), len(grid.samples), -(-number // LANES)
        lanes = np.arange(groups * LANES)
        coefficients = np.asarray(bundle.coefficients, dtype=float).take(lanes, axis=0, mode="wrap")
        controls = grid.samples.controls(coefficients.reshape(-1, size))
        controls = controls.reshape(count, groups, LANES, inputs).transpose(1, 0, 3, 2)
        ends = np.empty((groups, scheme.size, LANES))
        more = groups * bundle.differentiated
        watched = np.empty((more, steps + 1, scheme.watches, LANES))
        gathered = np.empty((more, count, scheme.rows, inputs, LANES))
        start, work = np.array(bundle.start, dtype=float), self._room(steps)
        arrays = grid.h, grid.nodes, start, np.ascontiguousarray(controls), work, ends, watched, gathered
        h, nodes, *others = map(address, arrays)
        self._bundle(steps, h, nodes, count, others[0], groups, *others[1:])
        derivatives = [
            grid.samples.transposed(part.reshape(count, scheme.rows * inputs * LANES)) for part in gathered
        ]
        shape = more, size, scheme.rows, inputs, LANES
        by_lane = (
            ends.swapaxes(1, 2),
            np.reshape(derivatives, shape).transpose(0, 4, 2, 3, 1),
            watched.transpose(0, 3, 1, 2),
        )
        shapes = (scheme.size,), (scheme.rows, inputs * size), (steps + 1, scheme.watches)
        return Ends(
            *(
                array.reshape(len(array) * LANES, *shape)[:number]
                for array, shape in zip(by_lane, shapes, strict=True)
            )
        )

    def _room(self, steps: int) -> Array:
        """Memory for so many steps."""
        scheme = self._scheme
        wanted = LANES * (4 * steps * scheme.size + 3 * scheme.size * scheme.rows + 4 * scheme.entries)
        if self._work.size < wanted:
            self._work = np.zeros(wanted)
        return self._work
