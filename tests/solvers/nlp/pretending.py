"""An optimizer for tests of what is done with its word."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.optimizer import failed


@dataclass(frozen=True)
class Pretending:
    """It ends where it began, or beside it in every variable, with any claim."""

    claim: Outcome
    status: str = "Word"
    aside: float = 0.0
    kind = "pretending"
    takes_derivatives = False
    heeds_stops = True
    tolerance: float = 1e-6

    def settings(self) -> dict[str, Any]:
        return {"plugin": self.kind}

    def solve(self, programme: Any, start: Any, multipliers: Any = None, watch: Any = None) -> Any:
        left = failed(programme, start + self.aside, RuntimeError(self.status))
        return replace(left, outcome=self.claim, status=self.status)
