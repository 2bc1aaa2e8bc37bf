"""A plan as what a machine is told: set-points of its actuators, and when."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

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
    def of(
        cls,
        problem: PlanningProblem,
        control: Control,
        duration: float | None = None,
        since: float = 0.0,
        point: Array | None = None,
    ) -> SetPoints:
        """Of a plan, which a driftless machine may take another ``duration`` for [time of the machine].

        since, point: of its rest only, from that time of the plan and that state on; the times stay those of a whole
        run. Errors: `ValueError` where it cannot be integrated to its end.
        """
        steps, grid = enough_steps(STEPS, control.basis), grid_since(since)
        times, path = settled_path(problem, control, steps, point, grid)
        if not np.isfinite(path).all():
            raise ValueError("the plan cannot be integrated to its end")
        wanted = grid(ceil(steps * (1 - since / control.horizon)), control.breakpoints, control.horizon)
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

    def until(self, time: float) -> SetPoints:
        """The first part, to the command that is nearest to a time."""
        last = max(1, int(np.abs(self.times - time).argmin()))
        return SetPoints(self.times[: last + 1], self.values[: last + 1], self.positions)

    def after(self, part: SetPoints) -> SetPoints:
        """What is left after a first part, `until`."""
        done = len(part.times) - 1
        return SetPoints(self.times[done:], self.values[done:], self.positions)

    def followed_by(self, rest: SetPoints) -> SetPoints:
        """This part and, from where it ends, another."""
        values = np.vstack([self.values[:-1], rest.values])
        return SetPoints(np.concatenate([self.times[:-1], rest.times]), values, self.positions)

    def backwards(self) -> SetPoints:
        """What takes a driftless machine back along its path."""
        times = self.times[-1] - self.times[::-1]
        if self.positions:
            return SetPoints(times, self.values[::-1], positions=True)
        values = np.vstack([-self.values[-2::-1], self.values[-1:]])
        return SetPoints(times, values, positions=False)

    def through(self, gains: Array | None) -> SetPoints:
        """For a machine that makes so much of its inputs (n,); None: 1."""
        if gains is None or self.positions:
            return self
        return SetPoints(self.times, self.values / gains, positions=False)

    def begun_at(self, values: Array | None) -> SetPoints:
        """Moved, so that they begin where the actuators have been told to be; inputs stay as they are."""
        if values is None or not self.positions:
            return self
        return SetPoints(self.times, self.values + (values - self.values[0]), positions=True)

    def run(
        self, plant: Plant, check: Callable[[], None] = lambda: None, *, goes_on: bool = False
    ) -> Array | None:
        """Has a machine follow them to the end; where its actuators then are told to be, None for inputs.

        check: called between two commands. goes_on: whether more follows at once; else inputs are zero in the end, and
        so they are where ``check`` or the machine raises.
        """
        if self.positions:
            plant.command(self.values[0])
            for value, seconds in zip(self.values[1:], np.diff(self.times), strict=True):
                check()
                plant.command(value)
                plant.advance(float(seconds))
            return np.array(self.values[-1])
        ended = False
        try:
            for value, seconds in zip(self.values[:-1], np.diff(self.times), strict=True):
                check()
                plant.command(value)
                plant.advance(float(seconds))
            ended = True
        finally:
            if not (ended and goes_on):
                plant.command(np.zeros_like(self.values[-1]))
        return None


def grid_since(since: float) -> Callable[[int, Array, float], Array]:
    """Times from ``since`` to the horizon, as `uniform_grid` makes them."""

    def grid(steps: int, breakpoints: Array, horizon: float) -> Array:
        if not since:
            return uniform_grid(steps, breakpoints, horizon)
        later = np.asarray(breakpoints, dtype=float)
        return since + uniform_grid(steps, later[later > since * (1 + 1e-9)] - since, horizon - since)

    return grid


@kept(most=16)
def positions_function(system: System) -> ca.Function | None:
    """x ↦ where the actuators stand, as a column; None where the inputs are what a machine is told."""
    x = ca.SX.sym("x", system.state_space.size)
    positions = system.actuator_positions(x)
    return None if positions is None else ca.Function("positions", [x], [ca.densify(ca.SX(positions))])
