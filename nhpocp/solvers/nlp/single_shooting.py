"""Direct single shooting: the control alone is unknown, the path is rolled out from the start."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.solvers.nlp.transcription import Guess, Row, Transcription

# unknowns: beyond, differentiating the whole roll-out twice costs more than it saves
EXACT_HESSIAN_UP_TO = 40


class SingleShooting(Transcription):
    """The intervals of multiple shooting, chained: no node states, no continuity constraints.

    To be named, as in `MultipleShooting(transcription=SingleShooting)`; a solver makes it.
    """

    def _shape(self) -> None:
        interval, N = self.interval, self.intervals
        self.statics = interval.nodes - interval.dimension
        self.size = self.statics + N * interval.controls

    def _rows(self) -> list[Row]:
        labels, N = self.problem.system.state_space.tangent_labels, self.intervals
        rows = [row for k in range(N) for row in [*self._stated(k), *self._met(k)]]
        return rows + [Row(f"goal of {labels[i]}", 0.0, 0.0, 1.0) for i in self.terminal] + self._met(N)

    @cached_property
    def functions(self) -> dict[str, Any]:
        """nlp (x ↦ f, g); the derivatives are CasADi's own, through the roll-out."""
        return {"nlp": self.nlp} | ({"exact": True} if self.size <= EXACT_HESSIAN_UP_TO else {})

    @cached_property
    def nlp(self) -> ca.Function:
        interval, N, d = self.interval, self.intervals, self.interval.dimension
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", 0)
        z, statics, cost, rows = ca.MX(ca.DM.zeros(d)), x[: self.statics, :], ca.MX(0), []
        parameters = self.parameters
        for k in range(N):
            u = x[self.statics + k * interval.controls : self.statics + (k + 1) * interval.controls, :]
            stage = ca.vertcat(z, statics, u)
            cost += interval.shot.cost(stage, parameters[:, k])
            values = interval.shot.value(stage, parameters[:, k])
            z = -values[:d, :]
            rows.append(values[interval.nodes :, :])
            rows += [m.value(stage, m.parameters) for m in self.meetings if m.stage == k]
        last = [m.value(ca.vertcat(z, statics), m.parameters) for m in self._met_last]
        g = ca.vertcat(*rows, z[self.terminal.tolist()], *last)
        return ca.Function("nlp", [x, p], [cost, g], ["x", "p"], ["f", "g"])

    def pack(self, guess: Guess) -> Array:
        parts = [np.array(self._statics(guess.control))]
        if not self.basis:
            N, T = self.intervals, guess.control.horizon
            middles = guess.control((np.arange(N) + 0.5) * T / N) / self.problem.scales.inputs
            parts.append(middles.ravel())
        return np.concatenate(parts)

    def _stages(self, x: Array) -> tuple[Array, Array]:
        x = np.asarray(x).ravel()
        statics, controls = x[: self.statics], x[self.statics :].reshape(self.intervals, -1)
        local, locals_ = np.zeros(self.interval.dimension), []
        stages = []
        for k in range(self.intervals):
            stage = np.concatenate([local, statics, controls[k]])
            stages.append(stage)
            locals_.append(local)
            values = np.array(self.interval.shot.value(stage, self.parameters[:, k])).ravel()
            local = -values[: self.interval.dimension]
        return np.array(stages), np.array([*locals_, local])
