"""The end-point map Λ ↦ x(T) and its Jacobian, the 6 × (6h + 3) matrix of [Paper] eq. (16) for the robot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.controls.basis import ControlBasis
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import Flow, Integrator
from nhpocp.flow.variational import VariationalEquations
from nhpocp.kept import kept
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System


@dataclass(frozen=True)
class EndPoint:
    """Where a control leads: the path (k, n), and the Jacobians (stops, dimension, inputs · size) of its stops.

    Stops are the times at which the path has something to meet; the last is T. A row of a Jacobian is a tangent number
    (rotations: ∂R Rᵀ as a vector, [Paper] eq. (10)), a column an entry of λ.
    """

    path: Array
    stops: tuple[int, ...]  # rows of the path
    jacobians: Array
    watched: Array  # the numbers of `Dynamics.watched` along the path, (k, …)
    # the Jacobians of the whole path, (k, dimension, inputs · size), if asked for
    variations: Array | None = None

    @property
    def state(self) -> Array:
        """x(T), packed."""
        return self.path[-1]

    @property
    def jacobian(self) -> Array:
        """dx(T)/dλ, dimension × inputs · size."""
        return self.jacobians[-1]


class EndPointMap(ABC):
    """Made for one system, basis, horizon and start; called with coefficients Λ (inputs × size)."""

    def __init__(
        self,
        system: System,
        basis: ControlBasis,
        horizon: float,
        start: Array,
        integrator: Integrator,
        fractions: Sequence[float] = (),
        along: bool = False,
    ) -> None:
        """fractions: of the horizon, where Jacobians are wanted besides the end; along: of the whole path as well."""
        self._start, self._along = start, along
        self._asked = system, basis, horizon, integrator, tuple(fractions)
        self.times = self._prepare()
        self._stops = stops_of(self.times, fractions, horizon)

    @abstractmethod
    def _prepare(self) -> Array:
        """Makes what calls need of `_asked`; the times of the path, the fractions among them."""

    @abstractmethod
    def __call__(self, coefficients: Array) -> EndPoint:
        """Where they lead."""


EndPointMapFactory = Callable[..., EndPointMap]  # called as the class is made


class DifferentiatedEndPointMap(EndPointMap):
    """The Jacobian as the derivative of what the integrator computes (automatic differentiation).

    To be named, as in `Continuation(sensitivity=DifferentiatedEndPointMap)`; a solver makes it.
    """

    def _prepare(self) -> Array:
        self._flow = flow_through(*self._asked)
        return self._flow.times

    def __call__(self, coefficients: Array) -> EndPoint:
        if self._along:
            path, variations, watched = self._flow.sensitivity(
                self._start, coefficients, range(len(self.times))
            )
            return EndPoint(path, self._stops, variations[list(self._stops)], watched, variations)
        path, jacobians, watched = self._flow.sensitivity(self._start, coefficients, self._stops)
        return EndPoint(path, self._stops, jacobians, watched)


class VariationalEndPointMap(EndPointMap):
    """The Jacobian from the paper's variational equations (11)-(12); also gives the Gram matrix of (14).

    To be named, as in `Continuation(sensitivity=VariationalEndPointMap)`; a solver makes it.
    """

    def _prepare(self) -> Array:
        system, basis, horizon, integrator, fractions = self._asked
        times = grid_through(integrator.grid(basis, horizon), fractions, horizon)
        self._equations = VariationalEquations(system, basis, horizon, integrator, times)
        self._watched = numeric_system(system).breaking_function
        return self._equations.flow.times

    def __call__(self, coefficients: Array) -> EndPoint:
        path, jacobians, _ = self._equations.states(self._start, coefficients)
        (watched,) = call(mapped(self._watched, len(path)), path)
        at_stops = jacobians[list(self._stops)]
        return EndPoint(path, self._stops, at_stops, watched, jacobians if self._along else None)

    def gram(self, coefficients: Array) -> Array:
        """D of [Paper] eq. (14), dimension × dimension."""
        return self._equations.states(self._start, coefficients)[2]


def grid_through(times: Array, fractions: Sequence[float], horizon: float) -> Array:
    """An integrator's grid with these fractions of the horizon in it."""
    wanted = horizon * np.asarray(fractions, dtype=float)
    missing = [t for t in wanted if np.abs(times - t).min() > 1e-9 * horizon]
    return np.sort(np.concatenate([times, missing])) if missing else times


def stops_of(times: Array, fractions: Sequence[float], horizon: float) -> tuple[int, ...]:
    """Places of the fractions, and of the end, in a grid that goes through them."""
    inner = [int(np.abs(times - fraction * horizon).argmin()) for fraction in fractions]
    return (*inner, len(times) - 1)


@kept(most=32)  # solves of a sweep differ in start and goal only
def flow_through(
    system: System, basis: ControlBasis, horizon: float, integrator: Integrator, fractions: tuple[float, ...]
) -> Flow:
    """The flow over the integrator's grid through these fractions."""
    times = grid_through(integrator.grid(basis, horizon), fractions, horizon)
    return integrator.flow(dynamics(system), basis, horizon, times)
