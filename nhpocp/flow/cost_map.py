"""What a control costs and the gradient of that: Λ ↦ ∫ integrand dt, dλ, along the path that it makes."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.flow.integrators import Integrator
from nhpocp.objectives import INTEGRANDS
from nhpocp.problem import PlanningProblem


class EffortMap:
    """∫ |u|² dt = Σ λᵀ Gram λ, exactly."""

    def __init__(self, basis: ControlBasis, inputs: int, horizon: float) -> None:
        self._gram = np.kron(np.eye(inputs), basis.gram(horizon))

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        """(cost, gradient (inputs · size,))."""
        flat = np.ravel(coefficients)
        image = self._gram @ flat
        return float(flat @ image), 2.0 * image


class QuadratureMap:
    """One of `INTEGRANDS`, integrated beside the state by the same integrator and differentiated with it."""

    def __init__(
        self, name: str, problem: PlanningProblem, basis: ControlBasis, horizon: float, integrator: Integrator
    ) -> None:
        system, n = problem.system, problem.system.state_space.size
        y, u = ca.SX.sym("y", n + 1), ca.SX.sym("u", system.input_space.size)
        integrand = INTEGRANDS[name](system, y[:n], u, problem.scale)
        rate = ca.Function("cost_rate", [y, u], [ca.densify(ca.vertcat(system.rate(y[:n], u), integrand))])
        self._flow = integrator.flow(rate, basis, horizon)
        self._start = np.append(problem.start_point, 0.0)

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        """(cost, gradient (inputs · size,))."""
        path, jacobian = self._flow.sensitivity(self._start, coefficients)
        return float(path[-1, -1]), jacobian[-1, -1]


def cost_map(
    name: str, problem: PlanningProblem, basis: ControlBasis, horizon: float, integrator: Integrator
) -> EffortMap | QuadratureMap:
    """The map of one objective."""
    if name == "effort":
        return EffortMap(basis, problem.system.input_space.size, horizon)
    return QuadratureMap(name, problem, basis, horizon, integrator)
