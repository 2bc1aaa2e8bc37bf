"""The least squares of one run in one sweep back and one forth, however many samples it has.

Unknown are where the run began, how the lengths changed from each sample to the next, and the parameters θ. Seen from
the end, what the samples from one on add to the sum of squares is a square in that one's state and θ alone, once the
changes after it are chosen as well as can be: the recursion of Riccati, here on square roots, by QR. [Bell 1994]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf

from nhpocp.arrays import Array
from nhpocp.machine.calibration.leg_driven_steps import Linearised, Observed

TINY = 1e-13  # of the largest entry: pivots below it are none


@dataclass(frozen=True)
class Swept:
    """A run's sum of squares |ρ - R (δx₀, δθ)|² + |ρ_θ - R_θ δθ|², and what the best changes are.

    start_rows: [R | ρ] (d, d + n + 1); rest: [R_θ | ρ_θ] (≤ n, n + 1). gains: K (k - 1, m, d) by δx and by δθ
    (k - 1, m, n); forward: κ (k - 1, m); roots: (k - 1, m, m) with δw = κ - K δx - K_θ δθ + root · noise.
    """

    start_rows: Array
    rest: Array
    gains: Array
    gains_of_values: Array
    forward: Array
    roots: Array

    @property
    def _parts(self) -> tuple[Array, Array, Array]:
        d, columns = self.start_rows.shape
        return self.start_rows[:, :d], self.start_rows[:, d : columns - 1], self.start_rows[:, -1]

    def start(self, change: Array) -> Array:
        """The best δx₀ for a change δθ."""
        by_start, by_values, right = self._parts
        return solved(by_start, right - by_values @ change)

    def ways(self, steps: Linearised, change: Array) -> tuple[Array, Array]:
        """The best δx (k, d) and δw (k - 1, m) of the linear model, for a change δθ."""
        moved, turned = [self.start(change)], []
        for k in range(len(self.gains)):
            turned.append(self.forward[k] - self.gains[k] @ moved[k] - self.gains_of_values[k] @ change)
            ahead = steps.by_state[k] @ moved[k] + steps.by_change[k] @ turned[k]
            moved.append(ahead + steps.by_values[k] @ change + steps.defects[k])
        return np.array(moved), np.array(turned)

    def covariances(self, steps: Linearised, of_values: Array) -> Array:
        """Of (x_k, θ) at every sample, (k, d + n, d + n), for the covariance of θ by all runs (n, n)."""
        by_start, by_values, _ = self._parts
        d, n = len(by_start), len(of_values)
        inverse = solved(by_start, np.eye(d))
        along = -inverse @ by_values
        now = np.block(
            [
                [inverse @ inverse.T + along @ of_values @ along.T, along @ of_values],
                [of_values @ along.T, of_values],
            ]
        )
        every = [now]
        moved = np.eye(d + n)
        for k in range(len(self.gains)):
            by_change = steps.by_change[k]
            moved[:d, :d] = steps.by_state[k] - by_change @ self.gains[k]
            moved[:d, d:] = steps.by_values[k] - by_change @ self.gains_of_values[k]
            spread = by_change @ self.roots[k]
            now = moved @ now @ moved.T
            now[:d, :d] += spread @ spread.T
            every.append(now)
        return np.array(every)


def sweep(steps: Linearised, seen: Observed, at_start: Sequence[Array]) -> Swept:
    """The sweep back over whitened rows; ``at_start``: further ones of x₀ and θ, (residuals, by state, by values)."""
    d, m = steps.by_change.shape[1:]
    n, count = steps.by_values.shape[2], len(seen.residuals)
    measured = np.concatenate([seen.by_state, seen.by_values, seen.residuals[:, :, None]], axis=2)
    tops = np.empty((count - 1, m, m + d + n + 1))
    upper = np.triu(np.ones((d + n, d + n + 1)))
    rows = measured[-1]
    for k in range(count - 2, -1, -1):
        after = rows[:, :d]
        moved = np.empty((len(rows), m + d + n + 1))
        moved[:, :m] = after @ steps.by_change[k]
        moved[:, m : m + d] = after @ steps.by_state[k]
        moved[:, m + d : -1] = after @ steps.by_values[k] + rows[:, d:-1]
        moved[:, -1] = rows[:, -1] - after @ steps.defects[k]
        made: Array = dgeqrf(moved, overwrite_a=True)[0]  # NumPy's takes three times as long over its copies
        tops[k] = made[:m]
        rest = made[m : m + d + n, m:]
        rows = np.vstack([rest * upper[: len(rest)], measured[k]])
    if len(at_start[0]):
        residuals, by_state, by_values = at_start
        rows = np.vstack([rows, np.column_stack([by_state, by_values, residuals])])
    reduced: Array = np.linalg.qr(rows, mode="r")
    pivots = np.triu(tops[:, :, :m])
    known = np.concatenate([tops[:, :, m:], np.broadcast_to(np.eye(m), pivots.shape)], axis=2)
    try:
        found = np.linalg.solve(pivots, known)
    except np.linalg.LinAlgError:  # lengths so large that they say nothing of one another
        found = np.full(known.shape, np.nan)
    gains, of_values, forward, roots = np.split(found, [d, d + n, d + n + 1], axis=2)
    return Swept(reduced[:d], reduced[d : d + n, d:], gains, of_values, forward[:, :, 0], roots)


def solved(triangle: Array, right: Array) -> Array:
    """R⁻¹ b of an upper triangle; what no row sees stays at zero, and of what is not finite all is NaN."""
    if not np.isfinite(triangle).all():
        return np.full((triangle.shape[1], *right.shape[1:]), np.nan)
    pivots = np.abs(np.diag(triangle))
    if pivots.min(initial=np.inf) > TINY * pivots.max(initial=0.0):
        whole: Array = solve_triangular(triangle, right, check_finite=False)
        return whole
    least: Array = np.linalg.lstsq(triangle, right, rcond=TINY)[0]
    return least
