"""What a path stays clear of while its cost falls: separating surfaces and bounds of the pose, as walls that repel."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound, in_shape
from nhpocp.flow.dynamics import Dynamics
from nhpocp.objectives.quantity import quantity
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system

NEAR = (
    0.05  # of a bound's size: how far from it the wall counts 1, which at the start a singular surface does
)
FORGIVEN = 5e-4  # of its size: by how much a bound may be passed, half of what verification forgives
LEAST_SINE = (
    2e-3  # of `System.joint_sines`: a leg turns 500 times as fast; at 1e-4 verification no longer follows
)
LONGEST = 20_000  # instructions of bounds that are written out as walls; longer ones are kept by refusing
EXPANDED = 6  # the largest matrix whose determinant is written out


@dataclass(frozen=True)
class Walls:
    """Slacks s(x), positive where a pose may be, and ∫ Σ (unit/s)² dt beside the state.

    dynamics: of (x, ∫), observed by the integral alone, the slacks watched. names: of the surfaces.
    """

    dynamics: Dynamics
    names: tuple[str, ...]


def walls(problem: PlanningProblem) -> Walls | None:
    """Those of a problem; None where a matrix is too large for its determinant to be written out."""
    system, numeric = problem.system, numeric_system(problem.system)
    start = problem.start_point
    size, inputs = system.state_space.size, system.input_space.size
    x, u, total = ca.SX.sym("x", size), ca.SX.sym("u", inputs), ca.SX.sym("b")
    slacks, terms = [], []
    matrices, at_start = numeric.matrices(x), numeric.determinants(start[None])
    for name in system.separating():
        matrix = matrices[name]
        if matrix.size1() > EXPANDED:
            return None
        slacks.append(ca.det(matrix) / float(at_start[name][0]))
        terms.append(1.0 / slacks[-1] ** 2)
    ends = zip(*(system.joint_sines(end) for end in (start, problem.goal_point)), strict=True)
    for sine, at_ends in zip(system.joint_sines(x), ends, strict=True):
        slacks.append(sine - min(LEAST_SINE, 0.5 * float(min(at_ends))))
        terms.append((NEAR / slacks[-1]) ** 2)
    for bound in problem.bounds:
        for slack in _slacks(problem, bound, x):
            slacks.append(slack + FORGIVEN)
            terms.append((NEAR / (slack + FORGIVEN)) ** 2)
    density = ca.cse(ca.SX(sum(terms, ca.SX(0)) / max(1, len(system.separating()))))
    y = ca.vertcat(x, total)
    rate = ca.densify(ca.vertcat(numeric.rate_function(x, u), density))
    both = ca.vertcat(numeric.linearised_function(x, u), ca.gradient(density, ca.vertcat(x, u)).T)
    linearised = ca.horzcat(both[:, :size], ca.SX(size + 1, 1), both[:, size:])
    only_total = ca.densify(ca.horzcat(ca.SX.zeros(1, size), 1))
    return Walls(
        Dynamics(
            ca.Function("walled_rate", [y, u], [ca.cse(rate)]),
            ca.Function("walled_linearised", [y, u], [ca.sparsify(ca.cse(linearised))]),
            ca.Function("walled_observed", [y], [only_total]),
            ca.Function("walled_slacks", [y], [ca.cse(ca.densify(ca.vertcat(ca.SX(0, 1), *slacks)))]),
        ),
        tuple(f"det {name.upper()} = 0" for name in system.separating()),
    )


def _slacks(problem: PlanningProblem, bound: Bound, x: ca.SX) -> list[ca.SX]:
    """Of a bound that the pose alone decides, one number a side and component, in units of its size."""
    if bound.margin:
        return []
    u = ca.SX.sym("u", problem.system.input_space.size)
    value = ca.densify(ca.SX(quantity(problem.system, bound.quantity, x, u)))
    if ca.depends_on(value, u) or ca.Function("value", [x], [value]).n_instructions() > LONGEST:
        return []
    shape = tuple(size for size in value.shape if size > 1)
    numbers = ca.vec(value.T)
    lower, upper, below, above = (
        np.ravel(in_shape(side, shape)) for side in (bound.lower, bound.upper, *bound.sizes)
    )
    sides: list[ca.SX] = []
    for place in range(numbers.numel()):
        if np.isfinite(lower[place]) and lower[place] < upper[place]:
            sides.append((numbers[place] - lower[place]) / below[place])
        if np.isfinite(upper[place]) and lower[place] < upper[place]:
            sides.append((upper[place] - numbers[place]) / above[place])
    return sides


def clear_of(slacks: Array) -> bool:
    """Whether a path with these slacks (samples × slacks) stays on its side of every wall."""
    return bool(np.isfinite(slacks).all() and (slacks > 0).all())
