"""The verdict on a Solution: its control replayed, alone or in company, and every check of that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from nhpocp.solution import Solution, Verdict
from nhpocp.systems.numeric import NumericSystem
from nhpocp.verification.checks import Check
from nhpocp.verification.company import originals, replays
from nhpocp.verification.replay import Path, Watch, integrate


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
    paths = replays(numeric, controls, starts, first.scales.points)
    checks = [Check(solution, numeric, path) for solution, path in zip(solutions, paths, strict=True)]
    for check, original in zip(checks, _originals(checks), strict=True):
        yield check.verdict(original)


def _originals(checks: Sequence[Check]) -> list[Path | None]:
    """Paths of eq. (3) under u(t) recovered by eq. (6) along the replays of eq. (7); None where there is none."""
    problem, paths = checks[0].problem, list[Path | None]([None] * len(checks))
    actuated = problem.system.actuated()
    members = [i for i, check in enumerate(checks) if actuated and check.passes_over(actuated[0])]
    if not members or actuated is None:
        return paths
    other, feedback = actuated
    sizes = {"x": checks[0].space.size, "y": checks[0].space.size, "v": problem.system.input_space.size}
    x, driver, v = (ca.SX.sym(name, size) for name, size in sizes.items())
    function = ca.Function("original", [x, driver, v], [ca.densify(other.rate(x, feedback(driver, v)))])
    chosen = [checks[i] for i in members]
    scales = problem.scales.points

    def alone(i: int) -> Path:
        check, start = chosen[i], chosen[i].problem.start_point
        watch = Watch(other, start, vanishing=1e-5)
        return integrate(function, check.control, start, watch, scales, check.path)

    found = originals(
        other,
        function,
        [check.path for check in chosen],
        [check.control for check in chosen],
        [check.problem.start_point for check in chosen],
        scales,
        alone,
    )
    for i, path in zip(members, found, strict=True):
        paths[i] = path
    return paths
