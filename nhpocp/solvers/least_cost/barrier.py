"""A barrier before the surfaces that no path crosses, for a search that they would stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.flow.cost_map import QuadratureMap
from nhpocp.flow.integrators import Integrator
from nhpocp.objectives.objective import PathObjective
from nhpocp.problem import PlanningProblem
from nhpocp.scales import Scales
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System


@dataclass(frozen=True)
class Barrier(PathObjective):
    """∫ Π det(M)⁻² dt over the matrices M that the equations invert, infinite on a path that touches det M = 0."""

    name = "barrier"
    symbol = "∫det⁻²"
    pace = 1

    def scale(self, scales: Scales) -> float:
        return 1.0

    def integrand(self, system: System, state: Array, control: Array, length_scale: float) -> Array:
        return 1.0 / prod(ca.vertsplit(numeric_system(system).breaking_function(state))) ** 2


def barrier_map(
    problem: PlanningProblem, basis: ControlBasis, horizon: float, integrator: Integrator
) -> Callable[[Array], tuple[float, Array]] | None:
    """Λ ↦ the barrier and its gradient (inputs · size,), 1 for rest at the start.

    None for systems whose equations invert nothing, or matrices too large for their determinants to be written out.
    """
    numeric, names = numeric_system(problem.system), problem.system.breaking()
    first = np.asarray(numeric.breaking_function(problem.start_point)).ravel()
    if not names or len(first) != len(names):
        return None
    unit = prod(first) ** 2 / horizon
    quadrature = QuadratureMap(Barrier(), problem, basis, horizon, integrator)

    def barrier(coefficients: Array) -> tuple[float, Array]:
        value, gradient = quadrature(coefficients)
        return unit * value, unit * gradient

    return barrier
