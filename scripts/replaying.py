"""Where a control really leads: the paper's task on `default` integrated by SciPy at 1e-12; imports nothing of nhpocp.

[Paper] eqs. (2) and (7) leg by leg, as printed. A control is an array: Λ (3, 5) over two harmonics where ``harmonic``,
else v (3, intervals), constant on equal intervals, each of which is integrated by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, radians, sin

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

A, B, BETA = 30.0, 15.0, radians(75)
START, GOAL = ([0, 0, 25], -pi / 6), ([-0.4, -0.2, 35], -pi / 2)  # position, yaw
TOLERANCE = 1e-12  # relative and absolute


@dataclass(frozen=True)
class Replay:
    """Where a control leads and what it costs."""

    position: np.ndarray
    error: float  # E = |(p - p_d, log(R R_dᵀ))|
    effort: float  # ∫|v|²


def rate(p: np.ndarray, rotation: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ṗ = S⁻¹ J v and Ṙ = -[v] R."""
    rows_s, rows_j = [], []
    for azimuth in (0, 2 * pi / 3, 4 * pi / 3):
        radial = np.array([cos(azimuth), sin(azimuth), 0])
        r = np.array([-sin(BETA) * sin(azimuth), sin(BETA) * cos(azimuth), cos(BETA)])
        b, w4 = p + rotation @ (B * radial), rotation @ radial
        length = np.linalg.norm(b - A * radial)
        g = (b - A * radial) / length
        w3 = np.cross(g, w4) / np.linalg.norm(np.cross(g, w4))
        h = np.cross(w3, w4)
        s = np.cross(h, r) - (g @ np.cross(h, r)) * g
        rows_s.append(s)
        rows_j.append(np.cross(b - p, s) - length * (r @ g) * h)
    return np.linalg.solve(rows_s, np.array(rows_j) @ v), -np.cross(v, rotation.T).T


def constant(v: np.ndarray) -> Callable[[float], np.ndarray]:
    return lambda t: v


def pieces(control: np.ndarray, harmonic: bool) -> list[tuple[float, float, Callable[[float], np.ndarray]]]:
    """(from, to, v(t)) of every stretch on which a control is smooth."""
    if harmonic:

        def series(t: float) -> np.ndarray:
            w = 2 * pi * t
            return control @ np.array([1, sin(w), cos(w), sin(2 * w), cos(2 * w)])

        return [(0.0, 1.0, series)]
    times = np.linspace(0, 1, control.shape[1] + 1)
    return [(a, b, constant(v)) for a, b, v in zip(times[:-1], times[1:], control.T, strict=True)]


def replay(control: np.ndarray, harmonic: bool) -> Replay:
    """Integrates the motion and its cost."""
    y = np.concatenate([START[0], Rotation.from_euler("z", START[1]).as_matrix().ravel(), [0]])
    for begin, end, v in pieces(control, harmonic):

        def slope(t: float, y: np.ndarray, v: Callable[[float], np.ndarray] = v) -> np.ndarray:
            speed, turning = rate(y[:3], y[3:12].reshape(3, 3), v(t))
            return np.concatenate([speed, turning.ravel(), [v(t) @ v(t)]])

        found = solve_ivp(slope, (begin, end), y, method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
        if not found.success:
            raise RuntimeError(found.message)
        y = found.y[:, -1]
    relative = Rotation.from_matrix(y[3:12].reshape(3, 3)) * Rotation.from_euler("z", GOAL[1]).inv()
    error = np.concatenate([y[:3] - GOAL[0], relative.as_rotvec()])
    return Replay(y[:3], float(np.linalg.norm(error)), float(y[12]))
