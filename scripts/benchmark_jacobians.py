#!/usr/bin/env python3
"""Times the ways to the end point and its Jacobian against each other on the paper's task, with 2 and 10 harmonics.

Interleaved rounds, medians and ratios to the default, since absolute times mean little on a shared machine.
Run: .venv/bin/python scripts/benchmark_jacobians.py [ROUNDS]
"""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

import nhpocp
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, VariationalEndPointMap
from nhpocp.flow.integrators import CasadiRungeKutta, Cvodes, RungeKutta4

WAYS = {
    "rk4": (DifferentiatedEndPointMap, RungeKutta4()),
    "rk4, variational": (VariationalEndPointMap, RungeKutta4()),
    "rk": (DifferentiatedEndPointMap, CasadiRungeKutta()),
    "cvodes": (DifferentiatedEndPointMap, Cvodes()),
}


def main(rounds: int) -> None:
    problem = nhpocp.load_problem(Path(__file__).parents[1] / "problems" / "paper.yaml")
    for harmonics in (2, 10):
        print(f"{harmonics} harmonics, {rounds} rounds")
        coefficients = np.pad(problem.initial, ((0, 0), (0, 2 * (harmonics - 2))))
        compare(problem, nhpocp.Fourier(harmonics), coefficients, rounds)


def compare(
    problem: nhpocp.PlanningProblem, basis: nhpocp.Fourier, coefficients: np.ndarray, rounds: int
) -> None:
    maps, ready = {}, {}
    for name, (factory, integrator) in WAYS.items():
        began = perf_counter()
        maps[name] = factory(problem.system, basis, 1.0, problem.start_point, integrator)
        maps[name](coefficients)
        ready[name] = perf_counter() - began
    times: dict[str, list[float]] = {name: [] for name in WAYS}
    for _ in range(rounds):
        for name, end_point_map in maps.items():
            began = perf_counter()
            end_point_map(coefficients)
            times[name].append(perf_counter() - began)
    exact = maps["rk4"](coefficients).jacobian
    for name, found in times.items():
        off = np.abs(maps[name](coefficients).jacobian - exact).max() / np.abs(exact).max()
        print(
            f"  {name:18} median {1e3 * median(found):8.2f} ms   ratio {median(found) / median(times['rk4']):6.2f}   "
            f"ready in {ready[name]:.2f} s   Jacobian differs by {off:.1e}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9)
