"""Evaluations as a solve makes them: within a budget, each with a record, and a listener told of it."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.deferred import Deferred
from nhpocp.interruption import Interruption
from nhpocp.solution import Progress
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.ending import NO_EVALUATION_LEFT
from nhpocp.solvers.continuation.evaluation import Evaluation, Evaluator
from nhpocp.solvers.continuation.step_rules import StepRule
from nhpocp.solvers.continuation.stop_criteria import below_tolerance


class RecordedEvaluator:
    """Where a control leads; every call leaves a record, which counts as refused until the control is accepted.

    ``updates``: those before the first control, where this solve goes on with another's.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        budget: Budget,
        step_rule: StepRule,
        tolerance: float,
        progress: Progress | None,
        updates: int,
    ) -> None:
        self.evaluator, self.budget, self.interruption = evaluator, budget, Interruption()
        self.updates = updates
        self.records: list[Deferred] = []
        self.accepted: list[Deferred] = []
        self.here: Evaluation | None = None  # the current control's
        self.phase = f"to the goal ({step_rule.kind})"
        self.told: dict[str, Any] = {}  # of the search at the goal, for a listener
        self._step_rule, self._tolerance, self._progress = step_rule, tolerance, progress

    def __call__(self, coefficients: Array, gamma: float) -> Evaluation:
        """One evaluation of the budget; where none is left, one that has failed. Errors: Ctrl-C's."""
        self.interruption.check()
        if not self.budget.take() and self.here:
            return Evaluation(coefficients, self.here.end, np.inf, failure=NO_EVALUATION_LEFT)
        if self.records and not self.records[-1]["accepted"]:
            self.records[-1] |= {"k": self.updates}  # it was a trial, and refused
        evaluation = self.evaluator(coefficients)
        change = norm((coefficients - self.here.coefficients).ravel()) if self.here else 0.0
        known = {
            "k": self.updates + (self.here is not None),
            "error": evaluation.error if np.isfinite(evaluation.error) else None,
            "step": float(change),
            "gamma": float(gamma),
            "accepted": False,
        }
        self.records.append(Deferred(partial(self.evaluator.looked_at, evaluation), known))
        if self._progress:
            self._progress(self.records[-1] | self._prospect(evaluation.error))
        return evaluation

    def accept(self, evaluation: Evaluation) -> None:
        """Makes an evaluated control the current one; the last record is its own."""
        self.updates += self.here is not None
        self.here = evaluation
        self.records[-1] |= {"k": self.updates, "accepted": True}
        self.accepted.append(self.records[-1])

    def _prospect(self, error: float) -> dict[str, Any]:
        """What a listener is told besides, see `Progress`."""
        at_the_goal = self.here is not None and below_tolerance(self.here.error, self._tolerance)
        return {
            "tolerance": self._tolerance,
            "phase": self.phase,
            "at_most": self.budget.left,
            "expected": None if at_the_goal else self._step_rule.updates_left(error, self._tolerance),
            **self.told,
        }
