"""The adaptive continuation towards many goals from one pose, each of its operations done for all of them at once.

The formulas are the loop's own: `Adaptive`'s trust region, `MoorePenrose`, the stop criteria, the confirmation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.step_error import resolving
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.continuation.confirmation import missed_by_each
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.generalized_inverses import Direction, MoorePenrose
from nhpocp.solvers.continuation.singularity_crossings import keeps_sign
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.continuation.stop_criteria import arrival, below_tolerance, lost
from nhpocp.solvers.continuation.trust_region import LEAST_GAIN, gain_ratio, lengths
from nhpocp.solvers.metrics import Coordinates
from nhpocp.systems.numeric import numeric_system
from nhpocp.task import AlikeTasks


@dataclass(frozen=True)
class Reached:
    """A control that reaches its goal, as the continuation claims."""

    coefficients: Array  # inputs × size
    error: float  # E
    updates: int
    evaluations: int

    @property
    def message(self) -> str:
        return arrival(self.error, self.updates)


class Method(NamedTuple):
    """A continuation whose step rule and inverse work on many goals at once."""

    solver: Continuation
    rule: Adaptive
    inverse: MoorePenrose


class _Coordinates(Coordinates):
    """Of k goals, vectors as rows; one for all where they are measured alike, as by a system with its own length."""

    def __init__(self, each: Sequence[Coordinates]) -> None:
        self._each = each

    @staticmethod
    def of_problems(solver: Continuation, problems: Sequence[PlanningProblem]) -> _Coordinates:
        inputs = np.stack([problem.scales.inputs for problem in problems])
        different = inputs[:1] if (inputs == inputs[0]).all() else inputs
        basis, horizon = problems[0].basis, problems[0].horizon.fixed
        return _Coordinates(
            [Coordinates.natural(solver.metric, basis, sizes, horizon) for sizes in different]
        )

    def at(self, places: Array) -> _Coordinates:
        """Those of some of the goals."""
        return self if len(self._each) == 1 else _Coordinates([self._each[place] for place in places])

    def jacobian(self, by_coefficients: Array) -> Array:
        if len(self._each) == 1:
            return self._each[0].jacobian(by_coefficients)
        pairs = zip(self._each, by_coefficients, strict=True)
        return np.reshape([one.jacobian(rows) for one, rows in pairs], by_coefficients.shape)

    def coefficients(self, z: Array) -> Array:
        if len(self._each) == 1:
            return self._each[0].coefficients(z.T).T
        return np.reshape([one.coefficients(row) for one, row in zip(self._each, z, strict=True)], z.shape)

    def of(self, coefficients: Array) -> Array:
        if len(self._each) == 1:
            return self._each[0].of(coefficients.T).T
        pairs = zip(self._each, coefficients, strict=True)
        return np.reshape([one.of(row) for one, row in pairs], coefficients.shape)


@dataclass(frozen=True)
class Evaluations:
    """The current controls of k goals and where they lead: what `Evaluation` is for one."""

    goal: Array  # its place among the problems, (k,)
    coefficients: Array  # (k, inputs · size)
    error: Array  # E
    residual: Array  # e, dimensionless (k, r)
    jacobian: Array  # its derivative by λ, (k, r, inputs · size)
    usable: Array  # whether the path is one to go on from

    @cached_property
    def merit(self) -> Array:
        return np.asarray(lengths(self.residual))

    def of(self, mask: Array) -> Evaluations:
        """Some of the goals."""
        return Evaluations(*(part[mask] for part in self._parts))

    def moved(self, mask: Array, trial: Evaluations) -> Evaluations:
        """With the trials of some goals in place of what is."""
        pairs = zip(self._parts, trial._parts, strict=True)
        return Evaluations(
            *(np.where(mask.reshape(-1, *[1] * (old.ndim - 1)), new, old) for old, new in pairs)
        )

    @property
    def _parts(self) -> list[Array]:
        return [getattr(self, part.name) for part in fields(self)]


class Lockstep:
    """One search, of problems that differ in their goals only."""

    def __init__(
        self, method: Method, problems: Sequence[PlanningProblem], interruption: Interruption
    ) -> None:
        problem = problems[0]
        self.solver, self.rule, self.inverse = method
        self.problem, self.count, self.interruption = problem, len(problems), interruption
        self.integrator = resolving(self.solver.integrator, problem.basis)
        self.flow = flow_through(problem.system, problem.basis, problem.horizon.fixed, self.integrator, ())
        self.coordinates = _Coordinates.of_problems(method.solver, problems)
        self.tasks = AlikeTasks([problem.tasks[0] for problem in problems])
        self.numeric = numeric_system(problem.system)

    def plans(self, budget: Budget, starts: Array | None = None) -> dict[int, Reached]:
        """All `arrivals`."""
        return {goal: plan for arrived in self.arrivals(budget, starts) for goal, plan in arrived.items()}

    def arrivals(self, budget: Budget, starts: Array | None = None) -> Iterator[dict[int, Reached]]:
        """What was reached by each of a budget of evaluations a goal, by the goals' places.

        starts: Λ₀ of each (k, inputs, size); None: the problem's own for all. Errors: Ctrl-C's.
        """
        first_coefficients = (
            np.ravel(self.problem.initial)[None] if starts is None else starts.reshape(self.count, -1)
        )
        budget.take()
        here = self._evaluated(np.arange(self.count), first_coefficients)
        first, updates = here.error.copy(), np.zeros(self.count, dtype=int)
        region = self.rule.region(lengths(self.coordinates.of(here.coefficients)))
        while True:
            arrived = below_tolerance(here.error, self.solver.tolerance)
            yield self._kept(here.of(arrived & here.usable), updates, budget)
            going = here.usable & ~arrived & ~lost(here.error, first[here.goal]) & region.open
            here, region = here.of(going), region.of(going)
            direction = self._direction(here)
            step = region.step(direction, here.residual, here.merit)
            fit = step.worthwhile & ~direction.blocked
            here, region, step = here.of(fit), region.of(fit), step.of(fit)
            if not len(here.goal) or not budget.take():
                return
            self.interruption.check()
            trial = self._evaluated(here.goal, here.coefficients + step.change)
            gain = gain_ratio(trial, step)
            region = region.after(step, gain)
            updates[here.goal] += gain > LEAST_GAIN
            here = here.moved(gain > LEAST_GAIN, trial)

    def _kept(self, arrived: Evaluations, updates: Array, budget: Budget) -> dict[int, Reached]:
        each = zip(arrived.goal, arrived.coefficients, arrived.error, strict=True)
        return {
            int(goal): Reached(
                coefficients.reshape(self._shape), float(error), int(updates[goal]), budget.taken
            )
            for goal, coefficients, error in each
        }

    def confirmed(self, plans: dict[int, Reached]) -> dict[int, Reached]:
        """Those whose controls a simulation with finer steps leads to their goals."""
        if not plans:
            return plans
        coefficients = np.stack([plan.coefficients for plan in plans.values()])
        misses = missed_by_each(
            self.problem, self.tasks, np.array(list(plans)), coefficients, self.integrator
        )
        held = zip(plans.items(), misses <= self.solver.tolerance, strict=True)
        return {goal: plan for (goal, plan), holds in held if holds}

    @property
    def _shape(self) -> tuple[int, int]:
        return self.problem.system.input_space.size, self.problem.basis.size

    def _direction(self, here: Evaluations) -> Direction:
        return self.inverse(here.jacobian, here.residual, self.coordinates.at(here.goal))

    def _evaluated(self, goals: Array, coefficients: Array) -> Evaluations:
        """Where controls lead, one for each of these goals or one for all."""
        task, shape = self.tasks.first, self._shape
        ends = self.flow.ends(self.problem.start_point, coefficients.reshape(-1, *shape))
        usable = np.isfinite(ends.states).all(axis=1) & np.isfinite(ends.derivatives).all(axis=(1, 2))
        for along in self.numeric.breaking(np.concatenate(ends.watched)).values():
            usable &= keeps_sign(along.reshape(len(coefficients), -1))
        parts = (coefficients, ends.states, ends.derivatives[:, task.rows], usable)
        coefficients, states, jacobian, usable = (
            np.broadcast_to(part, (len(goals), *part.shape[1:])) for part in parts
        )
        difference, single = self.tasks.differences(goals, states)
        scales = self.tasks.scales[goals]
        return Evaluations(
            goals,
            coefficients,
            np.asarray(lengths(task.weights * difference)),
            scales * difference,
            scales[:, :, None] * jacobian,
            usable & single,
        )
