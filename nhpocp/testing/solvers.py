"""Laws of solvers: a Solution whatever happens, claims that hold, settings as plain data, the same again."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from nhpocp import planning
from nhpocp.constraints.bound import Bound
from nhpocp.errors import CallError, describe
from nhpocp.outcome import Outcome
from nhpocp.solution import Solution, Solver
from nhpocp.testing.laws import Law, agree, holds, run
from nhpocp.testing.usual import loop, straight

SAME = 1e-6  # the second may be evaluated in other ways, which round differently


def check_solver(solver: Solver) -> None:
    """Holds a solver against the laws that nhpocp's own keep, on small problems with known answers.

    solver: an instance, such as `Continuation()`, or what the `solver()` of a `SolverSettings` makes.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no solver.
    """
    if isinstance(solver, type) or not callable(getattr(solver, "solve", None)):
        raise CallError(f"expected a solver such as Auto(), got {describe(solver)}", path="solver")
    run(solver.name, LAWS, solver)


def its_settings_are_plain_data(solver: Solver) -> None:
    settings = dict(solver.settings())
    again = json.loads(json.dumps(settings, allow_nan=False))
    holds(again == settings, f"settings() gives {settings}, which JSON makes {again} of")
    asked = settings.get("tolerance")
    holds(
        asked == solver.tolerance,
        f"settings() says tolerance {asked!r}; the solver's own is {solver.tolerance!r}",
    )
    positive = isinstance(solver.tolerance, float | int) and 0 < solver.tolerance < math.inf
    holds(positive, f"its tolerance is {solver.tolerance!r}; expected a number > 0")


def it_solves_what_is_easy(solver: Solver) -> None:
    """A goal that depends on the control linearly, and one that takes a loop; verified, since a solver only claims."""
    for problem in (straight(), loop()):
        solution = planning.solve(problem, solver)
        holds(solution.converged, f"{problem.name}: {solution.outcome.value}: {solution.message}")
        _check_told(solution, solver)


def it_tells_whoever_listens(solver: Solver) -> None:
    records: list[Mapping[str, Any]] = []

    def listen(record: Mapping[str, Any]) -> None:
        records.append(record)

    solver.solve(loop(), listen)
    holds(records, "`progress` was never called")
    strange = [dict(record) for record in records if "k" not in record or "error" not in record]
    holds(not strange, f"`progress` was called with {strange[:1]}; expected k and error in every record")


def it_does_the_same_again(solver: Solver) -> None:
    one, other = solver.solve(loop()), solver.solve(loop())
    holds(one.outcome is other.outcome, f"it ends as {one.outcome.value}, then as {other.outcome.value}")
    agree("the control of a second solve", other.control.coefficients, one.control.coefficients, SAME)


def what_cannot_be_is_an_outcome(solver: Solver) -> None:
    """Bounds that no plan keeps: a Solution that claims nothing, or a claim that verification refutes; no exception."""
    problem = straight().with_(bounds=[Bound("control", "u1", -1e-3, 1e-3)])
    solution = planning.solve(problem, solver)
    holds(not solution.converged, "it drives by 1, verified, where the control may be no larger than 0.001")
    holds(solution.outcome is not Outcome.SOLVER_ERROR, f"it is at fault itself: {solution.message}")
    _check_told(solution, solver)


def _check_told(solution: Solution, solver: Solver) -> None:
    """What every solution says, however it ended."""
    problem = solution.problem
    holds(
        solution.solver == solver.name, f"its solutions are by {solution.solver!r}; expected {solver.name!r}"
    )
    same = dict(solution.settings) == dict(solver.settings()) and solution.tolerance == solver.tolerance
    holds(
        same,
        f"a solution's settings are {dict(solution.settings)}; the solver's are {dict(solver.settings())}",
    )
    holds(solution.message.strip(), "a solution has no message")
    holds(solution.evaluations >= 0 and {"build_s", "solve_s"} <= set(solution.timing), "it counts no time")
    shape = (problem.system.input_space.size, solution.control.basis.size)
    came = np.shape(solution.control.coefficients)
    holds(came == shape, f"the control's coefficients are of shape {came}; expected {shape}")
    names = ("t", *problem.system.state_space.names, *problem.system.input_space.names)
    for name in names:
        rows = len(solution.trajectory[name])
        words = f"trajectory[{name!r}] has {rows} samples; the problem asks for {problem.samples}"
        holds(rows == problem.samples, words)


LAWS: tuple[Law, ...] = (
    its_settings_are_plain_data,
    it_solves_what_is_easy,
    it_tells_whoever_listens,
    it_does_the_same_again,
    what_cannot_be_is_an_outcome,
)
