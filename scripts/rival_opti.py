#!/usr/bin/env python3
"""The paper's task on `default` as a plain Opti script, the way the manual shows; imports nothing of nhpocp.

Twelve states, the rotation as nine of them; [Paper] eqs. (2) and (7) as printed; one RK4 step per interval; IPOPT as it
comes. `expand` costs seconds before the first solve and makes every solve a tenth shorter.
Run: .venv/bin/python scripts/rival_opti.py [INTERVALS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import cos, pi, radians, sin
from typing import Any

import casadi as ca
import numpy as np

A, B, BETA = 30.0, 15.0, radians(75)


def turn(yaw: float) -> np.ndarray:
    return np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])


# packed: position, then the rotation by columns
START = np.array([0, 0, 25, *turn(-pi / 6).T.ravel()])
GOAL = np.array([-0.4, -0.2, 35, *turn(-pi / 2).T.ravel()])


def rate() -> ca.Function:
    """(p, R), v ↦ the derivative. [Paper] eq. (7)"""
    x, v = ca.SX.sym("x", 12), ca.SX.sym("v", 3)
    p, rotation = x[:3], ca.reshape(x[3:], 3, 3)
    rows_s, rows_j = [], []
    for azimuth in (0, 2 * pi / 3, 4 * pi / 3):
        radial = ca.DM([cos(azimuth), sin(azimuth), 0])
        r = ca.DM([-sin(BETA) * sin(azimuth), sin(BETA) * cos(azimuth), cos(BETA)])
        b, w4 = p + rotation @ (B * radial), rotation @ radial
        length = ca.norm_2(b - A * radial)
        g = (b - A * radial) / length
        w3 = ca.cross(g, w4)
        w3 = w3 / ca.norm_2(w3)
        h = ca.cross(w3, w4)
        s = ca.cross(h, r) - ca.dot(g, ca.cross(h, r)) * g
        rows_s.append(s.T)
        rows_j.append((ca.cross(b - p, s) - length * ca.dot(r, g) * h).T)
    speed = ca.solve(ca.vertcat(*rows_s), ca.vertcat(*rows_j) @ v)
    return ca.Function("rate", [x, v], [ca.vertcat(speed, ca.vec(-ca.skew(v) @ rotation))])


def step(f: ca.Function, x: Any, v: Any, h: float) -> Any:
    k1 = f(x, v)
    k2 = f(x + h / 2 * k1, v)
    k3 = f(x + h / 2 * k2, v)
    k4 = f(x + h * k3, v)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def first_guess(intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """The paper's Λ0 at the intervals' middles, and the path it makes: states (12, intervals + 1), controls."""
    f, t = rate(), 2 * pi * (np.arange(intervals) + 0.5) / intervals
    controls = np.array([0.5 * np.sin(t), 0.5 * np.sin(t), 1 + 0.5 * np.cos(t)])
    states = [START]
    for v in controls.T:
        states.append(np.array(step(f, states[-1], v, 1 / intervals)).ravel())
    return np.array(states).T, controls


def build(intervals: int = 50, expand: bool = True) -> Callable[[], tuple[float, np.ndarray]]:
    """The NLP, made once: a function that solves it from the same guess and returns min ∫|v|² and v (3, intervals)."""
    opti, f, h = ca.Opti(), rate(), 1 / intervals
    states, controls = opti.variable(12, intervals + 1), opti.variable(3, intervals)
    opti.minimize(h * ca.sumsqr(controls))
    for k in range(intervals):
        opti.subject_to(states[:, k + 1] == step(f, states[:, k], controls[:, k], h))
    opti.subject_to(states[:, 0] == START)
    opti.subject_to(states[:3, -1] == GOAL[:3])
    # three equations for the last rotation: nine would depend on one another
    relative = ca.reshape(states[3:, -1], 3, 3) @ GOAL[3:].reshape(3, 3)
    opti.subject_to(ca.inv_skew(relative - relative.T) == 0)
    path, guess = first_guess(intervals)
    opti.set_initial(states, path)
    opti.set_initial(controls, guess)
    opti.solver(
        "ipopt",
        {"print_time": False, "expand": expand, "show_eval_warnings": False},
        {"print_level": 0, "sb": "yes"},
    )

    def solve() -> tuple[float, np.ndarray]:
        found = opti.solve()
        return float(found.value(opti.f)), np.array(found.value(controls))

    return solve


def solve(intervals: int = 50) -> tuple[float, np.ndarray]:
    """The quickest way to a single solve."""
    return build(intervals, expand=False)()


if __name__ == "__main__":
    print(f"{build(int(sys.argv[1]) if len(sys.argv) > 1 else 50)()[0]:.8f}")
