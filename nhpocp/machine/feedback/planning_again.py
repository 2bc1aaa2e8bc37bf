"""The plan of a cycle: the house's continuation, from the second cycle on from a shrunken copy of the last plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nhpocp.frozen import replace as changed
from nhpocp.planning import default_solver, refused
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.confirmation import begun_from, confirmed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.metrics import Metric

FINER = 0.1  # of the tolerance of the steering: what a plan may miss by itself
SOON = 20  # updates to the goal, and steps towards the least cost, from a plan that is nearly one


@dataclass(frozen=True)
class PlannedRun:
    """A plan that was run, and E [rad] before it."""

    solution: Solution
    error: float


@dataclass(frozen=True)
class Replanner:
    """Plans from where a machine stands, each plan a `Solution` with E below ``FINER`` of the tolerance.

    The first is by `Auto`, from the problem's own start. Each other begins at √(E/E₀) Λ₀, where Λ₀ is the plan that was
    run last, from an error E₀: brackets of two inputs grow with the square of the control, so that this is about what
    the rest of the way takes, and a plan that shrinks with what is left is what makes the cycle converge, [Lucibello &
    Oriolo 2001]. From Λ₀ of full size the motion, and with it what the model gets wrong, would never become small.
    `Auto` again where that leads nowhere.
    """

    continuation: Continuation
    restarts: int

    @classmethod
    def of(cls, problem: PlanningProblem, tolerance: float, objective: str | None = None) -> Replanner:
        """The problem's own Jacobian method, as far as it says so, adaptive; ``objective``: instead of its own."""
        own: Any = default_solver(problem)
        base = own if isinstance(own, Continuation) else getattr(own, "continuation", Auto().continuation)
        base = replace(
            base,
            step_rule=base.step_rule if isinstance(base.step_rule, Adaptive) else Adaptive(),
            tolerance=FINER * tolerance,
            objective=base.objective if objective is None else objective,
        )
        return cls(base, own.restarts if isinstance(own, Auto) else Auto.restarts)

    @property
    def metric(self) -> Metric:
        """How the size of a change is measured."""
        return self.continuation.metric

    def plan(self, problem: PlanningProblem, last: PlannedRun | None = None) -> Solution:
        """From the problem's start; nothing raises that a solver can end with. Not verified."""
        auto = Auto(self.continuation, self.restarts)
        if beyond := refused(problem, auto):
            return beyond
        if last is None:
            return auto.solve(problem)
        control, smaller = (
            last.solution.control,
            np.sqrt(problem.goal_error(problem.start_point) / last.error),
        )
        if np.isfinite(smaller):
            begun = changed(begun_from(problem, control), initial=min(1.0, smaller) * control.coefficients)
            soon = replace(self.continuation, max_iterations=min(SOON, self.continuation.max_iterations))
            near = confirmed(soon, begun)
            if near.outcome.value in ("converged", "interrupted"):
                return near.solution(soon, begun)
        return auto.solve(problem)
