"""What a flow is made of: a right-hand side, and what is wanted of the paths under it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from nhpocp.kept import kept
from nhpocp.state_space import StateSpace
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System


@dataclass(frozen=True, eq=False)
class Dynamics:
    """ẏ = rate(y, u), y ∈ R^n, u ∈ R^m, as CasADi functions.

    linearised: (y, u) ↦ [∂rate/∂y, ∂rate/∂u], n × (n + m), sparse; where one is known that is cheaper than what
    CasADi's AD finds.
    observed: y ↦ matrix (rows × n), by which dy/dλ is multiplied; None: all of it. Few rows are cheap.
    watched: y ↦ numbers (k,) that are wanted at every point of a path; None: none.
    """

    rate: ca.Function
    linearised: ca.Function | None = None
    observed: ca.Function | None = None
    watched: ca.Function | None = None

    @property
    def functions(self) -> list[ca.Function]:
        """Those that are given."""
        every = (self.rate, self.linearised, self.observed, self.watched)
        return [function for function in every if function is not None]


@kept(most=16)
def dynamics(system: System) -> Dynamics:
    """A system's own: tangent numbers of dy/dλ, and the determinants that its equations divide by."""
    numeric = numeric_system(system)
    return Dynamics(
        numeric.rate_function,
        numeric.linearised_function,
        _lower(system.state_space),
        numeric.breaking_function,
    )


@kept(most=32)
def _lower(space: StateSpace) -> ca.Function:
    """A packed point ↦ the matrix (dimension × size) that takes its rate to tangent numbers."""
    x, rate = ca.SX.sym("x", space.size), ca.SX.sym("rate", space.size)
    return ca.Function("lower", [x], [ca.densify(ca.jacobian(space.lower(x, rate), rate))])
