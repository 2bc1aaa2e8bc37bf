#!/usr/bin/env python3
"""Least ∫|v|² over two harmonics by single shooting: 15 unknowns, IPOPT with L-BFGS; imports nothing of nhpocp.

The equations are those of rival_opti.py: 100 RK4 steps, folded; the cost is a quadratic form of the coefficients.
Measured and refused: no `expand` (1.6 times), a memory of 6 updates instead of 15 (1.35), six states (2), the exact
Hessian (3).
Run: .venv/bin/python scripts/rival_single_shooting.py [STEPS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from rival_opti import GOAL, START, rate

FIRST = np.array([[0, 0.5, 0, 0, 0], [0, 0.5, 0, 0, 0], [1, 0, 0.5, 0, 0]])  # the paper's Λ0
WEIGHTS = np.array([1, 0.5, 0.5, 0.5, 0.5])  # ∫φ²; the functions are orthogonal


def basis(t: np.ndarray) -> np.ndarray:
    """1, sin ωt, cos ωt, sin 2ωt, cos 2ωt, one below the other. [Paper] eq. (15)"""
    w = 2 * np.pi * t
    return np.array([np.ones_like(t), np.sin(w), np.cos(w), np.sin(2 * w), np.cos(2 * w)])


def step(f: ca.Function, h: float) -> ca.Function:
    """(x, Λ by columns, φ at the step's start, middle and end) ↦ x after the step."""
    x, vector, phi = ca.SX.sym("x", 12), ca.SX.sym("lambda", 15), ca.SX.sym("phi", 5, 3)
    v = ca.reshape(vector, 3, 5) @ phi
    k1 = f(x, v[:, 0])
    k2 = f(x + h / 2 * k1, v[:, 1])
    k3 = f(x + h / 2 * k2, v[:, 1])
    k4 = f(x + h * k3, v[:, 2])
    return ca.Function("step", [x, vector, phi], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


def end(vector: ca.MX, steps: int) -> ca.MX:
    """x(1) under Λ by columns, by folded steps."""
    t = np.arange(steps) / steps
    phi = np.stack([basis(t), basis(t + 0.5 / steps), basis(t + 1 / steps)], axis=2)  # 5 × steps × 3
    return step(rate(), 1 / steps).fold(steps)(START, ca.repmat(vector, 1, steps), phi.reshape(5, -1))


def build(steps: int = 100) -> Callable[[], tuple[float, np.ndarray]]:
    """The NLP, made once: a function that solves it from Λ0 and returns min ∫|v|² and Λ (3, 5)."""
    vector = ca.MX.sym("lambda", 15)
    last = end(vector, steps)
    relative = ca.reshape(last[3:], 3, 3) @ GOAL[3:].reshape(3, 3)
    residual = ca.vertcat(last[:3] - GOAL[:3], ca.inv_skew(relative - relative.T))
    nlp: dict[str, Any] = {"x": vector, "f": ca.dot(np.repeat(WEIGHTS, 3), vector**2), "g": residual}
    ipopt = {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}
    options: dict[str, Any] = {
        "print_time": False,
        "expand": True,
        "show_eval_warnings": False,
        "ipopt": {**ipopt, "limited_memory_max_history": 15},
    }
    solver = ca.nlpsol("solver", "ipopt", nlp, options)

    def solve() -> tuple[float, np.ndarray]:
        found = solver(x0=FIRST.ravel(order="F"), lbg=0, ubg=0)
        if not solver.stats()["success"]:
            raise RuntimeError(solver.stats()["return_status"])
        return float(found["f"]), np.array(found["x"]).reshape(3, 5, order="F")

    return solve


if __name__ == "__main__":
    print(f"{build(int(sys.argv[1]) if len(sys.argv) > 1 else 100)()[0]:.8f}")
