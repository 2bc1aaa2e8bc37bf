"""A plan as what a machine is told: set-points of its actuators, and when."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, mapped
from nhpocp.controls.control import Control
from nhpocp.flow.integrators import uniform_grid
from nhpocp.flow.step_error import enough_steps, settled_path
from nhpocp.kept import kept
from nhpocp.machine.feedback.plant import Plant
from nhpocp.problem import PlanningProblem
from nhpocp.systems.system import System

STEPS = 200  # commands of a run, at least


@dataclass(frozen=True)
class SetPoints:
    """Commands (k + 1, n) at times (k + 1,), of positions; of inputs, command i holds from time i to i + 1."""

    times: Array
    values: Array
    positions: bool

    @classmethod
    def of(cls, problem: PlanningProblem, control: Control, duration: float | None = None) -> SetPoints:
        """Of a plan, which a driftless machine may take another ``duration`` for [time].

        Errors: `ValueError` where the plan cannot be integrated to its end.
        """
        steps = enough_steps(STEPS, control.basis)
        times, path = settled_path(problem, control, steps)
        if not np.isfinite(path).all():
            raise ValueError("the plan cannot be integrated to its end")
        wanted = uniform_grid(steps, control.breakpoints, control.horizon)
        chosen = np.unique(np.searchsorted(times, wanted - 1e-9 * control.horizon).clip(0, len(times) - 1))
        times, path = times[chosen], path[chosen]  # which had to be finer for the integration only
        slower = 1.0 if duration is None else duration / control.horizon
        where = positions_function(problem.system)
        if where is not None:
            (values,) = call(mapped(where, len(times)), path)
            return cls(slower * times, values, positions=True)
        middles = 0.5 * (times[1:] + times[:-1])
        held = control(middles) / slower
        return cls(slower * times, np.vstack([held, np.zeros(held.shape[1])]), positions=False)

    def backwards(self) -> SetPoints:
        """What takes a driftless machine back along its path."""
        times = self.times[-1] - self.times[::-1]
        if self.positions:
            return SetPoints(times, self.values[::-1], positions=True)
        values = np.vstack([-self.values[-2::-1], self.values[-1:]])
        return SetPoints(times, values, positions=False)

    def begun_at(self, values: Array | None) -> SetPoints:
        """Moved, so that they begin where the actuators have been told to be; inputs stay as they are."""
        if values is None or not self.positions:
            return self
        return SetPoints(self.times, self.values + (values - self.values[0]), positions=True)

    def run(self, plant: Plant, check: Callable[[], None] = lambda: None) -> Array | None:
        """Has a machine follow them to the end; where its actuators then are told to be, None for inputs.

        check: called between two commands. Whatever it or the machine raises comes through; inputs are zero then, if
        the machine still takes that.
        """
        if self.positions:
            plant.command(self.values[0])
            for value, seconds in zip(self.values[1:], np.diff(self.times), strict=True):
                check()
                plant.command(value)
                plant.advance(float(seconds))
            return np.array(self.values[-1])
        try:
            for value, seconds in zip(self.values[:-1], np.diff(self.times), strict=True):
                check()
                plant.command(value)
                plant.advance(float(seconds))
        finally:
            plant.command(self.values[-1])
        return None


@kept(most=16)
def positions_function(system: System) -> ca.Function | None:
    """x ↦ where the actuators stand, as a column; None where the inputs are what a machine is told."""
    x = ca.SX.sym("x", system.state_space.size)
    positions = system.actuator_positions(x)
    return None if positions is None else ca.Function("positions", [x], [ca.densify(ca.SX(positions))])
