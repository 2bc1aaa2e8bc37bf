"""The motion that a control makes, sampled for files and pictures, and what it costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.deferred import Deferred
from nhpocp.flow.step_error import enough_steps, settled_path
from nhpocp.objectives.objective import PathObjective
from nhpocp.objectives.registry import available, exact_costs
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

STEPS_AT_LEAST = 800  # where RK4's error on the paper's path is below 1e-11
STEPS_PER_PIECE = 100


@dataclass(frozen=True)
class Motion:
    """The motion that a control makes, and what it costs, as `simulate` returns it.

    trajectory: "t" (samples,) [time] and every named quantity, (samples, …) in its unit. costs: integrals by name, over
    the whole motion.
    """

    trajectory: Mapping[str, Array]
    costs: Mapping[str, float]

    def __repr__(self) -> str:
        return f"<Motion: costs {self.costs!r}, trajectory {self.trajectory!r}>"


def simulate(problem: PlanningProblem, control: Control) -> Motion:
    """The motion under a control, at ``problem.samples`` equidistant times; NaN from where it cannot be integrated.

    It is integrated when it is first looked at. The costs are trapezoidal sums over the integration's own steps
    (relative error about 1e-6), each step seeing the control's one-sided values; those of the control alone are exact.
    """
    samples = problem.samples

    @cache
    def integrated() -> tuple[Array, Array]:
        pieces = len(getattr(control.basis, "bases", (None,)))  # of a sequence
        least = enough_steps(max(STEPS_AT_LEAST, STEPS_PER_PIECE * pieces), control.basis)
        return settled_path(problem, control, (samples - 1) * -(-least // (samples - 1)))

    return Motion(
        Deferred(lambda: _sampled(problem, control, *integrated())),
        Deferred(
            lambda: _costs(problem, control, *integrated()) | exact_costs(control),
            {"effort": control.effort},
        ),
    )


def _sampled(problem: PlanningProblem, control: Control, times: Array, path: Array) -> dict[str, Array]:
    """Every named quantity at the problem's samples of a path."""
    kept = np.linspace(0.0, control.horizon, problem.samples)
    places = np.searchsorted(times, kept - 1e-9 * control.horizon)
    states = path[np.clip(places, 0, len(times) - 1)]
    numeric, rates = numeric_system(problem.system), rates_of(problem.system, control, kept)
    return {"t": kept, **numeric.trajectory(states, control(kept), problem.scale, rates)}


def rates_of(system: System, control: Control, times: Array) -> Array | None:
    """du/dt at times (k, m), where anything of a system's trajectories takes it."""
    return control.derivative(times) if system.accelerated else None


def _costs(problem: PlanningProblem, control: Control, times: Array, path: Array) -> dict[str, float]:
    """The integrals along the path."""
    numeric, steps, costs = numeric_system(problem.system), len(times) - 1, {}
    states = np.vstack([path[:-1], path[1:]])
    controls = np.vstack([control(times[:-1], "right"), control(times[1:], "left")])
    for objective in available(problem.system):
        if not isinstance(objective, PathObjective):
            continue
        values = numeric.along(objective.integrand, states, controls, problem.scale)
        costs[objective.name] = float(0.5 * np.diff(times) @ (values[:steps] + values[steps:]))
    return costs
