"""How one start of the NLP ended, in words: the rows that are broken there, held at their limits, or no numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nhpocp.arrays import Array
from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.optimizer import Optimum
from nhpocp.solvers.nlp.transcription import Transcription

SLIGHT = 1e-6  # what a row, in its own unit, may be broken by and still be said to hold
AT_LIMIT = 1e-3  # of its size: nearer, a row is at its limit


@dataclass(frozen=True)
class Ending:
    """What an optimizer has left of a programme."""

    programme: Transcription
    optimum: Optimum

    @cached_property
    def _excess(self) -> Array:
        return excess(self.programme, self.optimum.constraints)

    @property
    def feasible(self) -> bool:
        return bool(self._excess.max(initial=0.0) <= SLIGHT)

    def sentence(self, outcome: Outcome, words: str) -> str:
        """Why there is no optimum, and what to try. words: what ended, how, after how many iterations."""
        if outcome is Outcome.NOT_FINITE:
            return f"{words}. {self._undefined()}. {outcome.advice}"
        if outcome not in (Outcome.STAGNATED, Outcome.ITERATION_LIMIT, Outcome.DIVERGED):
            return f"{words}. {outcome.advice}"
        rows, broken, pressed = self.programme.rows, self._violated(), self._pressed()
        stated = [i for i in broken if rows[i].stated]
        if stated:
            words += f". Broken there: {self._listed(stated)}"
        elif broken:
            words += f". The motion is torn there: {self._listed(broken)}"
        if pressed:
            words += f". Held at their limits there: {self._listed(pressed)}"
        advice = "Try another control.initial or solvers.nlp.initial, or more intervals"
        if names := dict.fromkeys(rows[i].name.partition("[")[0] for i in [*stated, *pressed]):
            advice += f"; or loosen {', '.join(names)}"
        if outcome is Outcome.ITERATION_LIMIT:
            # where bounds stand in the way, more of the same is the last thing to try
            advice = f"{advice}; or raise max_iterations" if names else f"Raise max_iterations. {advice}"
        return f"{words}. {advice}."

    def _listed(self, places: list[int]) -> str:
        """The first few rows in words: when, and by how much they are broken."""
        horizon = self.programme.unpack(self.optimum.x).control.horizon
        listed = []
        for i in places[:3]:
            row = self.programme.rows[i]
            listed.append(f"{row.name} at t={row.time * horizon:.4g}")
            if self._excess[i] > SLIGHT:
                listed[-1] += f" by {self._excess[i] * row.unit:.3g}"
        return "; ".join(listed)

    def _violated(self) -> list[int]:
        """Rows that do not hold, the stated ones first, most violated first."""
        rows = self.programme.rows
        places = [int(i) for i in np.flatnonzero(self._excess > SLIGHT)]
        return sorted(places, key=lambda i: (not rows[i].stated, -self._excess[i]))

    def _pressed(self) -> list[int]:
        """Stated rows that hold and are at their limit, the one of each name that pushes back most."""
        programme, values, force = self.programme, self.optimum.constraints, np.abs(self.optimum.multipliers)
        slack = np.minimum(values - programme.lower, programme.upper - values)
        near = slack <= AT_LIMIT * (1 + np.abs(values))
        strongest: dict[str, int] = {}
        for i in np.argsort(-force):
            row = programme.rows[i]
            if row.stated and self._excess[i] <= SLIGHT and (near[i] or force[i] > 1e-3 * force.max()):
                strongest.setdefault(row.name, int(i))
        return list(strongest.values())

    def _undefined(self) -> str:
        """Which constraint is not a number, at which node."""
        _, constraints = self.programme.functions["nlp"](self.optimum.x, [])
        undefined = np.flatnonzero(~np.isfinite(np.array(constraints).ravel()))
        if not undefined.size:
            return "A derivative is not a number"
        row = self.programme.rows[int(undefined[0])]
        if row.name.startswith(("goal of", "via pose")):
            return f"{row.name} is not a number: the path there is half a turn from it; try another control.initial"
        divided = " or ".join(f"det {name.upper()}" for name in self.programme.problem.system.breaking())
        why = f"; {divided}, by which the equations divide, vanishes near it" if divided else ""
        return f"{row.name} is not a number at share {row.time:.4g} of the horizon{why}"


def excess(programme: Transcription, constraints: Array) -> Array:
    """How far every constraint is outside its bounds; infinite where it is not a number."""
    outside = np.maximum(programme.lower - constraints, constraints - programme.upper)
    return np.where(np.isnan(outside), np.inf, np.maximum(outside, 0.0))
