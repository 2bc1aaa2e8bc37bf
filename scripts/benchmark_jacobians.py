#!/usr/bin/env python3
"""Times the ways to the end point and its Jacobian against each other on the paper's task.

The peer is what most users write: the RK4 step folded, and `ca.jacobian` of that. Interleaved rounds, in each of which
a way is called for a hundredth of a second; medians and ratios to the peer, since absolute times mean little on a
shared machine. Then how the own ways grow with the number of harmonics and of steps.
Run: .venv/bin/python scripts/benchmark_jacobians.py [ROUNDS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import casadi as ca
import numpy as np
from measuring import seconds

import nhpocp
from nhpocp.calls import call
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, EndPointMapFactory, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, Integrator, RungeKutta4
from nhpocp.flow.kernels import Compiled, Interpreted
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


def compare(harmonics: int, rounds: int) -> None:
    """All ways with one number of harmonics, 100 steps."""
    print(f"{harmonics} harmonics, 100 steps, {rounds} rounds")
    made, ready, given = {}, {}, coefficients(harmonics)
    for name, make in ways(harmonics).items():
        began = perf_counter()
        made[name] = make()
        made[name](given)
        ready[name] = perf_counter() - began
    found = seconds({name: lambda way=way: way(given) for name, way in made.items()}, rounds)
    exact = made["rk4, interpreted"](given)
    for name, time in found.items():
        jacobian = made[name](given)
        off = np.abs(jacobian[:3] - exact[:3]).max() / np.abs(exact).max()  # of the position, which all have
        print(
            f"  {name:18} median {1e3 * time:8.3f} ms   1/{found['plain ca.jacobian'] / time:<6.3g} of plain"
            f"   ready in {ready[name]:.2f} s   Jacobian differs by {off:.1e}"
        )


def grow(rounds: int) -> None:
    """Time against the number of harmonics at 500 steps, and of steps at 2 harmonics, in one set of rounds."""
    cases = [(2, 500), (10, 500), (50, 500), (2, 100), (2, 200), (2, 400), (2, 800)]
    for kernels in (Compiled(), Interpreted()):
        runs = {}
        for harmonics, steps in cases:
            way = mapped(DifferentiatedEndPointMap, RungeKutta4(steps, kernels), harmonics)
            given = coefficients(harmonics)
            runs[f"h={harmonics:<3} N={steps}"] = lambda way=way, given=given: way(given)
        print(f"rk4, {type(kernels).__name__.lower()}, {rounds} rounds")
        for name, time in seconds(runs, rounds).items():
            print(f"  {name}  median {1e3 * time:8.3f} ms")


if __name__ == "__main__":
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    for number in (2, 10):
        compare(number, wanted)
    grow(wanted)
