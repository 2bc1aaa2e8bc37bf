#!/usr/bin/env python3
"""The paper's task on `default` as a plain Opti script, the way the manual shows; imports nothing of nhpocp.

Twelve states, the rotation as nine of them; [Paper] eqs. (2) and (7) as printed; one RK4 step per interval; IPOPT as it
comes. Run: .venv/bin/python scripts/rival_opti.py [INTERVALS]
"""

from __future__ import annotations

import sys
from math import cos, pi, radians, sin

import casadi as ca
import numpy as np

A, B, BETA = 30.0, 15.0, radians(75)


def turn(yaw: float) -> np.ndarray:
    return np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])


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


def step(f: ca.Function, x: ca.MX, v: ca.MX, h: float) -> ca.MX:
    k1 = f(x, v)
    k2 = f(x + h / 2 * k1, v)
    k3 = f(x + h / 2 * k2, v)
    k4 = f(x + h * k3, v)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def solve(intervals: int = 50) -> tuple[float, ca.Opti]:
    """The least ∫|v|²."""
    opti, f, h = ca.Opti(), rate(), 1 / intervals
    states, controls = opti.variable(12, intervals + 1), opti.variable(3, intervals)
    opti.minimize(h * ca.sumsqr(controls))
    for k in range(intervals):
        opti.subject_to(states[:, k + 1] == step(f, states[:, k], controls[:, k], h))
    opti.subject_to(states[:, 0] == ca.vertcat(0, 0, 25, turn(-pi / 6).ravel(order="F")))
    opti.subject_to(states[:3, -1] == ca.vertcat(-0.4, -0.2, 35))
    # three equations for the last rotation: nine would depend on one another
    relative = ca.reshape(states[3:, -1], 3, 3) @ turn(-pi / 2).T
    opti.subject_to(ca.inv_skew(relative - relative.T) == 0)
    x = np.concatenate([[0, 0, 25], turn(-pi / 6).ravel(order="F")])
    for k in range(intervals):
        t = 2 * pi * (k + 0.5) / intervals
        v = np.array([0.5 * sin(t), 0.5 * sin(t), 1 + 0.5 * cos(t)])  # the paper's Λ0
        opti.set_initial(states[:, k], x)
        opti.set_initial(controls[:, k], v)
        x = np.array(step(f, x, v, h)).ravel()
    opti.set_initial(states[:, -1], x)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    return float(opti.solve().value(opti.f)), opti


if __name__ == "__main__":
    print(f"{solve(int(sys.argv[1]) if len(sys.argv) > 1 else 50)[0]:.8f}")
