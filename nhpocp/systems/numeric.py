"""A System as plain functions of numbers: one CasADi Function per quantity, evaluated on many samples at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.kept import kept
from nhpocp.singular_values import svd
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS, acceleration_blocks, leg_accelerations
from nhpocp.systems.margins import det, sigma
from nhpocp.systems.system import System

ROUNDING = 1e-12  # what an eigenvalue of AᵀA may be wrong by, as a fraction of their sum
EXPANDED = 3  # the largest matrix whose determinant is written out; others are eliminated, with pivots

Expression = Callable[..., Any]  # (system, x, u, parameters) ↦ the expression


class NumericSystem:
    """Evaluates a System's expressions on numbers; built once, called often."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._state = ca.SX.sym("x", system.state_space.size)
        self._control = ca.SX.sym("u", system.input_space.size)
        self._expressions: dict[Any, tuple[ca.Function, dict[str, tuple[int, int]]]] = {}

    def _function(
        self, name: str, expressions: dict[str, ca.SX]
    ) -> tuple[ca.Function, dict[str, tuple[int, int]]]:
        shapes = {key: value.shape for key, value in expressions.items()}
        columns = [ca.reshape(value.T, -1, 1) for value in expressions.values()]
        return ca.Function(name, [self._state, self._control], columns or [ca.SX(0, 1)]), shapes

    @cached_property
    def rate_function(self) -> ca.Function:
        """(x, u) ↦ ẋ of the packed point."""
        rate = ca.densify(self.system.rate(self._state, self._control))
        return ca.Function("rate", [self._state, self._control], [rate], ["x", "u"], ["xdot"])

    @cached_property
    def linearised_function(self) -> ca.Function:
        """(x, u) ↦ [∂ẋ/∂x, ∂ẋ/∂u] of the packed point, sparse, size × (size + inputs)."""
        x, u, space = self._state, self._control, self.system.state_space
        velocity = ca.SX.sym("velocity", space.dimension)
        lifted = space.lift(x, velocity)
        by_point = ca.substitute(ca.jacobian(lifted, x), velocity, self.system.velocity(x, u))
        through_velocity = ca.jacobian(lifted, velocity) @ ca.sparsify(self.system.linearised(x, u))
        whole = ca.horzcat(by_point, ca.SX(space.size, u.numel())) + through_velocity
        return ca.Function("linearised", [x, u], [ca.sparsify(ca.cse(whole))])

    @cached_property
    def _outputs(self) -> tuple[ca.Function, dict[str, tuple[int, int]]]:
        outputs = self.system.quantities(self._state, self._control)
        return self._function("outputs", {key: ca.densify(ca.SX(value)) for key, value in outputs.items()})

    @cached_property
    def _regularity(self) -> tuple[ca.Function, dict[str, tuple[int, int]]]:
        return self._function("regularity", self.matrices(self._state))

    @cached_property
    def breaking_function(self) -> ca.Function:
        """x ↦ what `breaking` makes determinants of, a column: those of small matrices, the entries of others."""
        matrices = [self.matrices(self._state)[name] for name in self.system.breaking()]
        columns = [ca.det(m) if m.size1() <= EXPANDED else ca.vec(m.T) for m in matrices]
        return ca.Function("breaking", [self._state], ca.cse([ca.densify(ca.vertcat(ca.SX(0, 1), *columns))]))

    def matrices(self, state: ca.SX) -> dict[str, ca.SX]:
        """The regularity matrices at a packed symbolic state, dense, by name: written out once, whoever asks."""
        names, function = self._matrices
        return dict(zip(names, function.call([state]), strict=True))

    @cached_property
    def _matrices(self) -> tuple[list[str], ca.Function]:
        written = self.system.regularity(self._state)
        dense = [ca.densify(ca.SX(matrix)) for matrix in written.values()]
        return list(written), ca.Function("matrices", [self._state], dense)

    def outputs(self, states: Array, controls: Array) -> dict[str, Array]:
        """The system's outputs at samples: states (k, n), controls (k, m) → (k, …) each."""
        return _evaluate(*self._outputs, states, controls)

    @cached_property
    def _accelerations(self) -> ca.Function:
        """(x, u, u̇) ↦ accelerations of the legs."""
        rate = ca.SX.sym("u_rate", self.system.input_space.size)
        value = ca.SX(leg_accelerations(self.system, self._state, self._control, rate))
        return ca.Function("accelerations", [self._state, self._control, rate], [ca.densify(value)])

    def accelerations(self, states: Array, controls: Array, control_rates: Array | None) -> dict[str, Array]:
        """Of the legs at samples (k, legs), by name; none of systems that were not asked for them.

        control_rates: du/dt (k, m); None: of a control that stays as it is.
        """
        if not (self.system.accelerated and acceleration_blocks(self.system)):
            return {}
        rates = np.zeros_like(controls) if control_rates is None else control_rates
        (values,) = call(mapped(self._accelerations, len(states)), states, controls, rates)
        return {LEG_ACCELERATIONS: values.reshape(len(states), -1)}

    def regularity(self, states: Array) -> dict[str, Array]:
        """The regularity matrices at samples: (k, n) → (k, r, r) each."""
        return _evaluate(*self._regularity, states, np.zeros((len(states), self.system.input_space.size)))

    def along(self, expression: Expression, states: Array, controls: Array, *parameters: float) -> Array:
        """An expression of (system, x, u, parameters) at samples, (k,) or (k, …)."""
        key = expression, parameters
        if key not in self._expressions:
            value = ca.densify(ca.SX(expression(self.system, self._state, self._control, *parameters)))
            self._expressions[key] = self._function("expression", {"value": value})
        return _evaluate(*self._expressions[key], states, controls)["value"]

    def determinants(self, states: Array) -> dict[str, Array]:
        """det of every regularity matrix at samples, (k,) each."""
        return {name: _determinant(matrices) for name, matrices in self.regularity(states).items()}

    def breaking(self, numbers: Array) -> dict[str, Array]:
        """det of the matrices that the equations invert, `System.breaking`, at samples, (k,) each.

        numbers: of `breaking_function` at samples, (k, …).
        """
        determinants, first = {}, 0
        for name, size in self._breaking_sizes.items():
            if size <= EXPANDED:
                determinants[name], first = numbers[:, first], first + 1
            else:
                entries = numbers[:, first : first + size * size]
                determinants[name], first = _determinant(entries.reshape(-1, size, size)), first + size * size
        return determinants

    @cached_property
    def _breaking_sizes(self) -> dict[str, int]:
        return {name: self.matrices(self._state)[name].size1() for name in self.system.breaking()}

    def sigmas(self, states: Array, length_scale: float) -> dict[str, Array]:
        """The least singular value of every regularity matrix at samples, rotations divided by a length, (k,) each."""
        return self._sigmas(self.regularity(states), length_scale)

    def _sigmas(self, regularity: Mapping[str, Array], length_scale: float) -> dict[str, Array]:
        return {
            name: _least_singular_value(matrices / self.system.column_scales(name, length_scale))
            for name, matrices in regularity.items()
        }

    def least_sigmas(self, states: Array, length_scale: float) -> dict[str, float | None]:
        """The least of each along samples, by `Margin.name`; None where none is finite."""
        return {
            sigma(name).name: _least_along(matrices / self.system.column_scales(name, length_scale))
            for name, matrices in self.regularity(states).items()
        }

    def margins(self, states: Array, length_scale: float) -> dict[str, Array]:
        """Both margins of every regularity matrix at samples, (k,) each, by `Margin.name`."""
        regularity = self.regularity(states)
        sigmas = self._sigmas(regularity, length_scale)
        named = {sigma(name).name: values for name, values in sigmas.items()}
        return named | {det(name).name: _determinant(matrices) for name, matrices in regularity.items()}

    def trajectory(
        self, states: Array, controls: Array, length_scale: float, control_rates: Array | None = None
    ) -> dict[str, Array]:
        """Everything worth knowing at samples: state blocks, inputs, outputs, margins; (k, …) arrays by name.

        control_rates: du/dt, as for `accelerations`.
        """
        return {
            **self.system.state_space.split(states),
            **self.system.input_space.split(controls),
            **self.outputs(states, controls),
            **self.accelerations(states, controls, control_rates),
            **self.margins(states, length_scale),
        }


@kept(most=16)
def numeric_system(system: System) -> NumericSystem:
    """The `NumericSystem` of a system, made once: solvers meet the same robot many times."""
    return NumericSystem(system)


def _evaluate(
    function: ca.Function, shapes: dict[str, tuple[int, int]], states: Array, controls: Array
) -> dict[str, Array]:
    if not shapes:
        return {}
    samples = len(states)
    values = call(mapped(function, samples), states, controls)
    arrays = {}
    for value, (name, (rows, cols)) in zip(values, shapes.items(), strict=True):
        shape = (samples, rows, cols) if cols > 1 else (samples, rows) if rows > 1 else (samples,)
        arrays[name] = value.reshape(shape)
    return arrays


def _least_singular_value(matrices: Array) -> Array:
    """Of (k, r, r), NaN where an entry is."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    values = svd(np.where(finite[:, None, None], matrices, 0.0), compute_uv=False)
    return np.where(finite, values[:, -1], np.nan)


def _least_along(matrices: Array) -> float | None:
    """The least singular value of all of (k, r, r) that are finite.

    The eigenvalues of AᵀA cost less, and are wrong by rounding of |A|²: they say which matrices may have the least.
    """
    candidates = matrices[np.isfinite(matrices).all(axis=(1, 2))]
    if not len(candidates):
        return None
    with np.errstate(over="ignore"):  # of a path that has run away
        gram = candidates.swapaxes(1, 2) @ candidates
    if np.isfinite(gram).all():
        squares, doubt = np.linalg.eigvalsh(gram)[:, 0], ROUNDING * np.trace(gram, axis1=1, axis2=2)
        candidates = candidates[squares - doubt <= (squares + doubt).min()]
    return float(svd(candidates, compute_uv=False)[:, -1].min())


def _determinant(matrices: Array) -> Array:
    """det of (k, r, r), NaN where an entry is; a path that has run away may overflow, and that is no news here."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    with np.errstate(over="ignore"):
        return np.where(finite, np.linalg.det(np.where(finite[:, None, None], matrices, 0.0)), np.nan)
