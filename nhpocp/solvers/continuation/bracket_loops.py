"""Controls that move a driftless system by a small displacement, along its fields and along their brackets."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.projection import project
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.route.loops import Loops

PHASES = 8  # at which a loop may begin
TURNS = (1, 2)  # of a loop: the more, the less it strays, and the more effort it takes
SMALL = 1e-12  # of the largest loop
WIDEST = 4.0  # in units of the inputs' scales: the radius of a loop


class BracketLoops:
    """Seeds for manoeuvres over short parts of a route.

    Where δ = Σ a_i g_i + Σ b_ij [g_i, g_j], u = a + circles over unit time, whose areas ½ ∫ (x_i u_j - x_j u_i) dt are
    b_ij, moves ẋ = Σ u_i g_i by δ but for terms of the third order: the plan of least effort for the brackets' part of
    the free nilpotent system of step two, 4π Σ|b|. [Brockett, 1982; Murray & Sastry]
    """

    def __init__(self, problem: PlanningProblem, loops: Loops) -> None:
        self._loops, self._inputs = loops, problem.scales.inputs
        series = Fourier(max(TURNS) * max(1, len(self._inputs) // 2))
        each = Control(series, np.eye(series.size), problem.horizon.fixed)
        self._projected = project(each, problem.basis).coefficients  # of each function of the series

    def seeds(self, here: Array, displacement: Array) -> list[Array]:
        """Coefficients (inputs × size) over the problem's basis and unit time, for a tangent (dimension,) at a pose."""
        (straight,), (numbers,) = self._loops.parts(here[None], displacement)
        planes = _planes(self._loops.skew(numbers))
        if not planes:
            return [self._over_basis(straight, [], 0.0, 1)]
        phases = 2.0 * np.pi * np.arange(PHASES) / PHASES
        return [self._over_basis(straight, planes, phase, turns) for turns in TURNS for phase in phases]

    def _over_basis(
        self, straight: Array, planes: list[tuple[float, Array, Array]], phase: float, turns: int
    ) -> Array:
        """a and a circle in each plane, the k-th of k times as many turns, which are orthogonal."""
        coefficients = np.zeros((len(straight), len(self._projected)))
        coefficients[:, 0] = straight
        for k, (area, first, second) in enumerate(planes, 1):
            harmonic = turns * k
            radius = min(WIDEST, np.sqrt(4.0 * np.pi * harmonic * area))
            c, s = np.cos(phase), np.sin(phase)
            sine, cosine = 2 * harmonic - 1, 2 * harmonic
            coefficients[:, sine] += radius * (c * second - s * first)
            coefficients[:, cosine] += radius * (c * first + s * second)
        return np.asarray(self._inputs[:, None] * coefficients @ self._projected)


def _planes(areas: Array) -> list[tuple[float, Array, Array]]:
    """Orthogonal planes of a skew matrix: an area and two unit vectors each, the largest first."""
    values, vectors = np.linalg.eigh(1j * areas)
    largest = np.abs(values).max(initial=0.0)
    planes = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        if value > SMALL * max(largest, 1e-300):
            planes.append((float(value), np.sqrt(2.0) * vector.imag, np.sqrt(2.0) * vector.real))
    return planes
