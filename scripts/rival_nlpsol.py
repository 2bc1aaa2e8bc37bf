#!/usr/bin/env python3
"""The paper's task on `default` as a specialist would write it by hand for `ca.nlpsol`; imports nothing of nhpocp.

Six states, the orientation as Rodrigues parameters about a fixed rotation half way; one RK4 step per interval as an SX
function, mapped and not expanded; rows of S and J as polynomials and Cramer's rule, [physics §6a]; x0, u0, x1, u1, ….
Run: .venv/bin/python scripts/rival_nlpsol.py [INTERVALS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import cos, pi, radians, sin
from typing import Any

import casadi as ca
import numpy as np

A, B, BETA = 30.0, 15.0, radians(75)
START, GOAL = ([0.0, 0.0, 25.0], -pi / 6), ([-0.4, -0.2, 35.0], -pi / 2)  # position, yaw
MIDDLE = (START[1] + GOAL[1]) / 2  # yaw of the rotation that the parameters count from
UNIT = 15.0  # lengths are counted in it; without, IPOPT needs 26 iterations in place of 17


def turn(yaw: float) -> ca.DM:
    return ca.DM([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])


def pose(position: list[float], yaw: float) -> np.ndarray:
    return np.array([*np.array(position) / UNIT, 0.0, 0.0, np.tan((yaw - MIDDLE) / 2)])


def rate() -> ca.Function:
    """(p, z), v ↦ the derivative: ṗ = S⁻¹ J v, ω = -v, ż = ½ (ω + ω×z + (z·ω) z)."""
    x, v = ca.SX.sym("x", 6), ca.SX.sym("v", 3)
    p, z = UNIT * x[:3], x[3:]
    square = ca.dot(z, z)
    rotation = ((1 - square) * ca.SX.eye(3) + 2 * z @ z.T + 2 * ca.skew(z)) / (1 + square) @ turn(MIDDLE)
    rows, right = [], []
    for azimuth in (0, 2 * pi / 3, 4 * pi / 3):
        radial = ca.DM([cos(azimuth), sin(azimuth), 0])
        r = ca.DM([-sin(BETA) * sin(azimuth), sin(BETA) * cos(azimuth), cos(BETA)])
        arm, w4 = rotation @ (B * radial), rotation @ radial
        span = p + arm - A * radial
        h = ca.cross(ca.cross(span, w4), w4)
        moment, length = ca.cross(h, r), ca.dot(span, span)
        s = length * moment - ca.dot(span, moment) * span
        rows.append(s)
        right.append(ca.dot(ca.cross(arm, s) - length * ca.dot(r, span) * h, v))
    c = [ca.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
    speed = (c[0] * right[0] + c[1] * right[1] + c[2] * right[2]) / ca.dot(rows[0], c[0])
    omega = -v
    spin = (omega + ca.cross(omega, z) + ca.dot(z, omega) * z) / 2
    return ca.Function("rate", [x, v], [ca.vertcat(speed / UNIT, spin)])


def step(intervals: int) -> ca.Function:
    f, h = rate(), 1 / intervals
    x, v = ca.SX.sym("x", 6), ca.SX.sym("v", 3)
    k1 = f(x, v)
    k2 = f(x + h / 2 * k1, v)
    k3 = f(x + h / 2 * k2, v)
    k4 = f(x + h * k3, v)
    return ca.Function("step", [x, v], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


def first_guess(walk: ca.Function, intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """The paper's Λ0 at the intervals' middles, and the path it makes."""
    t = 2 * pi * (np.arange(intervals) + 0.5) / intervals
    controls = np.array([0.5 * np.sin(t), 0.5 * np.sin(t), 1 + 0.5 * np.cos(t)])
    states = [pose(*START)]
    for control in controls.T:
        states.append(np.array(walk(states[-1], control)).ravel())
    return np.array(states), controls.T


def build(intervals: int = 50) -> Callable[[], tuple[float, np.ndarray]]:
    """The NLP, made once: a function that solves it from the same guess and returns min ∫|v|² and v (3, intervals)."""
    walk = step(intervals)
    w = ca.MX.sym("w", 9 * intervals + 6)
    stages = ca.reshape(w[: 9 * intervals], 9, intervals)
    after = ca.horzcat(stages[:6, 1:], w[9 * intervals :])
    gaps = after - walk.map(intervals)(stages[:6, :], stages[6:, :])
    nlp: dict[str, Any] = {"x": w, "f": ca.sumsqr(stages[6:, :]) / intervals, "g": ca.vec(gaps)}
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8, "constr_viol_tol": 1e-9},
    }
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    states, controls = first_guess(walk, intervals)
    start = np.concatenate([np.hstack([states[:-1], controls]).ravel(), states[-1]])
    lower, upper = np.full(w.numel(), -np.inf), np.full(w.numel(), np.inf)
    lower[:6] = upper[:6] = pose(*START)
    lower[-6:] = upper[-6:] = pose(*GOAL)

    def solve() -> tuple[float, np.ndarray]:
        found = solver(x0=start, lbx=lower, ubx=upper, lbg=0, ubg=0)
        if not solver.stats()["success"]:
            raise RuntimeError(solver.stats()["return_status"])
        return float(found["f"]), np.array(found["x"])[: 9 * intervals].reshape(intervals, 9)[:, 6:].T

    return solve


def solve(intervals: int = 50) -> tuple[float, np.ndarray]:
    """`build` and the first solve."""
    return build(intervals)()


if __name__ == "__main__":
    print(f"{build(int(sys.argv[1]) if len(sys.argv) > 1 else 50)()[0]:.8f}")
