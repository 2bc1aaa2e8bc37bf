"""Controls from one pose to another: many tried side by side, in a few evaluations each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import resolving
from nhpocp.horizon import Horizon
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.bracket_loops import BracketLoops
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.generalized_inverses import MoorePenrose
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.solvers.continuation.lockstep_search import Lockstep, Method
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.least_cost.walls import Walls, clear_of
from nhpocp.solvers.route.loops import Loops

STEPS = 40  # of the integration
WIDTHS = (0.3, 0.7, 1.2)  # in turn, with which seeded controls are drawn
SEEDS = 32  # of these
EVALUATIONS = 15  # of each


class DirectControls:
    """Of a driftless system: corrected from `BracketLoops` and from seeded controls, over the problem's own basis."""

    def __init__(
        self, problem: PlanningProblem, solver: Continuation, walls: Walls, interruption: Interruption
    ) -> None:
        """solver: its tolerance, metric and seed are the continuation's here. walls: that no path may touch."""
        self._interruption = interruption
        kernels = RungeKutta4().kernels.for_long_work()
        integrator = resolving(RungeKutta4(STEPS, kernels=kernels), problem.basis)
        self._solver = replace(solver, integrator=integrator, objective="none")
        self._part = replace(problem, horizon=Horizon(1.0), via=(), bounds=(), initial=None)
        self._loops = BracketLoops(self._part, Loops(problem))
        self._flow = integrator.flow(walls.dynamics, problem.basis, 1.0)
        self._random = np.random.default_rng(solver.seed)

    def between(self, start: Array, goal: Mapping[str, Any]) -> list[Control]:
        """Of unit time from a pose to that of a goal's values, the cheapest first. Errors: Ctrl-C's."""
        space = self._part.system.state_space
        part = replace(self._part, start=space.unpack(start), goal=goal)
        displacement = np.asarray(space.difference(part.goal_point, start))
        starts = self._loops.seeds(start, displacement)
        starts += [drawn(part, self._random, WIDTHS[seed % len(WIDTHS)]) for seed in range(SEEDS)]
        each = arriving(self._solver, part, starts, EVALUATIONS, self._interruption)
        controls = cheapest_first(each)
        if not controls:
            return []
        ends = self._flow.ends(np.append(start, 0.0), np.array([each.coefficients for each in controls]))
        return [each for each, slacks in zip(controls, ends.watched, strict=True) if clear_of(slacks)]


def arriving(
    solver: Continuation,
    part: PlanningProblem,
    starts: Sequence[Array],
    evaluations: int,
    interruption: Interruption,
) -> Iterator[list[Control]]:
    """Those that lead to a problem's goal, as they come: what each evaluation adds, the cheapest first.

    starts: Λ₀ (inputs × size). evaluations: of each, at most. Errors: Ctrl-C's.
    """
    method = Method(solver, Adaptive(), MoorePenrose())
    search = Lockstep(method, [part] * len(starts), interruption)
    for plans in search.arrivals(Budget(evaluations), np.array(starts)):
        yield sorted((Control(part.basis, plan.coefficients) for plan in plans.values()), key=_effort)


def cheapest_first(arrivals: Iterable[list[Control]]) -> list[Control]:
    """All of them."""
    return sorted(chain.from_iterable(arrivals), key=_effort)


def _effort(control: Control) -> float:
    return control.effort
