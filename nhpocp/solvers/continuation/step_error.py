"""Whether an integrator's steps resolve a path, so that a search does not gain by its errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import Flow, Integrator, RungeKutta4
from nhpocp.problem import PlanningProblem

RICHARDSON = 15.0  # 2⁴ - 1: a step of order 4 with half the steps is wrong by so much more


class StepError:
    """How wrong the end of a path is, estimated from the same path with half the steps [E's unit].

    Near det S = 0 the position moves at next to no cost, and fixed steps jump across: there least effort would be an
    artefact. Integrators that choose their own steps are taken at their word.
    """

    def __init__(self, problem: PlanningProblem, integrator: Integrator, horizon: float) -> None:
        self._problem = problem
        self._coarse: Flow | None = None
        if isinstance(integrator, RungeKutta4):
            half = replace(integrator, steps=max(1, integrator.steps // 2))
            self._coarse = half.flow(dynamics(problem.system), problem.basis, horizon)

    def error(self, coefficients: Array, end: Array) -> float:
        """Of the end point ``end`` (packed) under a control; infinite where the coarse path has no end."""
        if self._coarse is None:
            return 0.0
        coarse = self._coarse.end(self._problem.start_point, coefficients)
        if not np.isfinite(coarse).all():
            return np.inf
        space = self._problem.system.state_space
        change = space.lower(end, coarse - end)  # both are near; no logarithm is needed
        return (
            float(np.linalg.norm(np.asarray(space.weights(self._problem.error_length)) * change)) / RICHARDSON
        )
