"""An outside oracle: rockit-meco transcribes the task from a model written here, and finds the same optimum."""

from math import cos, pi, radians, sin

import casadi as ca
import numpy as np
import pytest

rockit = pytest.importorskip("rockit")

A, B, BETA = 30.0, 15.0, radians(75)


def turn(angle):
    return np.array([[cos(angle), -sin(angle), 0], [sin(angle), cos(angle), 0], [0, 0, 1]])


def velocity(p, rotation, v):
    """ṗ = S⁻¹ J v with the rows as the paper prints them. [Paper] eqs. (2), (7)"""
    rows_s, rows_j = [], []
    for azimuth in (0, 2 * pi / 3, 4 * pi / 3):
        radial, tangential = [cos(azimuth), sin(azimuth), 0], [-sin(azimuth), cos(azimuth), 0]
        r = ca.DM([sin(BETA) * t for t in tangential]) + ca.DM([0, 0, cos(BETA)])
        b, w4 = p + rotation @ (B * ca.DM(radial)), rotation @ ca.DM(radial)
        span = b - A * ca.DM(radial)
        length = ca.norm_2(span)
        g = span / length
        w3 = ca.cross(g, w4) / ca.norm_2(ca.cross(g, w4))
        h = ca.cross(w3, w4)
        s = ca.cross(h, r) - ca.dot(g, ca.cross(h, r)) * g
        rows_s.append(s.T)
        rows_j.append((ca.cross(b - p, s) - length * ca.dot(r, g) * h).T)
    return ca.solve(ca.vertcat(*rows_s), ca.vertcat(*rows_j) @ v)


def test_rockit_finds_the_same_optimum():
    intervals = 40
    x, v = ca.SX.sym("x", 12), ca.SX.sym("v", 3)
    rotation = ca.reshape(x[3:], 3, 3)
    rate = ca.vertcat(velocity(x[:3], rotation, v), ca.vec(-ca.skew(v) @ rotation))
    model = ca.Function("model", [x, v], [rate])
    ocp = rockit.Ocp(T=1.0)
    state, control = ocp.state(12), ocp.control(3)
    ocp.set_der(state, model(state, control))
    ocp.add_objective(ocp.integral(ca.sumsqr(control)))
    begin = np.concatenate([[0, 0, 25], turn(-pi / 6).ravel(order="F")])
    ocp.subject_to(ocp.at_t0(state) == begin)
    last = ocp.at_tf(state)
    ocp.subject_to(last[:3] == ca.DM([-0.4, -0.2, 35]))
    relative = ca.reshape(last[3:], 3, 3) @ turn(-pi / 2).T
    ocp.subject_to(ca.inv_skew(relative - relative.T) == 0)
    t = (np.arange(intervals) + 0.5) / intervals
    guess = np.array([0.5 * np.sin(2 * pi * t), 0.5 * np.sin(2 * pi * t), 1 + 0.5 * np.cos(2 * pi * t)])  # Λ0
    states = [begin]
    for u in guess.T:
        middle = states[-1] + 0.5 / intervals * np.array(model(states[-1], u)).ravel()
        states.append(states[-1] + np.array(model(middle, u)).ravel() / intervals)
    ocp.set_initial(control, guess)
    ocp.set_initial(state, np.array(states).T)
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}, "error_on_fail": True}
    ocp.solver("ipopt", options)
    ocp.method(rockit.MultipleShooting(N=intervals, M=1, intg="rk"))
    solution = ocp.solve()
    assert solution.value(ocp.objective) == pytest.approx(2.052478, rel=1e-5)
