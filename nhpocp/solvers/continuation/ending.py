"""How a continuation ends, or why a path cannot be gone on from."""

from __future__ import annotations

from typing import NamedTuple

from nhpocp.outcome import Outcome


class Ending(NamedTuple):
    """An outcome and what is to be said of it, without a full stop."""

    outcome: Outcome
    sentence: str


NO_EVALUATION_LEFT = Ending(Outcome.ITERATION_LIMIT, "no evaluation is left")
