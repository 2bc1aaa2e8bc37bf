"""Laws of constraint kinds: bounds are read as they are written, and hold what a system has."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from nhpocp.constraints.kind import ConstraintKind
from nhpocp.constraints.written import as_written
from nhpocp.errors import expect
from nhpocp.problem import PlanningProblem
from nhpocp.systems.system import System
from nhpocp.testing.laws import Law, holds, run
from nhpocp.testing.systems import standing
from nhpocp.testing.usual import one_that_has_it


def check_constraint(kind: ConstraintKind, system: System | None = None, value: Any = None) -> None:
    """Holds a kind of constraint against the laws that nhpocp's own keep.

    kind: an instance. system: one that it is meant for; by default the first of nhpocp's that it does not refuse.
    value: as a file writes it behind the key; by default its `example`.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no kind.
    """
    expect(kind, ConstraintKind, "a constraint kind, as an instance", "kind")
    problem = standing(system or one_that_has_it(kind))
    start = {name: np.asarray(each).tolist() for name, each in problem.start.items()}
    shown = kind.shown(problem.system, start) if value is None else value
    words = f"{kind.key}: there is no example for {problem.system.model}; give check_constraint a value"
    holds(shown is not None, words)
    run(kind.key, LAWS, kind, problem, as_written(shown, kind.shape))


def it_says_what_it_is(kind: ConstraintKind, problem: PlanningProblem, value: Any) -> None:
    holds(kind.key.isidentifier(), f"the key {kind.key!r} is no name")
    holds(kind.meaning.strip(), "its meaning is empty")
    words = kind.lacking(problem.system), kind.misfit(value, problem.system)
    holds(words == ("", ""), f"{problem.system.model} and {value!r} are refused: {' '.join(words)}")


def its_bounds_bear_its_key(kind: ConstraintKind, problem: PlanningProblem, value: Any) -> None:
    for bound in kind.bounds(value, problem.system):
        own = bound.label.partition(".")[0] == kind.key
        holds(own, f"a bound is labelled {bound.label!r}; expected {kind.key}, or {kind.key}.name")


def a_problem_takes_its_bounds(kind: ConstraintKind, problem: PlanningProblem, value: Any) -> None:
    """Their quantities are blocks of the system, and the sides fit them."""
    wanted = kind.bounds(value, problem.system)
    taken = problem.with_(bounds=wanted).bounds
    holds(len(taken) == len(wanted), f"{len(wanted)} bounds were asked for, {len(taken)} are there")


def it_is_read_as_it_is_written(kind: ConstraintKind, problem: PlanningProblem, value: Any) -> None:
    system = problem.system
    bounds = kind.bounds(value, system)
    written = json.loads(json.dumps(kind.value(bounds, system)))
    again = kind.bounds(as_written(written, kind.shape), system)
    came = [(bound.label, bound.quantity) for bound in again]
    holds(
        came == [(b.label, b.quantity) for b in bounds],
        f"{value!r} is written as {written!r}, which means {came}",
    )
    for one, other in zip(bounds, again, strict=True):
        for side in ("lower", "upper"):
            limits = (np.asarray(getattr(bound, side), dtype=float) for bound in (other, one))
            read, expected = np.broadcast_arrays(*limits)
            words = f"{side} of {one.label} is {expected}; read again from {written!r} it is {read}"
            holds(np.array_equal(read, expected), words)


LAWS: tuple[Law, ...] = (
    it_says_what_it_is,
    its_bounds_bear_its_key,
    a_problem_takes_its_bounds,
    it_is_read_as_it_is_written,
)
