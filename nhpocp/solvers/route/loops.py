"""What a small displacement takes of a driftless system: a straight part, and loops for what only brackets reach."""

from __future__ import annotations

from contextlib import suppress

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import of_many
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.systems.brackets import LieAlgebra, TooLargeError

NOTHING = 1e-4  # of the largest singular value of fields and brackets: what is less is no direction


class Loops:
    """δ = Σ a_i g_i + Σ b_ij [g_i, g_j] at poses of a problem, in units of its scales and over unit time.

    The control a, and beside it loops of the areas ½ ∫ (x_i u_j - x_j u_i) dt = b_ij, move ẋ = Σ u_i g_i by δ but for
    terms of the third order. [Brockett, 1982]
    """

    def __init__(self, problem: PlanningProblem) -> None:
        scales = problem.scales
        self._inputs, self._states = scales.inputs * scales.time, scales.states
        algebra = LieAlgebra(problem.system)
        layers = algebra.layers
        with suppress(TooLargeError):
            if problem.system.driftless:
                algebra.deepen()
        self._pairs = [
            (word.parts[0].letter, word.parts[1].letter)
            for layer in layers[1:]
            for word in layer.words
            if word.parts
        ]
        factors = [*self._inputs, *(self._inputs[i] * self._inputs[j] for i, j in self._pairs)]
        columns = ca.horzcat(*(layer.values for layer in layers)) @ ca.diag(ca.DM(factors))
        scaled = ca.diag(ca.DM(1.0 / self._states)) @ columns
        self._function = ca.Function("columns", [layers[0].x], ca.cse([ca.densify(ca.vec(scaled))]))

    def spans(self, pose: Array) -> bool:
        """Whether fields and brackets reach every direction at a pose."""
        values = svd(self._columns(pose[None]), compute_uv=False)[0]
        return len(values) == len(self._states) <= len(self._inputs) + len(self._pairs) and bool(
            values[-1] > NOTHING * values[0]
        )

    def parts(self, poses: Array, tangent: Array) -> tuple[Array, Array]:
        """a (k, inputs) and b (k, pairs), of least size, for one tangent (dimension,) at poses (k, size)."""
        numbers = np.linalg.pinv(self._columns(poses), rcond=NOTHING) @ (tangent / self._states)
        return numbers[:, : len(self._inputs)], numbers[:, len(self._inputs) :]

    def areas(self, poses: Array, tangent: Array) -> Array:
        """|b| (k,)."""
        columns = self._columns(poses)
        if columns.shape[1] != columns.shape[2]:
            return np.asarray(np.linalg.norm(self.parts(poses, tangent)[1], axis=1))
        try:
            numbers = np.linalg.solve(columns, (tangent / self._states)[:, None])
        except np.linalg.LinAlgError:  # one of them has no inverse
            return np.asarray(np.linalg.norm(self.parts(poses, tangent)[1], axis=1))
        return np.asarray(np.linalg.norm(numbers[:, len(self._inputs) :, 0], axis=1))

    def skew(self, numbers: Array) -> Array:
        """b (pairs,) as a skew matrix (inputs × inputs)."""
        areas = np.zeros((len(self._inputs),) * 2)
        for (i, j), area in zip(self._pairs, numbers, strict=True):
            areas[i, j], areas[j, i] = area, -area
        return areas

    def _columns(self, poses: Array) -> Array:
        """Fields and brackets in units of the scales, (k, dimension, inputs + pairs); 0 where they are not finite."""
        columns = of_many(self._function, poses).reshape(len(poses), -1, len(self._states)).swapaxes(1, 2)
        return np.where(np.isfinite(columns).all(axis=(1, 2))[:, None, None], columns, 0.0)


def known_loops(problem: PlanningProblem) -> Loops | None:
    """None where fields and brackets do not reach every direction at start or goal: a car's are of higher degree."""
    loops = Loops(problem)
    return loops if loops.spans(problem.start_point) or loops.spans(problem.goal_point) else None
