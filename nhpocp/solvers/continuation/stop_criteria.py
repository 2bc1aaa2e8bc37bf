"""What ends the continuation: the error below its tolerance, lost, rank deficient, no evaluation left, or stagnated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np

from nhpocp.outcome import Outcome
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.ending import Ending
from nhpocp.solvers.continuation.evaluation import BEYOND_NUMBERS, Evaluation
from nhpocp.solvers.continuation.generalized_inverses import Direction
from nhpocp.solvers.continuation.trust_region import Number

DIVERGED_ABOVE = 1e3  # times (1 + the first error): far outside any workspace
STAGNATION_WINDOW = 50  # updates
STAGNATION_FRACTION = 0.01  # of the decay that the step sizes predict


def below_tolerance(error: Number, tolerance: float) -> Number:
    """Whether E counts as reached; numbers or arrays."""
    return error < tolerance


def lost(error: Number, first: Number) -> Number:
    """Whether E has left every workspace, from what it was at first; numbers or arrays."""
    return error > DIVERGED_ABOVE * (1.0 + first)


def arrival(error: float, updates: int) -> str:
    """The sentence of a control that reaches the goal."""
    return f"E = {error:.3g} after {updates} updates"


@dataclass(frozen=True)
class StopCriteria:
    """Held against every control that becomes the current one. ``rows``: numbers in e."""

    tolerance: float
    rows: int
    budget: Budget

    def ending(self, here: Evaluation, accepted: Sequence[Mapping[str, Any]], updates: int) -> Ending | None:
        """Why the loop stops here, if it does. ``accepted``: the records up to this control's own."""
        begun = f"Update {updates}: "
        if here.failure:
            return Ending(here.failure.outcome, begun + here.failure.sentence)
        if below_tolerance(here.error, self.tolerance):
            return self._arrived(here, updates)
        ending = self._lost(here, accepted[0]["error"]) or self._rank_deficient(here)
        if ending:
            outcome, sentence = here.crossing or ending
            return Ending(outcome, begun + sentence)
        return self._iteration_limit(here) or self._stagnated(accepted)

    def _arrived(self, here: Evaluation, updates: int) -> Ending:
        if here.crossing:
            sentence = f"E = {here.error:.3g} is below the tolerance, but {here.crossing.sentence}"
            return Ending(here.crossing.outcome, sentence)
        return Ending(Outcome.CONVERGED, arrival(here.error, updates))

    def _lost(self, here: Evaluation, first: float) -> Ending | None:
        if not lost(here.error, first):
            return None
        return Ending(Outcome.DIVERGED, f"E = {here.error:.3g}, from {first:.3g} at the start")

    def _rank_deficient(self, here: Evaluation) -> Ending | None:
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # said in words below
                direction: Direction | None = here.direction
        except np.linalg.LinAlgError:  # finite, and no longer so in the coordinates of the metric
            return BEYOND_NUMBERS
        if direction is None or not direction.blocked:
            return None
        values = " ".join(f"{x:.2g}" for x in direction.singular_values)
        return Ending(
            Outcome.RANK_DEFICIENT,
            f"the Jacobian has rank {direction.rank} of {self.rows} (singular values {values}), E = {here.error:.3g}",
        )

    def _iteration_limit(self, here: Evaluation) -> Ending | None:
        if self.budget.left > 0:
            return None
        sentence = f"E = {here.error:.3g} after {self.budget.taken} evaluations, tolerance {self.tolerance:g}"
        return Ending(Outcome.ITERATION_LIMIT, sentence)

    def _stagnated(self, accepted: Sequence[Mapping[str, Any]]) -> Ending | None:
        """Where the error fell by less than a fraction of what the last steps predict, Σγ on the log scale."""
        if len(accepted) <= STAGNATION_WINDOW:
            return None
        errors = [record["error"] for record in accepted]
        best, before = min(errors), min(errors[:-STAGNATION_WINDOW])
        predicted = sum(record["gamma"] for record in accepted[-STAGNATION_WINDOW:])
        if best > 0 and log(before / best) >= STAGNATION_FRACTION * predicted:
            return None
        sentence = f"E = {best:.3g} at best, and no better over the last {STAGNATION_WINDOW} updates"
        return Ending(Outcome.STAGNATED, sentence)
