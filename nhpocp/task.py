"""What a path must meet at one time: the goal at its end, a via pose on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import OrientationAtPiError
from nhpocp.state_space import StateSpace

HALF_TURN_WITHIN = 1e-7  # [rad]; closer to π the axis of the error is noise


@dataclass(frozen=True)
class Task:
    """Values for some blocks of the state at a share of the horizon; the other blocks are free.

    error_length: the length that counts as much as one radian in E; scale: the mechanism's own length, by which
    lengths are divided in the linear algebra, so that a rank depends on no unit.
    """

    space: StateSpace
    values: Mapping[str, Any]
    share: float
    error_length: float
    scale: float

    @cached_property
    def rows(self) -> Array:
        """Indices of the tangent numbers that the task fixes."""
        numbers = np.arange(self.space.dimension)
        parts = [numbers[self.space.tangent_slice(n)] for n in self.space.names if n in self.values]
        return np.concatenate(parts) if parts else np.empty(0, dtype=int)

    @cached_property
    def weights(self) -> Array:
        """Weight of each fixed tangent number in E."""
        return np.asarray(self.space.weights(self.error_length))[self.rows]

    @cached_property
    def _fixed(self) -> StateSpace:
        return StateSpace([block for block in self.space.blocks if block.name in self.values])

    @cached_property
    def _scales(self) -> Array:
        units = np.array(self.space.tangent_units)[self.rows]
        return np.where(units == "length", 1.0 / self.scale, 1.0)

    def difference(self, point: Array) -> Array:
        """e of [Paper] eq. (8) over the fixed blocks, unweighted.

        Errors: `OrientationAtPiError` where a fixed rotation is a half turn away.
        """
        here, space = self.space.unpack(point), self._fixed
        there = space.pack({name: here[name] for name in space.names})
        return np.asarray(space.difference(there, space.pack(self.values)))

    def error(self, point: Array) -> float:
        """E at a packed point, [Paper] section 4; NaN where it has none."""
        if not np.isfinite(point).all():
            return float("nan")
        try:
            return float(np.linalg.norm(self.weights * self.difference(point)))
        except OrientationAtPiError:
            return float("nan")

    def angle(self, point: Array) -> float:
        """The largest rotation between a fixed block and its value [rad]."""
        here = self.space.unpack(point)
        turns = [b.name for b in self.space.blocks if b.kind == "rotation" and b.name in self.values]
        return max((float(so3.angle(here[n] @ self.values[n].T)) for n in turns), default=0.0)

    def half_turn(self, point: Array) -> bool:
        """Whether an orientation is opposite to its value, where the logarithm has no direction."""
        return self.angle(point) > np.pi - HALF_TURN_WITHIN

    def vector(self, point: Array) -> Array:
        """e, dimensionless."""
        return self.difference(point) * self._scales

    def jacobian(self, jacobian: Array) -> Array:
        """The rows of a point's Jacobian (dimension, k) that belong to `vector`, in its scale.

        The rows for a rotation are s, not the derivative of the logarithm: [Paper] eq. (13) asks s = -γ r, which is
        parallel to r, so that ṙ = -γ r exactly.
        """
        return self._scales[:, None] * jacobian[self.rows]
