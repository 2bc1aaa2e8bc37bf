"""The end-point map Λ ↦ x(T) and its Jacobian, the 6 × (6h + 3) matrix of [Paper] eq. (16) for the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.flow.integrators import Integrator
from nhpocp.flow.variational import VariationalEquations
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System


@dataclass(frozen=True)
class EndPoint:
    """Where a control leads: the path (k, n) whose last row is x(T), and the Jacobian (dimension, inputs · size).

    A row of the Jacobian is a tangent number (rotations: ∂R Rᵀ as a vector, [Paper] eq. (10)), a column an entry of λ.
    """

    path: Array
    jacobian: Array

    @property
    def state(self) -> Array:
        return self.path[-1]


class EndPointMap(Protocol):
    """Made for one system, basis, horizon and start; called with coefficients Λ (inputs × size)."""

    times: Array

    def __call__(self, coefficients: Array) -> EndPoint: ...


class EndPointMapFactory(Protocol):
    """`DifferentiatedEndPointMap` or `VariationalEndPointMap`: two ways to the same Jacobian."""

    def __call__(
        self, system: System, basis: ControlBasis, horizon: float, start: Array, integrator: Integrator
    ) -> EndPointMap: ...


class DifferentiatedEndPointMap:
    """The Jacobian as the derivative of what the integrator computes (automatic differentiation)."""

    def __init__(
        self, system: System, basis: ControlBasis, horizon: float, start: Array, integrator: Integrator
    ) -> None:
        space = system.state_space
        self._flow = integrator.flow(NumericSystem(system).rate_function, basis, horizon)
        self._start, self.times = start, self._flow.times
        x, rate = ca.SX.sym("x", space.size), ca.SX.sym("rate", space.size)
        self._lower = ca.Function("lower", [x], [ca.densify(ca.jacobian(space.lower(x, rate), rate))])

    def __call__(self, coefficients: Array) -> EndPoint:
        path, derivative = self._flow.sensitivity(self._start, coefficients)
        return EndPoint(path, np.array(self._lower(path[-1])) @ derivative)


class VariationalEndPointMap:
    """The Jacobian from the paper's variational equations (11)-(12); also gives the Gram matrix of (14)."""

    def __init__(
        self, system: System, basis: ControlBasis, horizon: float, start: Array, integrator: Integrator
    ) -> None:
        self._equations = VariationalEquations(system, basis, horizon, integrator)
        self._start, self.times = start, self._equations.flow.times

    def __call__(self, coefficients: Array) -> EndPoint:
        path, jacobian, _ = self._equations.states(self._start, coefficients)
        return EndPoint(path, jacobian)

    def gram(self, coefficients: Array) -> Array:
        """D of [Paper] eq. (14), dimension × dimension."""
        return self._equations.states(self._start, coefficients)[2]
