#!/usr/bin/env python3
"""Algorithm (17) of the paper with γ = 1, the plain way; imports nothing of nhpocp.

`ca.jacobian` of 100 folded RK4 steps, in CasADi's own evaluation, and NumPy's `pinv`; the equations of rival_opti.py.
Run: .venv/bin/python scripts/rival_plain.py [STEPS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
from rival_opti import GOAL
from rival_single_shooting import FIRST, WEIGHTS, end

TOLERANCE, MOST = 1e-3, 500  # on |e|; updates


def logarithm(rotation: np.ndarray) -> np.ndarray:
    """The rotation vector, [Paper] eq. (8)."""
    w = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = np.linalg.norm(w)
    return w if sine < 1e-9 else w * np.arctan2(sine, 0.5 * (np.trace(rotation) - 1)) / sine


def build(steps: int = 100, gamma: float = 1.0) -> Callable[[], tuple[float, np.ndarray]]:
    """The Jacobian, made once: a function that runs (17) from Λ0 and returns ∫|v|² and Λ (3, 5)."""
    vector = ca.MX.sym("lambda", 15)
    last = end(vector, steps)
    evaluate = ca.Function("evaluate", [vector], [last, ca.jacobian(last, vector)])
    wanted = GOAL[3:].reshape(3, 3).T

    def error(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e and the rows of J that belong to it; ∂R Rᵀ as a vector, [Paper] eq. (10)."""
        x, by_vector = (np.array(found) for found in evaluate(coefficients))
        rotation = x[3:].reshape(3, 3).T
        turned = by_vector[3:].T.reshape(15, 3, 3).swapaxes(1, 2) @ rotation.T
        rows = np.vstack([by_vector[:3], turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]])
        return np.concatenate([x[:3, 0] - GOAL[:3], logarithm(rotation @ wanted.T)]), rows

    def solve() -> tuple[float, np.ndarray]:
        coefficients = FIRST.ravel(order="F")
        for _ in range(MOST):
            e, J = error(coefficients)
            if np.linalg.norm(e) <= TOLERANCE:
                found = coefficients.reshape(3, 5, order="F")
                return float(np.sum(WEIGHTS * found**2)), found
            coefficients = coefficients - gamma * np.linalg.pinv(J) @ e
        raise RuntimeError(f"E = {np.linalg.norm(e):.3g} after {MOST} updates")

    return solve


if __name__ == "__main__":
    print(f"{build(int(sys.argv[1]) if len(sys.argv) > 1 else 100)()[0]:.8f}")
