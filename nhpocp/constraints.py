"""What a plan must respect, said once for every solver: bounds on named quantities along the path.

A quantity is any entry of a trajectory: a state block, an input, an output, or a margin (sigma_s, sigma_w).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.arrays import Array


@dataclass(frozen=True)
class Bound:
    """lower ≤ quantity ≤ upper at every time, componentwise; bounds broadcast over the quantity's components."""

    label: str  # as the problem file calls it: leg_length, leg_speed, control, clearance, state.position
    quantity: str  # the trajectory's name for it: leg_lengths, u, v, sigma_s, position
    lower: Any = -np.inf
    upper: Any = np.inf

    def excess(self, values: Array) -> Array:
        """How far values (k, …) stand outside, same shape; 0 inside."""
        return np.maximum(0.0, np.maximum(np.asarray(self.lower) - values, values - np.asarray(self.upper)))

    def scale(self) -> float:
        """The bound's own size, against which an excess counts as relative."""
        limits = np.concatenate([np.ravel(self.lower), np.ravel(self.upper)])
        sizes = [abs(float(x)) for x in limits if np.isfinite(x)]
        return max(sizes, default=0.0) or 1.0


@dataclass(frozen=True)
class BoundReport:
    """The worst place of one bound along a path."""

    bound: Bound
    worst: float  # excess in the quantity's own unit; 0 where the bound holds
    time: float
    component: tuple[int, ...]
    ok: bool

    def describe(self) -> str:
        index = "".join(f"[{i}]" for i in self.component)
        return f"{self.bound.label}{index} at t={self.time:.4g} outside by {self.worst:.3g}"

    def to_json(self) -> dict[str, Any]:
        return {"worst": self.worst, "ok": self.ok, "t": self.time, "component": list(self.component)}


def check_bounds(
    bounds: Sequence[Bound], times: Array, trajectory: Mapping[str, Array], relative_tolerance: float = 1e-3
) -> list[BoundReport]:
    """Every bound on every sample; a bound holds if its excess stays below ``relative_tolerance`` of its size."""
    reports = []
    for bound in bounds:
        excess = bound.excess(np.asarray(trajectory[bound.quantity]))
        excess = np.where(np.isnan(excess), np.inf, excess)
        place = np.unravel_index(int(np.argmax(excess)), excess.shape)
        worst = float(excess[place])
        component = tuple(int(i) for i in place[1:])
        reports.append(
            BoundReport(
                bound, worst, float(times[place[0]]), component, worst <= relative_tolerance * bound.scale()
            )
        )
    return reports
