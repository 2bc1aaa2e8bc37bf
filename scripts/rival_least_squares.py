#!/usr/bin/env python3
"""The goal, nothing minimised, by SciPy's `least_squares` over `solve_ivp`, in NumPy alone; imports nothing of nhpocp.

Two harmonics. The Jacobian by differences: all sixteen motions are integrated as one system, so they share their steps
and the integrator's error cancels. Measured and refused: `solve_ivp` once a column, as `jac="2-point"` does (6 times),
`trf` (1.6), DOP853 or LSODA (1.1 to 1.5).
Run: .venv/bin/python scripts/rival_least_squares.py
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, radians, sin

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

A, B, BETA = 30.0, 15.0, radians(75)
AZIMUTHS = np.array([0, 2 * pi / 3, 4 * pi / 3])
RADIAL = np.column_stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)])
ROLLER = np.column_stack(
    [-np.sin(BETA) * np.sin(AZIMUTHS), np.sin(BETA) * np.cos(AZIMUTHS), np.full(3, cos(BETA))]
)
START, GOAL = ([0, 0, 25], -pi / 6), ([-0.4, -0.2, 35], -pi / 2)  # position, yaw
FIRST = np.array([[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])  # the paper's Λ0
WEIGHTS = np.array([1, 0.5, 0.5, 0.5, 0.5])  # ∫φ²
TOLERANCE, STEP = 1e-3, 1e-6  # on |e|; of the differences


def rate(p: np.ndarray, rotation: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ṗ and Ṙ of many motions (k, 3), (k, 3, 3). [Paper] eqs. (2), (7)"""
    w4 = RADIAL @ rotation.swapaxes(1, 2)  # k × legs × 3
    arm = B * w4
    span = p[:, None] + arm - A * RADIAL
    length = np.sqrt(np.einsum("kij,kij->ki", span, span))[..., None]
    g = span / length
    w3 = np.cross(g, w4)
    h = np.cross(w3, w4)  # the length of w3 cancels
    moment = np.cross(h, ROLLER)
    s = moment - np.einsum("kij,kij->ki", g, moment)[..., None] * g
    j = np.cross(arm, s) - length * np.einsum("ij,kij->ki", ROLLER, g)[..., None] * h
    speed = np.linalg.solve(s, j @ v[:, :, None])[..., 0]
    return speed, -np.cross(v[:, :, None], rotation, axis=1)


def basis(t: float) -> np.ndarray:
    w = 2 * pi * t
    return np.array([1, sin(w), cos(w), sin(2 * w), cos(2 * w)])


def ends(coefficients: np.ndarray) -> np.ndarray:
    """e of many controls (k, 15), as (k, 6)."""
    count, controls = len(coefficients), coefficients.reshape(-1, 3, 5)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        x = y.reshape(count, 12)
        speed, turning = rate(x[:, :3], x[:, 3:].reshape(-1, 3, 3), controls @ basis(t))
        return np.hstack([speed, turning.reshape(count, 9)]).ravel()

    start = np.concatenate([START[0], Rotation.from_euler("z", START[1]).as_matrix().ravel()])
    motion = solve_ivp(slope, (0, 1), np.tile(start, count), rtol=1e-6, atol=1e-6, t_eval=[1])
    last = motion.y[:, -1].reshape(count, 12)
    relative = Rotation.from_matrix(last[:, 3:].reshape(-1, 3, 3)) * Rotation.from_euler("z", GOAL[1]).inv()
    return np.hstack([last[:, :3] - GOAL[0], relative.as_rotvec()])


def build() -> Callable[[], tuple[float, np.ndarray]]:
    """A function that goes from Λ0 to the goal and returns ∫|v|² and Λ (3, 5)."""

    def residual(vector: np.ndarray) -> np.ndarray:
        return ends(vector[None])[0]

    def jacobian(vector: np.ndarray) -> np.ndarray:
        found = ends(np.vstack([vector, vector + STEP * np.eye(15)]))
        return (found[1:] - found[0]).T / STEP

    def enough(intermediate_result: OptimizeResult) -> None:
        if 2 * intermediate_result.cost <= TOLERANCE**2:
            raise StopIteration

    def solve() -> tuple[float, np.ndarray]:
        found = least_squares(residual, FIRST.ravel(), jacobian, method="dogbox", callback=enough)
        if 2 * found.cost > TOLERANCE**2:
            raise RuntimeError(found.message)
        coefficients = found.x.reshape(3, 5)
        return float(np.sum(WEIGHTS * coefficients**2)), coefficients

    return solve


if __name__ == "__main__":
    print(f"{build()()[0]:.8f}")
