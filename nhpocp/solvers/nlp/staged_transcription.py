r"""Direct multiple shooting as a sparse NLP with its own derivative functions.

Node k carries local coordinates z_k about a reference pose x̄_k (no redundant rotation entries, no unit-norm constraint)
and the static variables c (coefficients of a basis, a free horizon), interval k its control u_k. In the order
s_0, u_0, s_1, u_1, …, s_N with s = (z, c):
    min Σ q_k    s.t.    z_{k+1} = F_k(s_k, u_k),   c_{k+1} = c_k,   rows_k(s_k, u_k) within bounds,
    z_0 at the start, z_N at the goal, r(s_k, u_k) = 0 where a via pose or an output of the pose is to be met.
F_k is RK4 in the packed coordinates between the two charts. Value, Jacobian and Hessian of one interval are mapped over
the grid (`Shots`: interpreted or compiled); the sparse matrices are filled from their blocks: nothing to colour.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.shot import Shots
from nhpocp.solvers.nlp.task_rows import TaskRows
from nhpocp.solvers.nlp.transcription import Guess, Row, Transcription


class StagedTranscription(Transcription):
    """One stage an interval: the nodes' states are variables, continuity is a constraint.

    To be named, as in `MultipleShooting(transcription=StagedTranscription)`; a solver makes it.
    """

    def _shape(self) -> None:
        interval, N = self.interval, self.intervals
        self.stage = interval.nodes + interval.controls
        self.size = N * self.stage + interval.nodes
        self.outputs = interval.nodes + len(interval.rows)  # per interval: gaps, then rows
        added = np.zeros(N, dtype=int)
        added[0] = interval.dimension  # the start
        for meeting in self._met_within:
            added[meeting.stage] += meeting.size
        # where the rows of every interval begin; the start's and the meetings' stand at its end
        self.first_rows = self.outputs * np.arange(N) + np.concatenate([[0], np.cumsum(added)[:-1]])
        self.goal_row = N * self.outputs + int(added.sum())

    @property
    def _met_within(self) -> list[TaskRows]:
        return [meeting for meeting in self.meetings if meeting.stage < self.intervals]

    def _rows(self) -> list[Row]:
        """Every constraint in order: per interval gaps, rows and what is met in it; the goal's last.

        The start's rows follow the first interval's own.
        """
        labels, statics = self.problem.system.state_space.tangent_labels, self.interval.statics
        rows, N = [], self.intervals
        for k in range(N):
            rows += [Row(f"continuity of {label} at node {k + 1}", 0.0, 0.0, (k + 1) / N) for label in labels]
            rows += [
                Row(f"static variable {i} at node {k + 1}", 0.0, 0.0, (k + 1) / N) for i in range(statics)
            ]
            rows += self._stated(k)
            if k == 0:
                rows += [Row(f"start of {label}", 0.0, 0.0, 0.0) for label in labels]
            rows += self._met(k)
        return rows + [Row(f"goal of {labels[i]}", 0.0, 0.0, 1.0) for i in self.terminal] + self._met(N)

    # --- the sparse functions -----------------------------------------------------------------------------------

    @cached_property
    def _pattern(self) -> dict[str, Any]:
        """Triplets of the Jacobian and of the Hessian's upper triangle, and where their values come from."""
        N, n, d = self.intervals, self.interval.nodes, self.interval.dimension
        stage, outputs, first_rows = self.stage, self.outputs, self.first_rows
        r, c = np.meshgrid(np.arange(outputs), np.arange(stage), indexing="ij")
        rows = [(first_rows[:, None] + r.ravel(order="F")).ravel()]
        columns = [(stage * np.arange(N)[:, None] + c.ravel(order="F")).ravel()]
        rows.append((first_rows[:, None] + np.arange(n)).ravel())  # s_{k+1}
        columns.append((stage * np.arange(1, N + 1)[:, None] + np.arange(n)).ravel())
        rows.append(outputs + np.arange(d))  # the start
        columns.append(np.arange(d))
        rows.append(self.goal_row + np.arange(len(self.terminal)))
        columns.append(N * stage + self.terminal)
        for meeting, first in zip(self.meetings, self._meeting_rows, strict=True):
            r, c = np.meshgrid(np.arange(meeting.size), np.arange(meeting.w.numel()), indexing="ij")
            rows.append(first + r.ravel(order="F"))
            columns.append(stage * meeting.stage + c.ravel(order="F"))
        sparsity, mapping = ca.Sparsity.triplet(
            len(self.rows), self.size, np.concatenate(rows).tolist(), np.concatenate(columns).tolist(), False
        )
        upper = np.triu_indices(stage)
        hessian_rows = [(stage * np.arange(N)[:, None] + upper[0]).ravel()]
        hessian_columns = [(stage * np.arange(N)[:, None] + upper[1]).ravel()]
        positions = [((upper[1] * stage + upper[0])[None, :] + stage * stage * np.arange(N)[:, None]).ravel()]
        if self._met_last:
            upper = np.triu_indices(n)
            hessian_rows.append(N * stage + upper[0])
            hessian_columns.append(N * stage + upper[1])
            positions.append(N * stage * stage + upper[1] * n + upper[0])
        hessian, hessian_mapping = ca.Sparsity.triplet(
            self.size,
            self.size,
            np.concatenate(hessian_rows).tolist(),
            np.concatenate(hessian_columns).tolist(),
            False,
        )
        return {
            "jacobian": (sparsity, list(mapping)),
            "hessian": (hessian, np.concatenate(positions)[list(hessian_mapping)].tolist()),
        }

    @property
    def _meeting_rows(self) -> list[int]:
        """The first row of every meeting."""
        names = [row.name for row in self.rows]
        return [names.index(meeting.names[0]) for meeting in self.meetings]

    @cached_property
    def _arguments(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.DM]:
        """x, p (empty), the variables w_k as columns, and p_k as columns."""
        x = ca.MX.sym("x", self.size)
        stages = ca.reshape(x[: self.intervals * self.stage], self.stage, self.intervals)
        return x, ca.MX.sym("p", 0), stages, ca.DM(self.parameters)

    @cached_property
    def nlp(self) -> ca.Function:
        return self._nlp(self.interval.shot.interpreted(self.intervals))

    @cached_property
    def shots(self) -> Shots:
        """The functions of all intervals, in the way that was asked for."""
        return self.kernels.shots(self.interval.shot, self.intervals, self._trial)

    def _trial(self) -> tuple[Array, Array]:
        """Variables and parameters (k, ·) of a few intervals, to try a kernel on."""
        few = sorted({0, self.intervals // 2, self.intervals - 1})
        return self._stages(self.pack(self.guess))[0][few], self.parameters.T[few]

    def note(self, seconds: float) -> None:
        self.shots.note(seconds)

    def _nlp(self, shots: Shots) -> ca.Function:
        x, p, stages, parameters = self._arguments
        f = ca.sum2(shots.cost(stages, parameters))
        g = self._constraints(shots.value(stages, parameters), x)
        return ca.Function("nlp", [x, p], [f, g], ["x", "p"], ["f", "g"])

    @cached_property
    def functions(self) -> dict[str, Any]:
        """nlp (x ↦ f, g), grad_f, jac_g, hess_lag with the signatures that CasADi's nlpsol takes."""
        x, p, stages, parameters = self._arguments
        N, shots = self.intervals, self.shots
        costs, gradients = shots.gradient(stages, parameters)
        gradient = ca.vertcat(ca.vec(gradients), ca.DM.zeros(self.interval.nodes))
        values, blocks = shots.jacobian(stages, parameters)
        constants = np.ones(N * self.interval.nodes + self.interval.dimension + len(self.terminal))
        met = [ca.vec(meeting.jacobian(*self._of(meeting, x))) for meeting in self.meetings]
        sparsity, mapping = self._pattern["jacobian"]
        jacobian = ca.MX(sparsity, ca.vertcat(ca.vec(blocks), ca.DM(constants), *met)[mapping])
        weight, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", len(self.rows))
        own = (self.first_rows + np.arange(self.outputs)[:, None]).ravel(order="F")
        hessians = shots.hessian(
            stages,
            parameters,
            ca.repmat(weight, 1, N),
            ca.reshape(multipliers[own.tolist()], self.outputs, N),
        )
        sparsity, mapping = self._pattern["hessian"]
        hessian = ca.MX(sparsity, self._with_meetings(hessians, x, multipliers)[mapping])
        f, g = ca.sum2(costs), self._constraints(values, x)
        return {
            "nlp": self._nlp(shots),
            "grad_f": ca.Function("nlp_grad_f", [x, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [x, p, weight, multipliers], [hessian], ["x", "p", "lam_f", "lam_g"], ["hess"]
            ),
        }

    def _constraints(self, values: ca.MX, x: ca.MX) -> ca.MX:
        n, d = self.interval.nodes, self.interval.dimension
        after = ca.horzcat(self._arguments[2][:n, 1:], x[self.intervals * self.stage :])
        gaps = ca.vertcat(values[:n, :] + after, values[n:, :])
        parts, done = [ca.vec(gaps[:, 0]), x[:d]], 1
        for meeting in self._met_within:
            parts.append(ca.vec(gaps[:, done : meeting.stage + 1]))
            done = max(done, meeting.stage + 1)
            parts.append(meeting.value(*self._of(meeting, x)))
        parts += [ca.vec(gaps[:, done:]), x[self.intervals * self.stage + self.terminal]]
        return ca.vertcat(*parts, *(meeting.value(*self._of(meeting, x)) for meeting in self._met_last))

    def _of(self, meeting: TaskRows, x: ca.MX) -> tuple[ca.MX, Array]:
        """The variables w and the parameters p of a meeting."""
        first = self.stage * meeting.stage
        return x[first : first + meeting.w.numel()], meeting.parameters

    def _with_meetings(self, hessians: ca.MX, x: ca.MX, multipliers: ca.MX) -> ca.MX:
        """The Hessians of all stages as one column, the meetings' added; the last node's own, if any, at the end."""
        added: dict[int, ca.MX] = {}
        for meeting, first in zip(self.meetings, self._meeting_rows, strict=True):
            own = meeting.hessian(*self._of(meeting, x), multipliers[first : first + meeting.size])
            added[meeting.stage] = added.get(meeting.stage, 0) + own
        columns, done = [], 0
        for stage in sorted(k for k in added if k < self.intervals):
            here = self.stage * stage
            columns += [hessians[:, done:here], hessians[:, here : here + self.stage] + added[stage]]
            done = here + self.stage
        whole = ca.vec(ca.horzcat(*columns, hessians[:, done:]))
        return ca.vertcat(whole, ca.vec(added[self.intervals])) if self.intervals in added else whole

    # --- between vectors and plans ------------------------------------------------------------------------------

    def pack(self, guess: Guess) -> Array:
        N, T = self.intervals, guess.control.horizon
        scales = self.problem.scales
        statics: list[float] = self._statics(guess.control)
        middles = guess.control((np.arange(N) + 0.5) * T / N) / scales.inputs
        parts, local = [], self.interval.coordinates(guess.states, self.references, self.units)
        for k in range(N + 1):
            parts += [local[k], statics]
            if k < N and not self.basis:
                parts.append(middles[k])
        return np.concatenate(parts)

    def _stages(self, x: Array) -> tuple[Array, Array]:
        x, split, d = np.asarray(x).ravel(), self.intervals * self.stage, self.interval.dimension
        stages = x[:split].reshape(self.intervals, self.stage)
        return stages, np.vstack([stages[:, :d], x[None, split : split + d]])

    @property
    def structure(self) -> dict[str, Any] | None:
        N, rows = self.intervals, len(self.interval.rows)
        return {
            "N": N,
            "nx": [self.interval.nodes] * (N + 1),
            "nu": [self.interval.controls] * N + [0],
            "ng": [rows + (self.interval.dimension if k == 0 else 0) + len(self._met(k)) for k in range(N)]
            + [len(self.terminal) + len(self._met(N))],
        }

    def costates(self, x: Array, multipliers: Array) -> Array | None:
        space, d = self.problem.system.state_space, self.interval.dimension
        costates = np.array([multipliers[i : i + d] for i in self.first_rows])
        with np.errstate(over="ignore", invalid="ignore"):  # of a guess that overflowed
            costates *= self.cost_unit / self.problem.scales.states
        _, locals_ = self._stages(x)
        for block in space.blocks:
            if block.kind == "rotation":  # ċ = ½ (ω + ω×c + (c·ω) c) of the Gibbs vector c, transposed
                part = space.tangent_slice(block.name)
                c, p = locals_[1:, part], costates[:, part]
                along = np.sum(c * p, axis=1, keepdims=True)
                costates[:, part] = 0.5 * (p + np.cross(c, p) + along * c)
        return costates
