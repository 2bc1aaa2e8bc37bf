"""What a control costs and the gradient of that: Λ ↦ ∫ integrand dt, dλ, along the path that it makes."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.table import Gram
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.dynamics import Dynamics
from nhpocp.flow.integrators import Integrator
from nhpocp.kept import kept
from nhpocp.objectives.objective import ControlObjective, PathObjective
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System


class GramMap:
    """Σ λᵀ M λ, exactly: of a `ControlObjective`."""

    def __init__(self, gram: Gram, inputs: int) -> None:
        self._gram, self._shape = gram, (inputs, gram.size)

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        """(cost, gradient (inputs · size,))."""
        by_input = np.reshape(coefficients, self._shape)
        image = (self._gram @ by_input.T).T
        return float(np.sum(by_input * image)), 2.0 * image.ravel()


class QuadratureMap:
    """A `PathObjective`, or what is smooth in its place, integrated and differentiated beside the state."""

    def __init__(
        self,
        objective: PathObjective,
        problem: PlanningProblem,
        basis: ControlBasis,
        horizon: float,
        integrator: Integrator,
    ) -> None:
        rest = objective.softenings[-1] * objective.scale(problem.scales) / horizon
        dynamics = _with_quadrature(problem.system, objective, problem.scale, rest)
        self._flow = integrator.flow(dynamics, basis, horizon)
        self._start = np.append(problem.start_point, 0.0)

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        """(cost, gradient (inputs · size,))."""
        path, derivatives, _ = self._flow.sensitivity(self._start, coefficients)
        return float(path[-1, -1]), derivatives[-1, -1]


@kept(most=32)
def _with_quadrature(system: System, objective: PathObjective, scale: float, rest: float) -> Dynamics:
    """Of (x, ∫ integrand dt), the last observed; linearised by the system's own way, which is the cheaper one."""
    numeric, n, m = numeric_system(system), system.state_space.size, system.input_space.size
    y, u = ca.SX.sym("y", n + 1), ca.SX.sym("u", m)
    x = y[:n]
    integrand = ca.SX(objective.searched(system, x, u, scale, rest))
    rate = ca.densify(ca.vertcat(numeric.rate_function(x, u), integrand))
    both = ca.vertcat(numeric.linearised_function(x, u), ca.gradient(integrand, ca.vertcat(x, u)).T)
    linearised = ca.horzcat(both[:, :n], ca.SX(n + 1, 1), both[:, n:])  # nothing depends on the integral
    last = ca.DM.zeros(1, n + 1)
    last[n] = 1.0
    return Dynamics(
        ca.Function("cost_rate", [y, u], [rate]),
        ca.Function("cost_linearised", [y, u], [ca.sparsify(ca.cse(linearised))]),
        ca.Function("last", [y], [last]),
    )


def cost_map(
    name: str, problem: PlanningProblem, basis: ControlBasis, horizon: float, integrator: Integrator
) -> GramMap | QuadratureMap:
    """The map of one objective.

    Errors: `InvalidProblemError` where no control over the basis has this cost, or no search at a fixed T lowers it.
    """
    objective = OBJECTIVES[name]
    if words := objective.lacking_control(basis):
        raise InvalidProblemError(words, path="solvers.jacobian.objective")
    if isinstance(objective, ControlObjective):
        return GramMap(Gram.of(objective.gram(basis, horizon)), problem.system.input_space.size)
    if isinstance(objective, PathObjective):
        return QuadratureMap(objective, problem, basis, horizon, integrator)
    raise InvalidProblemError(
        f"{name} is the same for every motion of one duration", path="solvers.jacobian.objective"
    )
