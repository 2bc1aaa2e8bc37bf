"""The control a solver starts from: the problem's own, or a seeded one from which the end point can move anywhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.end_point_map import EndPointMap
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.solvers.continuation.end_point_error import EndPointError
from nhpocp.systems.numeric import numeric_system

DRAWS = 100
PATIENCE = 20  # draws, after which the best so far is taken if it has full rank
# of its input's natural size, the standard deviation of a coefficient: that of the paper's own start
SPREAD = 0.5
# of SPREAD, draw after draw: short motions stay clear of the singular surfaces around the start, long ones turn far
# enough for brackets of a high degree to show, and for the many functions of a fine grid, which cancel each other
WIDTHS = (1.0, 2.0, 0.5, 4.0, 0.25, 8.0, 0.125)
ROOM = 1e-3  # conditioning of a start that is taken at once; the paper's has 3.5e-3
RANK = 1e-6  # and of one that cannot be told from a loss of rank: errors of integration alone make up to 4e-7 of it


class NoStartError(InvalidProblemError):
    """No seeded control moves the end point in every direction."""


@dataclass(frozen=True)
class Start:
    """A seeded control Λ (inputs × size) whose path is finite and on one side of every singular surface.

    conditioning: least over largest singular value of the Jacobian, lengths divided by the problem's, among rows and
    inputs; 0 where it has fewer columns than rows, 1 without inputs.
    """

    coefficients: Array
    conditioning: float

    @property
    def full_rank(self) -> bool:
        return self.conditioning > RANK


def initial_coefficients(problem: PlanningProblem, end_point_map: EndPointMap, seed: int) -> Array:
    """Λ₀ (inputs × size): the problem's, or for `initial: auto` a seeded one.

    Errors: `NoStartError` if none of `DRAWS` seeded controls has full rank.
    """
    if problem.initial is not None:
        return np.array(problem.initial)
    start = seeded_start(problem, end_point_map, seed)
    if start is not None and start.full_rank:
        return start.coefficients
    raise NoStartError(_why(problem, start), path="control.initial")


def drawn(problem: PlanningProblem, random: np.random.Generator, size: float = 1.0) -> Array:
    """Normal random coefficients (inputs × basis size); size 1 turns the mechanism by about half a radian."""
    spread = size * SPREAD * problem.scales.inputs
    return random.normal(0.0, spread[:, None], (len(spread), problem.basis.size))


def seeded_start(
    problem: PlanningProblem, end_point_map: EndPointMap, seed: int, draws: int = DRAWS
) -> Start | None:
    """The first well-conditioned control of a seeded sequence, or else the best; None if no path is of use.

    What has full rank is good enough after `PATIENCE` draws.
    """
    best: Start | None = None
    rows, columns = _size(problem)
    if not columns:  # there is but one control, and the drift decides
        return Start(np.zeros((0, problem.basis.size)), 1.0)
    for draw, start in _drawn_starts(problem, end_point_map, seed, draws):
        if start and (best is None or start.conditioning > best.conditioning):
            best = start
        if best and (best.conditioning > ROOM or (best.full_rank and draw >= PATIENCE) or columns < rows):
            break
    return best


def _drawn_starts(
    problem: PlanningProblem, end_point_map: EndPointMap, seed: int, draws: int
) -> Iterator[tuple[int, Start | None]]:
    """Draw after draw with its number, from 1; None where the path is of no use."""
    random, numeric = np.random.default_rng(seed), numeric_system(problem.system)
    columns = np.repeat(problem.scales.inputs, problem.basis.size)
    for draw in range(1, draws + 1):
        coefficients = drawn(problem, random, WIDTHS[(draw - 1) % len(WIDTHS)])
        with np.errstate(all="ignore"):  # a wide draw may run away
            end = end_point_map(coefficients)
        if not np.isfinite(end.path).all() or not np.isfinite(end.jacobians).all():
            yield draw, None
            continue
        signs = np.sign(np.array(list(numeric.determinants(end.path).values())))
        if signs.size and (signs != signs[:, :1]).any():
            yield draw, None
            continue
        with np.errstate(over="ignore"):
            jacobian = EndPointError(problem, end).jacobian * columns
        if not np.isfinite(jacobian).all():
            yield draw, None
            continue
        values = svd(jacobian, compute_uv=False)
        known = values.size == len(jacobian) and values[0] > 0
        yield draw, Start(coefficients, float(values[-1] / values[0]) if known else 0.0)


def _size(problem: PlanningProblem) -> tuple[int, int]:
    """Rows and columns of the Jacobian."""
    return sum(task.size for task in problem.tasks), problem.system.input_space.size * problem.basis.size


def _why(problem: PlanningProblem, best: Start | None) -> str:
    """Why no start was found, as far as that is known, and what to try."""
    rows, columns = _size(problem)
    functions = f"{problem.basis.size} functions per input"
    if columns < rows:
        return f"no control of full rank: {functions} make {columns} numbers, and {rows} have to be met; take more"
    widths = (
        f"{DRAWS} seeded draws, {min(WIDTHS) * SPREAD:.2g} to {max(WIDTHS) * SPREAD:.2g} rad a coefficient"
    )
    if best is None:
        return (
            f"no control found in {widths}, whose path is finite and stays on one side of every singular surface; "
            "write one, or begin elsewhere"
        )
    return (
        f"no control of full rank found in {widths}: the best Jacobian has σ_min/σ_max = {best.conditioning:.2g}, "
        f"lengths divided by {problem.scales.length:.4g}, and below {RANK:g} that cannot be told from a loss of rank; "
        f"more functions than {functions} or a control of your own may do better"
    )
