"""Many random machines steered to one goal: what feedback is worth where nobody knows the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.interruption import Interruption
from nhpocp.machine.feedback.model_errors import ModelErrors
from nhpocp.machine.feedback.planning_again import Replanner
from nhpocp.machine.feedback.simulated_plant import SimulatedPlant
from nhpocp.machine.feedback.steering import Cycle, Ending, Steered, Steering, judged
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem

QUANTILES = (0.0, 0.5, 0.9, 1.0)
STEPS = 400  # of the integration of a run


@dataclass(frozen=True)
class Machine:
    """One machine of a fleet: what of it is not as in the model, how it was steered, and where it truly ended.

    opened: true errors after the first run, which is the plan without feedback; None where there was none. closed: at
    the end.
    """

    wrong: dict[str, Any]
    steered: Steered
    opened: Cycle | None
    closed: Cycle


@dataclass(frozen=True)
class Fleet:
    """Machines in the order of their seeds, [seed, number]."""

    problem: PlanningProblem
    errors: ModelErrors
    noise: float
    seed: int
    tolerance: float
    runs: int
    machines: tuple[Machine, ...]

    @property
    def reached(self) -> int:
        """How many ended within the tolerance, as measured."""
        return sum(machine.steered.reached for machine in self.machines)

    @property
    def plan_s(self) -> float:
        """The median time of planning a cycle [s of the clock]; NaN where nothing was planned."""
        times = [
            c.plan_s for machine in self.machines for c in machine.steered.cycles if c.plan_s is not None
        ]
        return float(np.median(times)) if times else float("nan")

    def errors_at_the_end(self, name: str, feedback: bool) -> Array:
        """True errors, "error", "position_error" or "angle_error", of machines that ran; without or with feedback."""
        cycles = [machine.closed if feedback else machine.opened for machine in self.machines]
        values = [getattr(cycle, name) for cycle in cycles if cycle is not None]
        return np.array([value for value in values if value is not None], dtype=float)

    def table(self) -> dict[str, dict[str, list[float]]]:
        """Quantiles (`QUANTILES`) of the errors by name, without and with feedback."""
        rows: dict[str, dict[str, list[float]]] = {}
        for name in ("error", "position_error", "angle_error"):
            both = {
                "without": self.errors_at_the_end(name, False),
                "with": self.errors_at_the_end(name, True),
            }
            if all(len(values) for values in both.values()):
                rows[name] = {key: np.quantile(values, QUANTILES).tolist() for key, values in both.items()}
        return rows


class _Witness(SimulatedPlant):
    """A plant whose true pose is noted whenever it is measured."""

    def __init__(self, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        self.points: list[Array] = []

    def measure(self) -> dict[str, Array]:
        self.points.append(self.point)
        return super().measure()


def steer_fleet(
    problem: PlanningProblem,
    errors: ModelErrors,
    runs: int,
    steering: Steering,
    *,
    noise: float = 0.0,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Fleet:
    """Steers ``runs`` random machines (`ModelErrors.drawn`), their plans unverified; Ctrl-C keeps those that ended.

    Each begins with the plan for the model, which is made once.

    noise: as of `SimulatedPlant`. progress: called with how many are done, and of how many.
    """
    machines: list[Machine] = []
    unverified = replace(steering, verified=False, progress=None)
    step = (steering.duration or problem.horizon.fixed) / STEPS
    with Interruption() as interruption:
        plan = Replanner.of(problem, steering.tolerance, steering.objective).plan(problem)
        for number in range(runs):
            if interruption.noted:
                break
            random = np.random.default_rng([seed, number])
            system, gains, wrong = errors.drawn(random)
            noisy = [seed, number, 1]
            plant = _Witness(system, problem.start, noise=noise, gains=gains, seed=noisy, step=step)
            steered = unverified.run(problem, plant, plan if plan.outcome is Outcome.CONVERGED else None)
            if steered.outcome is Ending.INTERRUPTED and interruption.noted:
                break
            machines.append(_witnessed(problem, wrong, steered, plant))
            if progress:
                progress(len(machines), runs)
    return Fleet(problem, errors, noise, seed, steering.tolerance, runs, tuple(machines))


def _witnessed(problem: PlanningProblem, wrong: dict[str, Any], steered: Steered, plant: _Witness) -> Machine:
    points: Sequence[Array] = plant.points
    opened = judged(problem, points[1]) if len(points) > 1 else None
    return Machine(wrong, steered, opened, judged(problem, plant.point))
