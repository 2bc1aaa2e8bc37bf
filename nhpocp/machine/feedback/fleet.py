"""Many random machines steered to one goal: what feedback is worth where nobody knows the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.interruption import Interruption
from nhpocp.machine.feedback.planning_again import Replanner
from nhpocp.machine.feedback.plant import Workshop
from nhpocp.machine.feedback.steering import Cycle, Ending, Steered, Steering, judged
from nhpocp.machine.model_errors import ModelErrors
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem

QUANTILES = (0.0, 0.5, 0.9, 1.0)


@dataclass(frozen=True)
class Machine:
    """One machine of a fleet: what of it is not as in the model, how it was steered, and where it truly ended.

    opened: true errors after the first plan alone, run by a twin of it; None where there was none. closed: at the end.
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
    workshop: Workshop
    seed: int
    tolerance: float
    runs: int
    machines: tuple[Machine, ...]

    @property
    def reached(self) -> int:
        """How many ended within the tolerance, as measured."""
        return sum(machine.steered.reached for machine in self.machines)

    @property
    def outcome(self) -> str:
        """All in one word."""
        if len(self.machines) < self.runs:
            return Ending.INTERRUPTED.value
        return Ending.REACHED.value if self.reached == self.runs else "not_all_reached"

    @property
    def plan_s(self) -> float:
        """The median time of planning a cycle [s of the clock]; NaN where nothing was planned."""
        times = [
            c.plan_s for machine in self.machines for c in machine.steered.cycles if c.plan_s is not None
        ]
        return float(np.median(times)) if times else float("nan")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of each bound that was broken on the way by how many machines, and the worst place of all."""
        broken = [
            (number, cycle, report)
            for number, machine in enumerate(self.machines)
            for cycle, report in machine.steered.broken
        ]
        sentences = []
        for label in dict.fromkeys(report.bound.label for *_, report in broken):
            those = [each for each in broken if each[2].bound.label == label]
            number, cycle, worst = max(those, key=lambda each: each[2].worst / each[2].allowed)
            count = len({each[0] for each in those})
            sentences.append(
                f"{label} was not kept by {count} of {len(self.machines)} machines, the worst machine {number} in "
                f"cycle {cycle}: {worst.broken_words()}"
            )
        return tuple(sentences)

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


def steer_fleet(
    problem: PlanningProblem,
    errors: ModelErrors,
    runs: int,
    steering: Steering,
    workshop: Workshop,
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Fleet:
    """Steers ``runs`` random machines (`ModelErrors.drawn`), their plans unverified; Ctrl-C keeps those that ended.

    Each begins with the plan for the model, which is made once.

    progress: called with how many are done, and of how many.
    """
    machines: list[Machine] = []
    unverified = replace(steering, verified=False, progress=None)
    with Interruption() as interruption:
        plan = Replanner.of(problem, steering.tolerance, steering.objective).plan(problem)
        begun = plan if plan.outcome is Outcome.CONVERGED else None
        for number in range(runs):
            if interruption.noted:
                break
            random = np.random.default_rng([seed, number])
            system, gains, wrong = errors.drawn(random)
            plant = workshop.made(system, gains, [seed, number, 1])
            steered = unverified.run(problem, plant, begun)
            twin = workshop.made(system, gains, [seed, number, 1])
            alone = replace(unverified, cycles=1, rate=None).run(problem, twin, begun)
            if Ending.INTERRUPTED in (steered.outcome, alone.outcome) and interruption.noted:
                break
            opened = judged(problem, twin.point) if len(alone.cycles) > 1 else None
            machines.append(Machine(wrong, steered, opened, judged(problem, plant.point)))
            if progress:
                progress(len(machines), runs)
    return Fleet(problem, errors, workshop, seed, steering.tolerance, runs, tuple(machines))
