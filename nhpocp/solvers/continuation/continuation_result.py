"""The control that a continuation ends with, and the Solution that it makes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.deferred import Deferred
from nhpocp.flow.integrators import Integrator
from nhpocp.flow.simulation import simulate
from nhpocp.flow.step_error import enough_steps
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Method, Solution

# endings of one way to the goal that say little of other ways
MISSED = (
    Outcome.ITERATION_LIMIT,
    Outcome.STAGNATED,
    Outcome.DIVERGED,
    Outcome.RANK_DEFICIENT,
    Outcome.SINGULAR_S,
    Outcome.SINGULAR_W,
    Outcome.ORIENTATION_AT_PI,
    Outcome.NOT_FINITE,
)

DEARER = 1.1  # times the least cost: what a second start leads to, and leaves a doubt of the first


@dataclass(frozen=True)
class ContinuationResult:
    """How a continuation ended, and with what control."""

    outcome: Outcome
    message: str
    error: float  # E as the continuation believes
    control: Control
    records: list[Deferred]
    details: dict[str, Any]
    build_seconds: float
    solve_seconds: float
    integrator: Integrator  # by which the error is what it is
    updates: int = 0  # that led to the control

    @property
    def rank(self) -> float:
        """The error, for choosing the best of several."""
        return self.error if np.isfinite(self.error) else np.inf

    def solution(self, solver: Method, problem: PlanningProblem) -> Solution:
        """With the motion that the control makes."""
        motion = simulate(problem, self.control)
        settings = solver.settings()
        advice = "" if self.outcome is Outcome.CONVERGED else f" {self.outcome.advice}"
        if self.outcome in MISSED and settings["step_rule"] != "auto":
            advice += " Or write `step_rule: auto`, which goes other ways by itself."
        return Solution(
            problem=problem,
            solver=solver.name,
            settings=settings,
            tolerance=solver.tolerance,
            outcome=self.outcome,
            message=f"{self.message}.{advice}",
            final_error=self.error,
            control=self.control,
            trajectory=motion.trajectory,
            costs=motion.costs,
            iterations=self.records,
            evaluations=len(self.records),
            objective=settings["objective"],
            details=self.details,
            warnings=[*_of_steps(settings, problem.basis), *_of_the_cost(settings, self.details)],
            timing={"build_s": self.build_seconds, "solve_s": self.solve_seconds},
        )


def _of_steps(settings: dict[str, Any], basis: ControlBasis) -> list[str]:
    """What is to be said of the steps of an integration that a basis asks for more of."""
    given = settings.get("steps")
    taken = given and enough_steps(given, basis)
    if taken == given or settings["integrator"] == "cvodes":
        return []
    return [
        f"{given} steps cannot resolve a control over {basis.size} functions of {basis.kind}: {taken} were taken"
    ]


def _of_the_cost(settings: dict[str, Any], details: dict[str, Any]) -> list[str]:
    """What is known of a plan that may cost much more than another, and what to try."""
    if "objective_value" not in details:
        return []
    costs = details.get("costs_of_starts", [])
    other = "another `seed`" if settings["step_rule"] == "auto" else "`step_rule: auto`"
    words, towards = [], details.get("falls_towards", [])
    if not details["stationary"] and not towards:
        words.append("the search for less ended where it still falls")
    if len(costs) > 1 and costs[1] > DEARER * costs[0]:
        words.append(
            f"of {len(costs)} plans the next costs {costs[1]:.4g}, and another start may lead to less"
        )
    cost = f"{settings['objective']} {details['objective_value']:.6g}"
    doubts = [
        f"{cost} may be far from the least: {word}; try {other}, more harmonics or the nlp solver"
        for word in words
    ]
    if towards:
        doubts.append(
            f"{cost} falls towards {' and '.join(towards)}, near which the plan runs; `constraints: {{clearance: …}}` "
            "says how far it has to stay away"
        )
    return doubts
