#!/usr/bin/env python3
"""The paper's task on `default` for rockit-meco, with the equations of rival_opti.py; imports nothing of nhpocp.

Without `expand` a solve takes 2.7 times as long: the Hessian goes through every call of the integrator.
Run: .venv/bin/python scripts/rival_rockit.py [INTERVALS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
import rockit
from rival_opti import GOAL, START, first_guess, rate


def build(intervals: int = 50) -> Callable[[], tuple[float, np.ndarray]]:
    """The NLP, made once: a function that solves it from the same guess and returns min ∫|v|² and v (3, intervals)."""
    ocp = rockit.Ocp(T=1.0)
    state, control = ocp.state(12), ocp.control(3)
    ocp.set_der(state, rate()(state, control))
    ocp.add_objective(ocp.integral(ca.sumsqr(control)))
    ocp.subject_to(ocp.at_t0(state) == START)
    last = ocp.at_tf(state)
    ocp.subject_to(last[:3] == GOAL[:3])
    relative = ca.reshape(last[3:], 3, 3) @ GOAL[3:].reshape(3, 3)
    ocp.subject_to(ca.inv_skew(relative - relative.T) == 0)
    states, controls = first_guess(intervals)
    ocp.set_initial(state, states)
    ocp.set_initial(control, controls)
    options = {"print_time": False, "expand": True, "error_on_fail": True, "show_eval_warnings": False}
    ocp.solver("ipopt", {**options, "ipopt": {"print_level": 0, "sb": "yes"}})
    ocp.method(rockit.MultipleShooting(N=intervals, M=1, intg="rk"))

    def solve() -> tuple[float, np.ndarray]:
        found = ocp.solve()
        return float(found.value(ocp.objective)), found.sample(control, grid="control")[1][:-1].T

    return solve


if __name__ == "__main__":
    print(f"{build(int(sys.argv[1]) if len(sys.argv) > 1 else 50)()[0]:.8f}")
