"""The ways to the end point and its Jacobian on the paper's task; `scripts/benchmark.py --only end-points` times them.

The peer is what most users write: the RK4 step folded, and `ca.jacobian` of that.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

import nhpocp
from nhpocp.calls import call
from nhpocp.flow.compiled.kernels import Compiled, Interpreted
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, EndPointMapFactory, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, Integrator, RungeKutta4
from nhpocp.flow.runge_kutta import runge_kutta_step
from nhpocp.systems.numeric import numeric_system

PROBLEM = nhpocp.load_problem(Path(__file__).parents[1] / "problems" / "paper.yaml")
Way = Callable[[np.ndarray], np.ndarray]  # Λ ↦ Jacobian


def plain(harmonics: int, steps: int) -> Way:
    """`ca.jacobian` of the folded step, all twelve rows; the tangent rows are taken from it untimed."""
    basis, times = nhpocp.Fourier(harmonics), np.linspace(0.0, 1.0, steps + 1)
    middles = 0.5 * (times[:-1] + times[1:])
    tables = np.stack([basis.table(t, 1.0) for t in (times[:-1], middles, times[1:])], axis=1)
    vector, start = ca.MX.sym("lambda", 3 * basis.size), ca.MX.sym("start", 12)
    controls = ca.reshape(vector, basis.size, 3).T @ ca.DM(tables.reshape(-1, basis.size).T)
    step = runge_kutta_step(numeric_system(PROBLEM.system).rate_function)
    end = step.fold(steps)(start, np.full((1, steps), 1.0 / steps), controls)
    function = ca.Function("plain", [start, vector], [end, ca.densify(ca.jacobian(end, vector))])
    return lambda coefficients: call(function, PROBLEM.start_point, coefficients.ravel())[1].T


def mapped(factory: EndPointMapFactory, integrator: Integrator, harmonics: int) -> Way:
    found = factory(PROBLEM.system, nhpocp.Fourier(harmonics), 1.0, PROBLEM.start_point, integrator)
    return lambda coefficients: found(coefficients).jacobian


def ways(harmonics: int, steps: int = 100) -> dict[str, Callable[[], Way]]:
    differentiated, variational = DifferentiatedEndPointMap, VariationalEndPointMap
    compiled, interpreted = RungeKutta4(steps, Compiled()), RungeKutta4(steps, Interpreted())
    return {
        "plain ca.jacobian": lambda: plain(harmonics, steps),
        "rk4, compiled": lambda: mapped(differentiated, compiled, harmonics),
        "rk4, interpreted": lambda: mapped(differentiated, interpreted, harmonics),
        "rk4, variational": lambda: mapped(variational, RungeKutta4(steps), harmonics),
        "rk": lambda: mapped(differentiated, CasadiRungeKutta(steps=steps), harmonics),
        "cvodes": lambda: mapped(differentiated, Cvodes(steps=steps), harmonics),
    }


def coefficients(harmonics: int) -> np.ndarray:
    return np.pad(PROBLEM.initial, ((0, 0), (0, 2 * (harmonics - 2))))
