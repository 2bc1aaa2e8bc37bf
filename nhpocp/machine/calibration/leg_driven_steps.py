"""A robot's motion under the lengths of its legs, from sample to sample, with derivatives by its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import accumulated, call, side_by_side
from nhpocp.flow.tableau import CLASSICAL
from nhpocp.machine.calibration.measurements import Measurements
from nhpocp.machine.calibration.unknowns import Unknowns

STEPS = 100  # of RK4 over a run, at least


@dataclass(frozen=True)
class Bends:
    """How lengths go from one sample to the next: by w in all, l(s) - l_k - w s = s(1-s)[(1-s) m - s n], 0 ≤ s ≤ 1.

    before, after: m and n (k - 1, motors), the slopes less those of the chord [length], from what was measured.
    """

    before: Array
    after: Array

    @classmethod
    def of(cls, run: Measurements) -> Bends:
        slopes = np.gradient(run.lengths, run.times, axis=0, edge_order=2)
        spans, chords = np.diff(run.times)[:, None], np.diff(run.lengths, axis=0)
        return cls(spans * slopes[:-1] - chords, spans * slopes[1:] - chords)


@dataclass(frozen=True)
class Policy:
    """w = change - K (x ⊖ point) of every sample: points (k, size), changes (k - 1, m), gains (k - 1, m, d)."""

    points: Array
    changes: Array
    gains: Array


@dataclass(frozen=True)
class Linearised:
    """δx⁺ = A δx + B δw + D δθ + c from sample to sample, by tangent numbers.

    by_state, by_change, by_values: (k - 1, d, …); defects: c (k - 1, d), by which a step ends beside the next sample.
    """

    by_state: Array
    by_change: Array
    by_values: Array
    defects: Array


@dataclass(frozen=True)
class Observed:
    """Measured less predicted (k, d + m), pose and lengths, and what that loses by δx and δθ; 0 where nothing is."""

    residuals: Array
    by_state: Array  # (k, d + m, d)
    by_values: Array  # (k, d + m, n)


class LegDrivenSteps:
    """The equations of a robot with unknown parameters θ, as functions of numbers; made once, for any runs.

    The state x is driven by its own legs: dx/ds = G(x; θ) l'(s), where a sample's step goes from s = 0 to 1. The
    platform does not mind the time that this takes.
    """

    def __init__(self, unknowns: Unknowns) -> None:
        actuated = unknowns.system.actuated()
        driven = actuated[0] if actuated else unknowns.system
        self.space, self.motors, self.unknowns = driven.state_space, unknowns.system.motors, unknowns
        self.dimension = self.space.dimension
        self._values = ca.SX.sym(
            "values", max(1, len(unknowns))
        )  # CasADi has no symbol without entries in maps
        self._twin = driven.in_symbols(unknowns.vectors(self._values[: len(unknowns)]))  # type: ignore[attr-defined]
        self._x = ca.SX.sym("x", self.space.size)
        self._follows: dict[int, ca.Function] = {}
        tangent, other = ca.SX.sym("tangent", self.dimension), ca.SX.sym("other", self.space.size)
        moved, off = self.space.retract(self._x, tangent), self.space.difference(self._x, other)
        self._retract = ca.Function("retract", [self._x, tangent], [ca.densify(moved)])
        self._difference = ca.Function("difference", [self._x, other], [ca.densify(off)])
        self._lift = ca.Function("lift", [self._x], [ca.densify(ca.vec(self._lifted()))])
        self._lower, self._field, self._step = self._made_lower(), self._made_field(), self._made_step()
        self._observe = self._made_observe()
        self._invariants = self._made_invariants()

    @property
    def rows(self) -> int:
        """Numbers that are measured of a sample."""
        return self.dimension + self.motors

    def per_sample(self, run: Measurements) -> int:
        """Steps of RK4 from one sample to the next."""
        return ceil(STEPS / (len(run.times) - 1))

    def follow(
        self, run: Measurements, bends: Bends, values: Array, start: Array, policy: Policy
    ) -> tuple[Array, Array]:
        """States (k, size) from a start under a policy, and the changes w of the lengths, (k - 1, motors)."""
        steps = len(policy.changes)
        gains = policy.gains.reshape(steps, -1)
        given = np.repeat(self._padded(values)[None], steps, axis=0)
        follow = accumulated(self._follow(self.per_sample(run)), steps)
        points, changes = call(
            follow, start, policy.points[:-1], policy.changes, gains, bends.before, bends.after, given
        )
        return np.vstack([start, points]), changes

    def linearised(
        self, run: Measurements, bends: Bends, values: Array, points: Array, changes: Array
    ) -> Linearised:
        """Every stage of every step of RK4 with its derivatives, all samples side by side."""
        count, steps, h = self.per_sample(run), len(changes), 1.0 / self.per_sample(run)
        d, m, n, size = self.dimension, self.motors, len(self.unknowns), self.space.size
        given = np.repeat(self._padded(values)[None], steps, axis=0)
        (lifted,) = call(side_by_side(self._lift, steps), points[:-1])
        at, moved = points[:-1], np.zeros((steps, size, d + m + n))
        moved[:, :, :d] = lifted.reshape(steps, d, size).transpose(0, 2, 1)
        field = side_by_side(self._field, steps)
        for k in range(count):
            slopes: list[Array] = []
            turned: list[Array] = []
            for row, place in zip(CLASSICAL.rows, CLASSICAL.places, strict=True):
                point, change = at, moved
                for a, slope, turn in zip(row, slopes, turned, strict=True):
                    point, change = point + a * h * slope, change + a * h * turn
                bend = _bend((k + CLASSICAL.fractions[place]) / count, bends.before, bends.after)
                slope, table = call(field, point, changes + bend, given)
                whole = table.reshape(steps, size + m + max(1, n), size).transpose(0, 2, 1)
                turn = whole[:, :, :size] @ change
                turn[:, :, d:] += whole[:, :, size : size + m + n]
                slopes.append(slope)
                turned.append(turn)
            total = sum(CLASSICAL.weights)
            at = at + h / total * sum(w * s for w, s in zip(CLASSICAL.weights, slopes, strict=True))
            moved = moved + h / total * sum(w * t for w, t in zip(CLASSICAL.weights, turned, strict=True))
        lowered, defects = call(side_by_side(self._lower, steps), at, points[1:])
        whole = lowered.reshape(steps, size, d).transpose(0, 2, 1) @ moved
        by_state, by_change, by_values = np.split(whole, [d, d + m], axis=2)
        return Linearised(by_state, by_change, by_values, defects)

    def retracted(self, points: Array, tangents: Array) -> Array:
        """Each of the points (k, size) moved by a tangent vector (k, d)."""
        return call(side_by_side(self._retract, len(points)), points, tangents)[0]

    def observed(self, run: Measurements, values: Array, points: Array) -> Observed:
        count, d, m, n = len(points), self.dimension, self.motors, len(self.unknowns)
        there = run.posed
        shown = np.where(there[:, None], run.points, points)
        given = np.repeat(self._padded(values)[None], count, axis=0)
        residuals, table = call(side_by_side(self._observe, count), points, given, shown, run.lengths)
        whole = table.reshape(count, d + max(1, n), d + m).transpose(0, 2, 1)
        by_state, by_values = whole[:, :, :d].copy(), whole[:, :, d : d + n].copy()
        for array in (residuals, by_state, by_values):
            array[~there, :d] = 0.0
        return Observed(residuals, by_state, by_values)

    def invariants(self, values: Array, start: Array) -> tuple[Array, Array, Array]:
        """What has to be zero at a start (q,), and its derivatives by δx (q, d) and θ (q, n); none of most robots."""
        d, n = self.dimension, len(self.unknowns)
        if not self._invariants.numel_out(0):
            return np.zeros(0), np.zeros((0, d)), np.zeros((0, n))
        residuals, table = call(self._invariants, start, self._padded(values))
        whole = table.T
        return residuals.ravel(), whole[:, :d], whole[:, d : d + n]

    # --- functions ---

    def _padded(self, values: Array) -> Array:
        return values if len(values) else np.zeros(1)

    def _follow(self, count: int) -> ca.Function:
        """(x, point, change, K, m, n, θ) ↦ x a sample later, after so many steps of RK4, and w."""
        if count not in self._follows:
            x, old = ca.MX.sym("x", self.space.size), ca.MX.sym("old", self.space.size)
            before, after = ca.MX.sym("m", self.motors), ca.MX.sym("n", self.motors)
            change, values = ca.MX.sym("change", self.motors), ca.MX.sym("values", self._values.numel())
            gains = ca.MX.sym("gains", self.motors * self.dimension)
            w = change - ca.reshape(gains, self.dimension, self.motors).T @ self._difference(x, old)
            point = x
            for k in range(count):
                speeds = [w + _bend((k + s) / count, before, after) for s in CLASSICAL.fractions]
                point = self._step(point, *speeds, values, 1.0 / count)
            arguments = [x, old, change, gains, before, after, values]
            self._follows[count] = ca.Function("follow", arguments, [point, w])
        return self._follows[count]

    def _made_step(self) -> ca.Function:
        """(x, l' at the three places that RK4 sees, θ, h) ↦ x after a step."""
        speeds = [ca.SX.sym(f"speed_{i}", self.motors) for i in range(CLASSICAL.seen)]
        h = ca.SX.sym("h")
        point, _ = CLASSICAL.step(lambda at, place: self._twin.rate(at, speeds[place]), self._x, h)
        return ca.Function("step", [self._x, *speeds, self._values, h], [ca.densify(ca.cse(point))])

    def _made_field(self) -> ca.Function:
        """(x, u, θ) ↦ ẋ, and [∂ẋ/∂x, ∂ẋ/∂u, ∂ẋ/∂θ].

        W ξ = (u, 0) is differentiated with ξ held, as in `ParallelRobot.linearised`.
        """
        x, values, d = self._x, self._values, self.dimension
        u, held = ca.SX.sym("u", self.motors), ca.SX.sym("held", d)
        matrix = self._twin.matrix(x)
        inverse = ca.solve(matrix, ca.SX.eye(d))
        velocity = inverse[:, : self.motors] @ u
        lifted = self.space.lift(x, held)
        lift = ca.jacobian(lifted, held)
        by_both = -inverse @ ca.jacobian(matrix @ held, ca.vertcat(x, values))
        change = ca.horzcat(
            ca.jacobian(lifted, x) + lift @ by_both[:, : x.numel()],
            lift @ inverse[:, : self.motors],
            lift @ by_both[:, x.numel() :],
        )
        results = ca.substitute([lifted, ca.vec(change)], [held], [velocity])
        return ca.Function("field", [x, u, values], [ca.densify(each) for each in ca.cse(results)])

    def _lifted(self) -> ca.SX:
        """Tangent numbers ↦ the change of the packed point, size × dimension."""
        tangent = ca.SX.sym("tangent", self.dimension)
        return ca.jacobian(self.space.lift(self._x, tangent), tangent)

    def _made_lower(self) -> ca.Function:
        """(x, point) ↦ change of the packed point ↦ tangent numbers, dimension × size; and x ⊖ point."""
        rate, other = ca.SX.sym("rate", self.space.size), ca.SX.sym("other", self.space.size)
        lower = ca.vec(ca.jacobian(self.space.lower(self._x, rate), rate))
        off = self.space.difference(self._x, other)
        return ca.Function("lower", [self._x, other], [ca.densify(lower), ca.densify(off)])

    def _made_observe(self) -> ca.Function:
        shown, lengths = ca.SX.sym("shown", self.space.size), ca.SX.sym("lengths", self.motors)
        offsets = ca.vertcat(*self.unknowns.offsets(self._values))
        predicted = self._twin.actuator_positions(self._x) + offsets
        residuals = ca.densify(ca.vertcat(self.space.difference(shown, self._x), lengths - predicted))
        change = -ca.jacobian(residuals, ca.vertcat(self._x, self._values))
        table = ca.horzcat(change[:, : self.space.size] @ self._lifted(), change[:, self.space.size :])
        arguments = [self._x, self._values, shown, lengths]
        return ca.Function("observe", arguments, [residuals, ca.densify(ca.cse(ca.vec(table)))])

    def _made_invariants(self) -> ca.Function:
        held = self._twin.invariants(self._x).values()
        zeros = ca.vertcat(ca.SX(0, 1), *[value - wanted for value, wanted in held if wanted is not None])
        change = ca.jacobian(zeros, ca.vertcat(self._x, self._values))
        table = ca.horzcat(change[:, : self.space.size] @ self._lifted(), change[:, self.space.size :])
        return ca.Function("invariants", [self._x, self._values], [ca.densify(zeros), ca.densify(table)])


def _bend(s: float, before: Array, after: Array) -> Array:
    """d/ds of what `Bends` says."""
    return (1 - 4 * s + 3 * s * s) * before - (2 * s - 3 * s * s) * after
