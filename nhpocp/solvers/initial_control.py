"""The control a solver starts from: the problem's own, or a seeded one from which the end point can move anywhere."""

from __future__ import annotations

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.end_point_map import EndPointMap
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.end_point_error import EndPointError
from nhpocp.systems.numeric import numeric_system

DRAWS = 100
SPREAD = 0.5  # of its input's natural size, the standard deviation of a coefficient: the size of the paper's own start
CONDITION_ABOVE = 1e-3  # least over largest singular value of the Jacobian; the paper's start has 3.5e-3


class NoStartError(InvalidProblemError):
    """No seeded control moves the end point in every direction."""


def initial_coefficients(problem: PlanningProblem, end_point_map: EndPointMap, seed: int) -> Array:
    """Λ₀ (inputs × size): the problem's, or for `initial: auto` a seeded one."""
    if problem.initial is not None:
        return np.array(problem.initial)
    return seeded_coefficients(problem, end_point_map, seed)


def drawn(problem: PlanningProblem, random: np.random.Generator, size: float = 1.0) -> Array:
    """Normal random coefficients (inputs × basis size); size 1 turns the mechanism by about half a radian."""
    spread = size * SPREAD * problem.scales.inputs
    return random.normal(0.0, spread[:, None], (len(spread), problem.basis.size))


def seeded_coefficients(problem: PlanningProblem, end_point_map: EndPointMap, seed: int) -> Array:
    """The first good control of a seeded sequence.

    Good: the path is finite and on one side of every singular surface, and the Jacobian's rows have full rank with room
    to spare. Errors: `NoStartError` if none of `DRAWS` controls is good.
    """
    random, numeric = np.random.default_rng(seed), numeric_system(problem.system)
    for draw in range(DRAWS):
        # later draws are smaller: a short motion stays clear of the singular surfaces around the start
        coefficients = drawn(problem, random, 0.97**draw)
        end = end_point_map(coefficients)
        if not np.isfinite(end.path).all() or not np.isfinite(end.jacobian).all():
            continue
        signs = np.sign(np.array(list(numeric.determinants(end.path).values())))
        natural = np.repeat(problem.scales.inputs, problem.basis.size)
        rows = EndPointError(problem, end).jacobian * natural
        values = np.linalg.svd(rows, compute_uv=False)
        full_rank = values.size == len(rows) and values[-1] > CONDITION_ABOVE * values[0]
        if (not signs.size or (signs == signs[:, :1]).all()) and full_rank:
            return coefficients
    raise NoStartError(
        f"no control of full rank found in {DRAWS} seeded draws; the start may be singular, or the basis too small "
        f"(it has {problem.basis.size} functions per input)",
        path="control.initial",
    )
