"""The motion that a control makes, sampled for files and pictures."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.flow.integrators import RungeKutta4, uniform_grid
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import NumericSystem

STEPS_AT_LEAST = 800  # where RK4's error on the paper's path is below 1e-11


def simulate(problem: PlanningProblem, control: Control, numeric: NumericSystem) -> dict[str, Array]:
    """The trajectory under a control at ``problem.samples`` equidistant times: "t" and every named quantity.

    Samples that the integration cannot reach are NaN.
    """
    samples, horizon = problem.samples, control.horizon
    intervals = samples - 1
    steps = intervals * -(-STEPS_AT_LEAST // intervals)
    times = uniform_grid(steps, control.breakpoints, horizon)
    flow = RungeKutta4().flow(numeric.rate_function, control.basis, horizon, times)
    path = flow.states(problem.start_point, control.coefficients)
    kept = np.linspace(0.0, horizon, samples)
    states = path[np.clip(np.searchsorted(times, kept - 1e-9 * horizon), 0, len(times) - 1)]
    return {"t": kept, **numeric.trajectory(states, control(kept), problem.scale)}
