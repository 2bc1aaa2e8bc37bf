"""Compiled sweeps over all steps of an integrator, called with NumPy arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.compiled.c_functions import LANES
from nhpocp.flow.compiled.library import Library, address
from nhpocp.flow.compiled.sweep_source import slots
from nhpocp.flow.runge_kutta import Bundle, Ends, Grid, Scheme, Sweep, Swept
from nhpocp.kept import kept


class SweepKernel:
    """The C text of `sweep_source`, loaded."""

    def __init__(self, scheme: Scheme, path: Path, numbers: Array) -> None:
        """numbers: of the scheme, which the text reads."""
        self._scheme, self._library = scheme, Library(path, "nhpocp_sweep", "piippippipppp")
        self._numbers = numbers

    def swept(self, sweep: Sweep) -> Swept:
        """As `Kernels.swept`."""
        (path,), (gathered,), (watched,) = self._gathered(
            sweep.start, sweep.grid, sweep.coefficients[None], sweep.stops
        )
        derivatives = np.array([sweep.grid.by_coefficients(part) for part in gathered])
        shape = len(sweep.stops), self._scheme.rows, sweep.coefficients.size
        return Swept(path, derivatives.reshape(shape), watched)

    def bundled(self, bundle: Bundle) -> Ends:
        """As `Kernels.bundled`."""
        coefficients = np.asarray(bundle.coefficients, dtype=float)
        paths, gathered, watched = self._gathered(bundle.start, bundle.grid, coefficients, bundle.stops)
        at_ends = gathered[:, 0] if bundle.stops else ()
        derivatives = np.array([bundle.grid.by_coefficients(part) for part in at_ends])
        shape = len(derivatives), self._scheme.rows, coefficients[0].size
        return Ends(paths[:, -1], derivatives.reshape(shape), watched[: len(derivatives)])

    def _gathered(
        self, start: Array, grid: Grid, coefficients: Array, stops: tuple[int, ...]
    ) -> tuple[Array, Array, Array]:
        """Of controls Λ (k, m, size): the paths, (k, steps + 1, n), and what is watched along them, (k, points, …).

        In between, what is gathered for each stop at the samples of the control, (k, stops, count, rows, m).
        """
        scheme, steps, count, k = self._scheme, len(grid.h), len(grid.samples), len(coefficients)
        _work, work_at = self._library.room(self._work(steps, k))
        h, nodes, _numbers, numbers_at = _placed(grid, stops)
        controls = np.ascontiguousarray(
            grid.samples.controls(coefficients.reshape(-1, coefficients.shape[2]))
        )
        if k > 1:
            controls = controls.reshape(count, k, scheme.inputs).swapaxes(0, 1).copy()
        paths = np.empty((k, steps + 1, scheme.size))
        paths[:, 0] = start
        gathered = np.empty((k, len(stops), count, scheme.rows, scheme.inputs))
        watched = np.empty((k, (steps + 1) * bool(stops), scheme.watches))
        grid_at, paths_at = (steps, h, nodes, count), (address(controls), address(paths))
        stops_at = len(stops), numbers_at, work_at, address(gathered), address(watched)
        self._library.call(address(self._numbers), k, *grid_at, *paths_at, *stops_at)
        return paths, gathered, watched

    def _work(self, steps: int, paths: int) -> int:
        """Numbers that so many steps of so many paths take to work in."""
        scheme = self._scheme
        samples = LANES * -(-slots(scheme) * steps // LANES)
        abreast = LANES if paths >= LANES else 1
        return samples * ((scheme.size + scheme.inputs) * abreast + scheme.entries)


@kept(most=256)  # asking takes as long as some steps do
def _placed(grid: Grid, stops: tuple[int, ...]) -> tuple[int, int, Array, int]:
    """Where the arrays of a grid are; the numbers of steps as the kernel reads them, and where they are."""
    numbers = np.array(stops, dtype=np.int64)
    return address(grid.h), address(grid.nodes), numbers, address(numbers)
