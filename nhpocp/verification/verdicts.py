"""The verdict on a Solution: its control replayed, alone or in company, and every check of that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from nhpocp.solution import Solution, Verdict
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.verification.checks import Check
from nhpocp.verification.company import Company, Original


def verify(solution: Solution) -> Verdict:
    """What an independent check finds; never raises for a solution that is wrong.

    ``ok`` only where the replayed end (and every via pose) is within 1.01 × the solution's tolerance, rolling and
    leg_rate are ≤ 1e-6, no determinant that the equations divide by is zero on the way, the stored trajectory is the
    replayed one, the control lasts as long as the problem says, and every bound holds on a fine grid.
    """
    return verify_many([solution])[0]


def verify_many(solutions: Sequence[Solution]) -> list[Verdict]:
    """`verify` of each. Those of one system with controls over one basis and horizon are replayed in company."""
    verdicts: dict[int, Verdict] = {}
    # a path that blows up has overflowing outputs; they are reported, not warned of
    with np.errstate(all="ignore"):
        for members in _groups(solutions):
            verdicts |= zip(members, _verdicts([solutions[i] for i in members]), strict=True)
    return [verdicts[i] for i in range(len(solutions))]


def _groups(solutions: Sequence[Solution]) -> list[list[int]]:
    """The places of solutions whose paths are those of one system under controls that differ in their coefficients."""
    groups: list[list[int]] = []
    for i, solution in enumerate(solutions):
        for group in groups:
            first = solutions[group[0]]
            if (
                solution.problem.system is first.problem.system
                and solution.problem.scale == first.problem.scale
                and solution.control.horizon == first.control.horizon
                and solution.control.basis == first.control.basis
            ):
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _verdicts(solutions: Sequence[Solution]) -> Iterator[Verdict]:
    """Of one group."""
    first = solutions[0].problem
    numeric = NumericSystem(first.system)  # afresh: what the solver keeps may be out of date
    controls = [solution.control for solution in solutions]
    starts = [solution.problem.start_point for solution in solutions]
    original = _original(first.system)
    company = Company(numeric, original, controls, starts, first.scales.points)
    for solution, (path, driven) in zip(solutions, company.followed(), strict=True):
        check = Check(solution, numeric, path)
        yield check.verdict(driven if original and check.passes_over(original.system) else None)


def _original(system: System) -> Original | None:
    """Eq. (3) under u(t) recovered by eq. (6) along a replay of eq. (7); None where there is none."""
    actuated = system.actuated()
    if actuated is None:
        return None
    other, feedback = actuated
    size = system.state_space.size
    x, driver, v = (
        ca.SX.sym(name, n) for name, n in zip("xyv", (size, size, system.input_space.size), strict=True)
    )
    rate = ca.Function("original", [x, driver, v], [ca.densify(other.rate(x, feedback(driver, v)))])
    return Original(other, rate)
