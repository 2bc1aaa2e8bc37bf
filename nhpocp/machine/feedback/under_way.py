"""The rest of a plan corrected while it is run: the continuation over what is left of the horizon.

In the first run of a steering only. What is left of a short loop hardly moves its end, and corrections of it were
tried: they make the loops of later runs larger than the error that they are there for, and what the model gets wrong.
Corrected by the model as it is written, the paper's robot, 2 % or 2° wrong, ends 0.18 from its goal in the median (0.46
without), for what comes after the last correction is as wrong as before; by a `ModelEstimate`, 0.003.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.errors import OrientationAtPiError
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.machine.feedback.set_points import grid_since
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.solvers.metrics import Coordinates, Metric

STEPS = 50  # of RK4 over what is left
UPDATES = 6  # at most
LAST = 0.8  # of the horizon: what comes then is left to the next plan

LARGEST = 1.0  # of the control's size: the largest change at one time
LEAST_SIGMA = (
    1e-3  # of the largest singular value: directions in which the rest of a motion hardly moves its end
)


@dataclass(frozen=True)
class Correction:
    """A control whose rest leads from where a machine stands nearer to the goal; E [rad] before and after.

    control: over the same basis and horizon; what it says of the time before means nothing.
    """

    control: Control
    before: float
    after: float


def corrected(
    problem: PlanningProblem, control: Control, since: float, point: Array, tolerance: float, metric: Metric
) -> Correction | None:
    """(17) with γ = 1, Λ ← Λ - J^# e, of the end point from ``point`` at ``since``, shortened until the error falls.

    None where it does not fall at all, or the path has no end.
    """
    basis, horizon, task = control.basis, control.horizon, problem.tasks[-1]
    times = grid_since(since)(STEPS, control.breakpoints, horizon)
    # no kernel: it would take longer to build than the estimate of a machine lasts
    flow = RungeKutta4(STEPS, Interpreted()).flow(dynamics(problem.system), basis, horizon, times)
    coordinates = Coordinates.natural(metric, basis, problem.scales.inputs, horizon)
    allowed = LARGEST * float(np.linalg.norm(coordinates.of(np.ravel(control.coefficients))))
    stops = (len(times) - 1,)

    def evaluated(coefficients: Array) -> tuple[float, Array, Array]:
        path, jacobians, _ = flow.sensitivity(point, coefficients, stops)
        error = problem.goal_error(path[-1])
        if not np.isfinite(error) or not np.isfinite(jacobians[-1]).all():
            return np.inf, np.empty(0), np.empty(0)
        residual = task.scales * task.difference(path[-1])
        return error, residual, task.jacobian(path[-1], jacobians[-1])

    coefficients = np.array(control.coefficients)
    try:
        error, residual, jacobian = evaluated(coefficients)
        before = error
        for _ in range(UPDATES):
            if not tolerance < error < np.inf:
                break
            z = -_inverted(coordinates.jacobian(jacobian), residual)
            size = float(np.linalg.norm(z))
            fraction = min(1.0, allowed / size) if size > 0 else 0.0
            step = coordinates.coefficients(fraction * z).reshape(coefficients.shape)
            trial = evaluated(coefficients + step)
            if not trial[0] < error:
                break
            coefficients, allowed = coefficients + step, allowed - fraction * size
            error, residual, jacobian = trial
    except (OrientationAtPiError, np.linalg.LinAlgError):
        return None
    if not error < before:
        return None
    return Correction(Control(basis, coefficients, horizon), before, error)


def _inverted(jacobian: Array, residual: Array) -> Array:
    """J^# e, without the directions in which J hardly moves anything."""
    u, sigma, v = svd(jacobian, full_matrices=False)
    kept = sigma > LEAST_SIGMA * sigma[0]
    weighted: Array = v[kept].T @ ((u.T @ residual)[kept] / sigma[kept])
    return weighted
