"""What a machine's motion says of its parameters, while it moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError, OrientationAtPiError
from nhpocp.frozen import replace as changed
from nhpocp.machine.feedback.plant import Plant
from nhpocp.machine.feedback.simulated_plant import SimulatedPlant
from nhpocp.machine.model_errors import ModelErrors
from nhpocp.problem import PlanningProblem

SMALL = 0.1  # per cent, and degrees: of the differences that stand for derivatives
UNSEEN = 1e-3  # E per per cent, and per degree: what moves the machine less is taken as it is in the model
MOVED = 0.02  # per cent, and degrees: by which an estimate has to differ for another model to be made of it


class ModelEstimate:
    r"""The parameters with which the model would have moved as the machine did, by linear least squares:

        p, τ = argmin Σᵢ |W (xᵢ ⊖ x̂ᵢ - Jᵢ p + τ vᵢ)|² + λ² (|p|² + τ²)

    xᵢ: what was measured at time i, x̂ᵢ: where the model is at that time, which is told what the machine is told, and
    Jᵢ: how it would be elsewhere with other parameters, from a twin of it for each. p: all numbers of the system that a
    machine can miss (`ModelErrors.of_all`) [%, degrees]; τ: how far servos lag behind what they are told [% of the
    run], vᵢ: the velocity of the model; W: lengths by the problem's error_length; λ: `UNSEEN`.
    """

    def __init__(self, problem: PlanningProblem, duration: float, steps: int) -> None:
        """Of a machine that stands where the problem starts, for a run of so many steps."""
        self._problem, self._errors = problem, ModelErrors.of_all(1.0, problem.system)
        self._names = [
            (e.name, np.shape(problem.system.parameters().get(e.name, 1.0))) for e in self._errors.errors
        ]
        count = sum(int(np.prod(shape)) for _, shape in self._names)
        elsewhere = SMALL * np.vstack([np.zeros(count), np.eye(count)])
        self._twins = [self._made(p, duration / steps) for p in elsewhere]
        self._weights = np.array(problem.system.state_space.weights(problem.error_length))
        self._rows, self._residuals = [UNSEEN * np.eye(count + 1)], [np.zeros(count + 1)]
        self._used = np.zeros(count)
        self._unit = 0.01 * duration
        self._velocity = np.zeros(len(self._weights))  # of the model in the last `advance`
        self._lag = 0.0
        self._lost = False
        self.problem = problem  # that of the machine as it is known by now
        self.gains: Array | None = None  # and what it makes of its inputs, where it is told these

    def command(self, set_points: Array) -> None:
        """What the machine is told."""
        for twin in self._twins:
            twin.command(set_points)

    def advance(self, seconds: float) -> None:
        """What the machine is given; where a twin cannot follow, nothing more is learnt."""
        if self._lost:
            return
        before = self._twins[0].point
        try:
            for twin in self._twins:
                twin.advance(seconds)
            moved = self._problem.system.state_space.difference(self._twins[0].point, before)
            self._velocity = np.asarray(moved) / seconds
        except (ArithmeticError, OrientationAtPiError):
            self._lost = True

    def without_lag(self, point: Array) -> Array:
        """Where a machine that is measured at a point (size,) will be once its servos have caught up."""
        return np.asarray(self._problem.system.state_space.retract(point, self._lag * self._velocity))

    def learn(self, point: Array) -> None:
        """From where the machine is measured to be by now (size,)."""
        if self._lost:
            return
        space, (model, *twins) = self._problem.system.state_space, self._twins
        here = model.point
        try:
            residual = np.asarray(space.difference(point, here))
            columns = [np.asarray(space.difference(twin.point, here)) / SMALL for twin in twins]
            columns += [-self._unit * self._velocity]
        except OrientationAtPiError:
            return
        self._rows.append(self._weights[:, None] * np.column_stack(columns))
        self._residuals.append(self._weights * residual)
        found = np.linalg.lstsq(np.vstack(self._rows), np.concatenate(self._residuals), rcond=None)[0]
        p, self._lag = found[:-1], self._unit * float(found[-1])
        if np.abs(p - self._used).max(initial=0.0) > MOVED:
            try:
                system, self.gains, _ = self._errors.machine(self._fractions(p))
                self.problem, self._used = changed(self._problem, system=system), p
            except InvalidProblemError:  # no machine has these
                return

    def _made(self, p: Array, step: float) -> SimulatedPlant:
        system, gains, _ = self._errors.machine(self._fractions(p))
        values = None if gains is None else gains.tolist()
        return SimulatedPlant(system, self._problem.start, gains=values, step=step)

    def _fractions(self, p: Array) -> dict[str, Array]:
        fractions, left = {}, p
        for name, shape in self._names:
            count = int(np.prod(shape))
            fractions[name], left = left[:count].reshape(shape), left[count:]
        return fractions


class WatchedPlant:
    """A `Plant` of whose commands an estimate is told."""

    def __init__(self, plant: Plant, estimate: ModelEstimate) -> None:
        self._plant, self._estimate = plant, estimate

    def measure(self) -> Mapping[str, Any]:
        return self._plant.measure()

    def command(self, set_points: Array) -> None:
        self._plant.command(set_points)
        self._estimate.command(set_points)

    def advance(self, seconds: float) -> None:
        self._plant.advance(seconds)
        self._estimate.advance(seconds)
