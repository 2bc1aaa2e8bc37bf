r"""How nimbly a system moves under one control: the end point's Jacobian and its agility ellipsoid.

The Gram matrix D of [Paper] eq. (14) maps controls of unit effort, ∫|δu|² dt ≤ 1, onto the ellipsoid
    { δ : δᵀ D⁻¹ δ ≤ 1 }
of end points to first order, the agility ellipsoid; √det D, its volume but for a constant, is the kinematic dexterity.
[Tchoń, Zadarnowska]. D knows all controls, the Jacobian over Λ those of one basis. At a standstill the ellipsoid of
velocities, { G(x) u : |u| ≤ 1 }, says the same.
Rows that are lengths are divided by the mechanism's length throughout, the Jacobian's columns by their inputs' unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.analysis.growth import Scales
from nhpocp.analysis.spectrum import Spectrum
from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import finer, resolving
from nhpocp.flow.variational import gram_matrix
from nhpocp.singular_values import svd
from nhpocp.systems.system import System

MAIN = 0.3  # of an axis' largest number: what is less is not named


@dataclass(frozen=True)
class Ellipsoid:
    """{ A q : |q| ≤ 1 } in dimensionless tangent numbers: principal axes as columns, and their semi-axes, falling."""

    labels: tuple[str, ...]
    axes: Array
    semi_axes: Array

    @classmethod
    def of_map(cls, matrix: Array, labels: tuple[str, ...]) -> Ellipsoid:
        """The image of the unit ball under a matrix; of no thickness where that has fewer columns than rows."""
        axes, values, _ = svd(matrix)
        return cls(labels, axes, np.pad(values, (0, len(matrix) - len(values))))

    @classmethod
    def of_gram(cls, gram: Array, labels: tuple[str, ...]) -> Ellipsoid:
        """{ δ : δᵀ D⁻¹ δ ≤ 1 } of a symmetric positive semi-definite D."""
        values, axes = np.linalg.eigh(0.5 * (gram + gram.T))
        return cls(labels, axes[:, ::-1], np.sqrt(np.maximum(values[::-1], 0.0)))

    @property
    def volume(self) -> float:
        """The product of the semi-axes, √det D; the unit ball's volume is left out."""
        return float(np.prod(self.semi_axes))

    @property
    def matrix(self) -> Array:
        """D, whose inverse is the quadratic form."""
        return np.asarray((self.axes * self.semi_axes**2) @ self.axes.T)

    def words(self, place: int) -> str:
        """The main components of an axis, by size."""
        axis = np.abs(self.axes[:, place])
        order = [i for i in np.argsort(-axis, kind="stable") if axis[i] > MAIN * axis.max()]
        return ", ".join(self.labels[i] for i in order)

    def to_json(self) -> dict[str, Any]:
        return {
            "coordinates": list(self.labels),
            "semi_axes": self.semi_axes.tolist(),
            "axes": self.axes.T.tolist(),  # one list per axis
            "volume": self.volume,
        }


@dataclass(frozen=True)
class EndPointAnalysis:
    """The end point x(T) of one control, and how it moves with the control."""

    control: Control
    jacobian: Array  # dimension × inputs · size, dimensionless
    spectrum: Spectrum
    agility: Ellipsoid

    def __repr__(self) -> str:
        rows, columns = self.jacobian.shape
        return f"<EndPointAnalysis: Jacobian {rows} × {columns}, rank {self.spectrum.rank}>"

    @property
    def condition(self) -> float:
        """Largest over least singular value; infinite where the rank is not full."""
        values = self.spectrum.values
        full = self.spectrum.rank == len(self.jacobian)
        return values[0] / values[-1] if full else float("inf")

    def to_json(self) -> dict[str, Any]:
        rows, columns = self.jacobian.shape
        return {
            "rows": rows,
            "columns": columns,
            **self.spectrum.to_json(),
            "condition": self.condition,
            "agility": self.agility.to_json(),
            "dexterity": self.agility.volume,
        }


def end_point_analysis(
    system: System, control: Control, start: Array, length: float, tolerance: float
) -> EndPointAnalysis | None:
    """The Jacobian over the control's basis and the Gram matrix; None where they are not finite."""
    scales = Scales(length, control.horizon)
    asked = system, control.basis, control.horizon
    integrator = finer(resolving(RungeKutta4(), control.basis))
    the_map = DifferentiatedEndPointMap(*asked, start, integrator)
    rows = scales.rows(system)
    columns = np.repeat(scales.units(system.input_space.tangent_units), control.basis.size)
    with np.errstate(over="ignore", invalid="ignore"):
        jacobian = rows[:, None] * the_map(control.coefficients).jacobian * columns
        gram = gram_matrix(*asked, integrator, start, control.coefficients) * np.outer(rows, rows)
    if not (np.isfinite(jacobian).all() and np.isfinite(gram).all()):
        return None
    agility = Ellipsoid.of_gram(gram, tuple(system.state_space.tangent_labels))
    return EndPointAnalysis(control, jacobian, Spectrum.of(jacobian, tolerance), agility)


def velocities(system: System, point: Array, length: float) -> Ellipsoid | None:
    """The velocities of unit controls at a point, G(x) q with |q| ≤ 1; None where G is not finite."""
    scales = Scales(length, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        fields = np.asarray(system.vector_fields(point), dtype=float)
        fields = scales.rows(system)[:, None] * fields * scales.units(system.input_space.tangent_units)
    if not np.isfinite(fields).all():
        return None
    return Ellipsoid.of_map(fields, tuple(system.state_space.tangent_labels))
