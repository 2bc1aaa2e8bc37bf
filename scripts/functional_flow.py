#!/usr/bin/env python3
"""The continuation over piecewise-constant controls against the functional flow that it approximates.

[Paper] eq. (14) moves the control itself, dv/dθ(t) = -γ Bᵀ(t) Φᵀ(T, t) D⁻¹ e; over a basis and in the L² metric
(16) is its projection. Here (14) is worked out by itself, on samples of v, with Φ and D by adjoint equations, and both
take the same Euler steps from the paper's Λ₀. Prints how far apart they end and draws it.
Run: .venv/bin/python scripts/functional_flow.py [-o results/functional_flow.png]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from goals import paper_task

from nhpocp.calls import call, mapped
from nhpocp.controls.control import Control
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.variational import linearisation
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Euler
from nhpocp.solvers.metrics import L2Metric
from nhpocp.systems.numeric import numeric_system

GAMMA, UPDATES = 0.1, 30
STEPS = 320  # of the functional flow's own integration, two samples each
INTERVALS = (5, 10, 20, 40, 80, 160)


def functional_flow(problem: PlanningProblem, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Times (2 steps + 1,) and the control there (…, inputs) after `UPDATES` Euler steps of (14)."""
    times = np.linspace(0.0, problem.horizon.fixed, 2 * steps + 1)
    values = problem.control(problem.initial)(times)
    for _ in range(UPDATES):
        values = values + GAMMA * functional_direction(problem, times, values)
    return times, values


def functional_direction(problem: PlanningProblem, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """-BᵀΦᵀ(T, t) D⁻¹ e at the samples of a control, (k, inputs)."""
    system, task = problem.system, problem.tasks[-1]
    rate = numeric_system(system).rate_function
    derivative = mapped(rate, 1)
    path = _through(lambda k, x: call(derivative, x, values[k])[0][0], problem.start_point, times)
    A, B = call(mapped(linearisation(system), len(times)), path, values)
    dimension, inputs = system.state_space.dimension, system.input_space.size
    A = A.reshape(len(times), dimension, dimension).swapaxes(1, 2)
    B = B.reshape(len(times), inputs, dimension).swapaxes(1, 2)
    # Ψ(t) = Φ(T, t): Ψ̇ = -Ψ A, Ψ(T) = 1, walked backwards
    last = len(times) - 1
    moved = _through(lambda k, psi: psi @ A[last - k], np.eye(dimension), times)[::-1] @ B
    weights = np.full(len(times), 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0  # Simpson's rule
    weights *= times[1] / 3.0
    gram = np.einsum("k,kij,klj->il", weights, moved, moved)  # D of (14)
    return -np.swapaxes(moved, 1, 2) @ np.linalg.solve(gram, task.difference(path[-1]))


def _through(rate, start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """RK4 over pairs of samples; between them Hermite's cubic."""
    found, h = np.empty((len(times), *start.shape)), 2.0 * times[1]
    found[0] = start
    for k in range(0, len(times) - 2, 2):
        y = found[k]
        k1 = rate(k, y)
        k2 = rate(k + 1, y + 0.5 * h * k1)
        k3 = rate(k + 1, y + 0.5 * h * k2)
        k4 = rate(k + 2, y + h * k3)
        found[k + 2] = y + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        found[k + 1] = 0.5 * (y + found[k + 2]) + h / 8.0 * (k1 - rate(k + 2, found[k + 2]))
    return found


def coefficient_flow(problem: PlanningProblem, intervals: int) -> Control:
    """The same steps of (17) over piecewise-constant controls, in the L² metric."""
    start = project(problem.control(problem.initial), PiecewiseConstant(intervals))
    solver = Continuation(
        step_rule=Euler(GAMMA), metric=L2Metric(), integrator=RungeKutta4(STEPS), max_iterations=UPDATES
    )
    found = solver.find(replace(problem, basis=start.basis, initial=start.coefficients))
    return found.control


def distance(control: Control, times: np.ndarray, values: np.ndarray) -> float:
    """√∫ |difference|² of a control from samples of the limit, relative to the limit's own."""
    apart = np.trapezoid(np.sum((control(times) - values) ** 2, axis=1), times)
    return float(np.sqrt(apart / np.trapezoid(np.sum(values**2, axis=1), times)))


def distance_of_means(control: Control, times: np.ndarray, values: np.ndarray) -> float:
    """The same from the limit's mean over every interval, the piecewise-constant control that is nearest to it."""
    intervals, samples = control.basis.size, (len(times) - 1) // control.basis.size
    pieces = np.stack([values[k * samples : (k + 1) * samples + 1] for k in range(intervals)])
    means = np.trapezoid(pieces, axis=1) / samples
    return float(np.linalg.norm(control.coefficients.T - means) / np.linalg.norm(means))


def figure(times: np.ndarray, values: np.ndarray, found: dict[int, Control]) -> Any:
    """The third input after all steps, and the distances."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    drawn, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.2), layout="constrained")
    for intervals, color in zip((5, 10, 40), ("#9ecae1", "#4292c6", "#084594"), strict=True):
        left.plot(times, found[intervals](times)[:, 2], color=color, lw=1.2, label=f"(16), $N$ = {intervals}")
    left.plot(times, values[:, 2], color="#d94801", lw=1.6, ls="--", label="(14)")
    left.set(
        xlabel="$t$", ylabel="$v_3$", title=f"after {UPDATES} steps, $\\gamma\\,\\Delta\\theta$ = {GAMMA:g}"
    )
    left.legend(frameon=False, fontsize=8)
    sizes = np.array(list(found))
    for measure, color, order, words in (
        (distance, "#084594", 1, "from $v$"),
        (distance_of_means, "#d94801", 2, "from its means"),
    ):
        apart = np.array([measure(control, times, values) for control in found.values()])
        right.loglog(sizes, apart, "o-", color=color, label=f"{words}: order {order}")
        right.loglog(sizes, apart[-1] * (sizes[-1] / sizes) ** order, ":", color="0.5", zorder=0)
    right.set(
        xlabel="intervals $N$",
        xticks=sizes,
        xticklabels=[str(n) for n in sizes],
        title="relative distance of $v_N$ from (14)",
    )
    right.minorticks_off()
    right.legend(frameon=False, fontsize=8)
    return drawn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", type=Path, default=Path("results/functional_flow.png"), metavar="PNG")
    target = parser.parse_args().o
    problem = paper_task("default")
    times, values = functional_flow(problem)
    found = {intervals: coefficient_flow(problem, intervals) for intervals in INTERVALS}
    for intervals, control in found.items():
        apart = distance(control, times, values), distance_of_means(control, times, values)
        print(f"N = {intervals:4}   from v {apart[0]:.5f}   from its means {apart[1]:.6f}")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure(times, values, found).savefig(target, dpi=110, metadata={"Software": None})
    print(f"picture: {target}")


if __name__ == "__main__":
    main()
