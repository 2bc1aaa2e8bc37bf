"""How fast a machine may be: the least duration in which a path keeps its speeds and accelerations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.machine.export.planned_path import PlannedPath
from nhpocp.machine.export.time_scaling import Profile

POINTS = 2000  # of the whole path, at least `LEAST` of each smooth piece
LEAST = 9
ZOOMS, ZOOMED = 3, 41  # times that the neighbourhood of a peak is looked at again, at so many points
JUMP = 1e-9  # of the greatest speed
BATCH = 50_000  # points at once


@dataclass(frozen=True)
class Peaks:
    """The greatest speed × D and acceleration × D² of any motor, whatever the duration D.

    jump: the plan's time of the first jump of a speed, at which no acceleration is finite, its ends included; None
    without any.
    """

    speed: float
    acceleration: float
    jump: float | None

    def least_duration(self, max_speed: float | None, max_acceleration: float | None) -> float:
        """The least D [time] that keeps both; 0 where nothing is asked for, infinite where a jump forbids it."""
        by_speed = self.speed / max_speed if max_speed else 0.0
        by_acceleration = np.sqrt(self.acceleration / max_acceleration) if max_acceleration else 0.0
        if max_acceleration and self.jump is not None:
            return float("inf")
        return float(max(by_speed, by_acceleration))


def find_peaks(path: PlannedPath, profile: Profile) -> Peaks:
    """Of the motors' speeds q̇ τ' and accelerations q̈ τ'² + q̇ τ'' over the whole path, between samples too."""
    ends = np.concatenate([[0.0], path.control.breakpoints, [path.horizon]])
    borders = profile.inverse(ends / path.horizon)
    count = max(LEAST, POINTS // (len(borders) - 1))
    shares = np.linspace(borders[:-1], borders[1:], count, axis=1)  # pieces × points
    greatest = np.zeros(2)
    near, within = np.zeros((2, 2)), np.zeros((2, 2))  # shares beside each peak, and the ends of its piece
    step = max(1, BATCH // count)
    for first in range(0, len(shares), step):
        rows, limits = shares[first : first + step], ends[first : first + step + 1]
        for which, sizes in enumerate(_sizes(path, profile, rows, limits)):
            piece, point = divmod(int(np.argmax(sizes)), count)
            if sizes[piece, point] > greatest[which]:
                greatest[which] = sizes[piece, point]
                near[which] = rows[piece][[max(point - 1, 0), min(point + 1, count - 1)]]
                within[which] = limits[piece : piece + 2]
    for which in (k for k in range(2) if greatest[k] > 0):
        greatest[which] = max(greatest[which], _zoomed(path, profile, which, near[which], within[which]))
    jump = _first_jump(path, profile, ends, borders, JUMP * greatest[0])
    return Peaks(float(greatest[0]), float(greatest[1]), jump)


def _first_jump(
    path: PlannedPath, profile: Profile, times: Array, shares: Array, allowed: float
) -> float | None:
    """Where the speeds from rest to rest jump first, at one of the plan's times; None where nowhere."""
    slopes = path.horizon * profile.slope(shares)[:, None]
    before = path.drives(times, np.ones(len(times), dtype=bool))[0] * slopes
    after = path.drives(times)[0] * slopes
    before[0], after[-1] = 0.0, 0.0
    jumps = np.flatnonzero(np.abs(after - before).max(axis=1) > allowed)
    return float(times[jumps[0]]) if len(jumps) else None


def _sizes(path: PlannedPath, profile: Profile, shares: Array, ends: Array) -> tuple[Array, Array]:
    """The greatest |q̇ T p'| and |q̈ (T p')² + q̇ T p''| of any motor at shares (pieces, k), (pieces, k) each."""
    times = np.clip(path.horizon * profile.value(shares), ends[:-1, None], ends[1:, None])
    before = (times == ends[1:, None]).ravel()
    speeds, rates = path.drives(times.ravel(), before)
    slopes = path.horizon * profile.slope(shares).reshape(-1, 1)
    curvatures = path.horizon * profile.curvature(shares).reshape(-1, 1)
    both = speeds * slopes, rates * slopes**2 + speeds * curvatures
    of_speed, of_acceleration = (np.abs(each).max(axis=1).reshape(shares.shape) for each in both)
    return of_speed, of_acceleration


def _zoomed(path: PlannedPath, profile: Profile, which: int, near: Array, ends: Array) -> float:
    """The peak between two neighbours of the greatest sample, within one smooth piece."""
    (low, high), greatest = near, 0.0
    for _ in range(ZOOMS):
        shares = np.linspace(low, high, ZOOMED)
        sizes = _sizes(path, profile, shares[None], ends)[which][0]
        place = int(np.argmax(sizes))
        greatest = max(greatest, float(sizes[place]))
        low, high = shares[max(place - 1, 0)], shares[min(place + 1, ZOOMED - 1)]
    return greatest
