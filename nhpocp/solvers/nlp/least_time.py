"""What is particular about least times: many local minima, controls that jump, arcs where no bound is met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nhpocp.constraints.bound import in_shape
from nhpocp.controls.control import Control
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.nlp.guesses import GuessMaker, NoGuessError

COARSER = 4  # times fewer intervals, where they are at least
COARSEST = 10
INSIDE = 1e-3  # of the distance of two bounds: further from both, neither is met
LONG = 0.05  # of the horizon


@dataclass(frozen=True)
class CoarseGuess:
    """What the same NLP finds on a quarter of the mesh, where fewer arcs are possible and so fewer local minima.

    run: of that NLP. maker: what it begins with, and the guess itself where it leads nowhere.
    """

    run: Any
    maker: GuessMaker

    @property
    def kind(self) -> str:
        return self.maker.kind

    @property
    def origin(self) -> Solution | None:
        """The plan that the coarse mesh began with."""
        plan: Solution | None = self.run.origin
        return plan

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        coarse = self.run.solve()
        if coarse.outcome is Outcome.INTERRUPTED:
            found = self.origin or coarse
            raise NoGuessError("the coarse mesh was stopped", coarse.outcome, "solvers.nlp", found)
        if coarse.outcome is not Outcome.CONVERGED:
            return self.maker.control(problem, horizon, seed)
        return coarse.control


def singular_arcs(problem: PlanningProblem, control: Control) -> str:
    """Which inputs stand between their bounds for how much of the time, in words; empty where each is at one of them.

    Pontryagin's principle leaves such an input open: it follows from derivatives of the switching function, if from
    anything, and other controls may take as little time.
    """
    times = control.horizon * (np.arange(1000) + 0.5) / 1000
    values, space, said = control(times), problem.system.input_space, []
    for bound in problem.bounds:
        if bound.quantity not in space.names:
            continue
        part = space.point_slice(bound.quantity)
        labels, numbers = space.labels[part], values[:, part]
        lower, upper = (in_shape(side, (len(labels),)) for side in (bound.lower, bound.upper))
        width = upper - lower
        inside = np.minimum(numbers - lower, upper - numbers) > INSIDE * width
        for label, share, open_width in zip(labels, inside.mean(axis=0), width, strict=True):
            if 0 < open_width < np.inf and share > LONG:
                said.append(f"{label} for {100 * share:.0f} % of the time")
    if not said:
        return ""
    where = ", ".join(said)
    return (
        f"between their bounds stand {where}: singular arcs, on which other controls may take as little time"
    )
