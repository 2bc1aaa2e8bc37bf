"""When a motion is where: t = τ(s), from the machine's time s to the plan's time t."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array


@dataclass(frozen=True)
class Profile:
    """p: [0, 1] → [0, 1], monotonic, with both derivatives; times are shares of the duration."""

    name: str
    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]

    def inverse(self, values: Array) -> Array:
        """Where p is `values`, by bisection."""
        low, high = np.zeros_like(values), np.ones_like(values)
        for _ in range(60):
            middle = 0.5 * (low + high)
            below = self.value(middle) < values
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(values >= 1.0, 1.0, np.where(values <= 0.0, 0.0, 0.5 * (low + high)))


PROFILES = {
    profile.name: profile
    for profile in (
        # least degree with p' = p'' = 0 at both ends
        Profile(
            "quintic",
            lambda z: z**3 * (10 - 15 * z + 6 * z**2),
            lambda z: 30 * z**2 * (1 - z) ** 2,
            lambda z: 60 * z * (1 - z) * (1 - 2 * z),
        ),
        Profile("linear", lambda z: 1.0 * z, np.ones_like, np.zeros_like),
    )
}


@dataclass(frozen=True)
class TimeScaling:
    """τ(s) = T p(s/D): the path of a plan of horizon T [time], run in the duration D [time].

    A driftless system ẋ = G(x) u follows the same path under u(τ(s)) τ'(s). With ' = d/ds and ˙ = d/dt a quantity q of
    the path has q' = q̇ τ' and q'' = q̈ τ'² + q̇ τ''.
    """

    profile: Profile
    horizon: float
    duration: float

    def __call__(self, times: Array) -> tuple[Array, Array, Array]:
        """τ, τ' and τ'' at times (k,) of the machine."""
        shares, speed = times / self.duration, self.horizon / self.duration
        p = self.profile
        plan = np.clip(self.horizon * p.value(shares), 0.0, self.horizon)
        return plan, speed * p.slope(shares), speed / self.duration * p.curvature(shares)
