"""What the search for least cost asks of the continuation: e and J of controls whose paths are resolved."""

from __future__ import annotations

from typing import Any

from nhpocp.arrays import Array
from nhpocp.flow.step_error import ALLOWED, StepError
from nhpocp.solvers.continuation.evaluation import Evaluation
from nhpocp.solvers.continuation.recorded_evaluator import RecordedEvaluator
from nhpocp.solvers.least_cost.least_cost import Residual


class ResolvedResiduals:
    """Recorded evaluations, without those whose integration is much worse than that of the control to begin with."""

    def __init__(
        self, evaluate: RecordedEvaluator, step_error: StepError, first: Evaluation, tolerance: float
    ) -> None:
        self._evaluate, self._step_error = evaluate, step_error
        self.times, self.budget = evaluate.evaluator.map.times, evaluate.budget
        at_first = step_error.error(first.coefficients, first.end.state)
        self._allowed = max(ALLOWED * tolerance, 2.0 * at_first)

    def tell(self, **figures: Any) -> None:
        """Lets a listener know with the next record."""
        self._evaluate.told |= figures

    def __call__(self, coefficients: Array) -> Residual | None:
        """None where no path of use leads, or the budget is spent. Errors: Ctrl-C's."""
        try:
            tried = self._evaluate(coefficients, 0.0)
        except RuntimeError:  # a trial that CasADi cannot integrate
            if self._evaluate.interruption.noted:
                raise
            return None
        if not tried.usable or tried.residual is None or tried.jacobian is None:
            return None
        if self._step_error.error(coefficients, tried.end.state) > self._allowed:
            return None
        return Residual(tried.residual, tried.jacobian, tried.end.path)
