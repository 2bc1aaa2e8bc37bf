"""The adaptive continuation towards many goals from one start, each of its operations done for all goals at once.

The formulas are those of `Adaptive` and `MoorePenrose`, and so are the plans, to rounding. Trials are refused as there;
a goal whose search does not end at it so is left to the solver itself, which finds out why and says it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.end_point_map import DifferentiatedEndPointMap, flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import finer, resolving
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solver
from nhpocp.solvers.continuation.auto import EVALUATIONS, Auto
from nhpocp.solvers.continuation.continuation import DIVERGED_ABOVE, STAGNATION_WINDOW, Continuation
from nhpocp.solvers.continuation.generalized_inverses import NEGLIGIBLE, MoorePenrose, within_radius
from nhpocp.solvers.continuation.step_rules import KEPT, PROMISED, SMALLEST, Adaptive, next_radius
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
        return f"E = {self.error:.3g} after {self.updates} updates"


def reached_together(solver: Solver, problems: Sequence[PlanningProblem]) -> list[Reached | None]:
    """What ``solver`` finds for problems that differ in their goals only; None where it has to be asked itself.

    Of the strategies of `Auto` only the first is tried here, the problem's own start.
    """
    reached: list[Reached | None] = [None] * len(problems)
    tried = type(solver) is Auto  # whether claims are tried with finer steps
    method = _method(solver.continuation if type(solver) is Auto else solver, problems)
    if method is None:
        return reached
    limit = min(EVALUATIONS if tried else STAGNATION_WINDOW, method.solver.max_iterations)
    with Interruption() as interruption, np.errstate(all="ignore"):
        for places in _alike(problems):
            try:
                search = _Lockstep(method, [problems[place] for place in places], interruption)
                found = search.found(limit)
                found = search.confirmed(found) if tried else found
            except (np.linalg.LinAlgError, RuntimeError):  # LAPACK's, CasADi's
                found = {}  # the solver says whose goal it was
            interruption.check()
            for place, plan in found.items():
                reached[places[place]] = plan
    return reached


class _Method(NamedTuple):
    """A continuation and those of its parts whose formulas stand here again."""

    solver: Continuation
    rule: Adaptive
    inverse: MoorePenrose


def _method(solver: Solver, problems: Sequence[PlanningProblem]) -> _Method | None:
    """None for other methods, subclasses among them, and where more is asked than to drive E to zero."""
    if type(solver) is not Continuation or not problems:
        return None
    problem, rule, inverse = problems[0], solver.step_rule, solver.inverse
    by_steps = type(solver.integrator) is RungeKutta4 and solver.sensitivity is DifferentiatedEndPointMap
    bare = solver.objective == "none" and not (problem.bounds or problem.via) and problem.initial is not None
    if type(rule) is Adaptive and type(inverse) is MoorePenrose and by_steps and bare:
        return _Method(solver, rule, inverse)
    return None


def _alike(problems: Sequence[PlanningProblem]) -> list[list[int]]:
    """Places of the goals that fix the same blocks, those beyond a singular surface left out."""
    first, groups = problems[0], dict[frozenset[str], list[int]]()
    ends = np.stack([first.start_point, *(problem.goal_point for problem in problems)])
    determinants, apart = numeric_system(first.system).determinants(ends), np.zeros(len(problems), dtype=bool)
    for name in first.system.separating():
        apart |= ~(determinants[name][1:] * determinants[name][0] > 0)
    for place, problem in enumerate(problems):
        if not (apart[place] or problem.tasks[0].outputs):
            groups.setdefault(frozenset(problem.goal), []).append(place)
    return list(groups.values())


class _Here(NamedTuple):
    """The current controls of k goals and where they lead."""

    place: Array  # the goal's, (k,)
    coefficients: Array  # (k, inputs · size)
    error: Array  # E
    vector: Array  # e, dimensionless (k, r)
    jacobian: Array  # its derivative by λ, (k, r, inputs · size)
    useful: Array  # whether the path is one to go on from

    @property
    def merit(self) -> Array:
        return _length(self.vector)

    def of(self, mask: Array) -> _Here:
        """Some of the goals."""
        return _Here(*(part[mask] for part in self))

    def moved(self, mask: Array, trial: _Here) -> _Here:
        """With the trials of some goals in place of what is."""
        pairs = zip(self, trial, strict=True)
        return _Here(*(np.where(mask.reshape(-1, *[1] * (old.ndim - 1)), new, old) for old, new in pairs))


class _Steps(NamedTuple):
    """Steps inside the goals' trust regions."""

    step: Array  # δλ, (k, inputs · size)
    size: Array  # its length in the metric
    promised: Array  # what |e| should fall by
    fit: Array  # whether J has full rank and the promise is one


class _Metrics:
    """The goals' `Coordinates`, kept once where all are measured alike, as by a mechanism with a length of its own."""

    def __init__(self, solver: Continuation, problems: Sequence[PlanningProblem]) -> None:
        inputs = np.stack([problem.scales.inputs for problem in problems])
        self._alike = bool((inputs == inputs[0]).all())
        basis, horizon = problems[0].basis, problems[0].horizon.fixed
        kept = inputs[:1] if self._alike else inputs
        self._found = [Coordinates.natural(solver.metric, basis, each, horizon) for each in kept]

    def jacobian(self, places: Array, by_coefficients: Array) -> Array:
        """J over z."""
        if self._alike:
            return self._found[0].jacobian(by_coefficients)
        pairs = zip(places, by_coefficients, strict=True)
        return np.reshape([self._found[i].jacobian(each) for i, each in pairs], by_coefficients.shape)

    def coefficients(self, places: Array, z: Array) -> Array:
        if self._alike:
            return self._found[0].coefficients(z.T).T
        pairs = zip(places, z, strict=True)
        return np.reshape([self._found[i].coefficients(each) for i, each in pairs], z.shape)

    def length(self, places: Array, coefficients: Array) -> Array:
        if self._alike:
            return _length(self._found[0].of(coefficients.T).T)
        pairs = zip(places, coefficients, strict=True)
        return np.array([self._found[i].length(each) for i, each in pairs])


class _Lockstep:
    """One search, of problems that differ in their goals only."""

    def __init__(
        self, method: _Method, problems: Sequence[PlanningProblem], interruption: Interruption
    ) -> None:
        problem = problems[0]
        self.solver, self.rule, self.inverse = method
        self.problem, self.count, self.interruption = problem, len(problems), interruption
        horizon = problem.horizon.fixed
        integrator = resolving(self.solver.integrator, problem.basis)
        self.flow = flow_through(problem.system, problem.basis, horizon, integrator, ())
        self.coordinates = _Metrics(method.solver, problems)
        self.tasks = AlikeTasks([problem.tasks[0] for problem in problems])
        self.numeric = numeric_system(problem.system)

    def found(self, limit: int) -> dict[int, Reached]:
        """What was reached with no more than 1 + ``limit`` evaluations, by the goals' places. Errors: Ctrl-C's."""
        reached: dict[int, Reached] = {}
        here = self._begun()
        first, updates = here.error.copy(), np.zeros(self.count, dtype=int)
        radius = self.rule.first_radius * (1.0 + self.coordinates.length(here.place, here.coefficients))
        smallest = SMALLEST * radius
        for evaluations in range(1, limit + 2):
            arrived = here.error < self.solver.tolerance
            for at in np.flatnonzero(arrived & here.useful):
                place = int(here.place[at])
                coefficients = here.coefficients[at].reshape(*np.shape(self.problem.initial))
                reached[place] = Reached(
                    coefficients, float(here.error[at]), int(updates[place]), evaluations
                )
            lost = here.error > DIVERGED_ABOVE * (1.0 + first[here.place])
            here = here.of(here.useful & ~arrived & ~lost & (radius > smallest)[here.place])
            steps = self._steps(here, radius[here.place])
            here, steps = here.of(steps.fit), _Steps(*(part[steps.fit] for part in steps))
            if not len(here.place) or evaluations > limit:
                break
            self.interruption.check()
            trial = self._evaluated(here.place, here.coefficients + steps.step)
            kept = np.where(trial.useful, (here.merit - trial.merit) / steps.promised, -np.inf)
            radius[here.place] = next_radius(radius[here.place], steps.size, kept)
            updates[here.place] += kept > KEPT
            here = here.moved(kept > KEPT, trial)
        return reached

    def confirmed(self, reached: dict[int, Reached]) -> dict[int, Reached]:
        """Those whose controls a simulation with finer steps leads to their goals, as `claims.missed` has it."""
        problem, solver = self.problem, self.solver
        if not reached:
            return reached
        flow = flow_through(
            problem.system,
            problem.basis,
            problem.horizon.fixed,
            finer(resolving(solver.integrator, problem.basis)),
            (),
        )
        coefficients = np.stack([plan.coefficients for plan in reached.values()])
        ends = flow.ends(problem.start_point, coefficients, differentiated=False)
        errors, single = self._errors(np.array(list(reached)), ends.states)
        held = zip(reached.items(), single & (errors <= solver.tolerance), strict=True)
        return {place: plan for (place, plan), holds in held if holds}

    def _errors(self, places: Array, ends: Array) -> tuple[Array, Array]:
        """E of these goals, and which have one."""
        difference, single = self.tasks.differences(places, ends)
        return _length(self.tasks.first.weights * difference), single

    def _begun(self) -> _Here:
        """All goals at the start that they share."""
        return self._evaluated(np.arange(self.count), np.ravel(self.problem.initial)[None])

    def _evaluated(self, places: Array, coefficients: Array) -> _Here:
        """Where controls lead, one for each of these goals or one for all."""
        task, shape = self.tasks.first, np.shape(self.problem.initial)
        found = self.flow.ends(self.problem.start_point, coefficients.reshape(-1, *shape))
        useful = np.isfinite(found.states).all(axis=1) & np.isfinite(found.derivatives).all(axis=(1, 2))
        for values in self.numeric.breaking(np.concatenate(found.watched)).values():
            along = values.reshape(len(coefficients), -1)
            useful &= (along > 0).all(axis=1) | (along < 0).all(axis=1)
        parts = (coefficients, found.states, found.derivatives[:, task.rows], useful)
        coefficients, ends, jacobian, useful = (
            np.broadcast_to(part, (len(places), *part.shape[1:])) for part in parts
        )
        difference, single = self.tasks.differences(places, ends)
        scales = self.tasks.scales[places]
        return _Here(
            places,
            coefficients,
            _length(task.weights * difference),
            scales * difference,
            scales[:, :, None] * jacobian,
            useful & single,
        )

    def _steps(self, here: _Here, radius: Array) -> _Steps:
        jacobian = self.coordinates.jacobian(here.place, here.jacobian)
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        inner = within_radius(values, _times(left.swapaxes(1, 2), here.vector), radius)
        step = self.coordinates.coefficients(here.place, -_times(right.swapaxes(1, 2), inner))
        promised = here.merit - _length(here.vector - _times(left, values * inner))
        least = max(self.inverse.rank_tolerance, NEGLIGIBLE) * values[:, :1]
        full = (values > least).sum(axis=1) == here.vector.shape[1]
        size = self.coordinates.length(here.place, step)
        return _Steps(step, size, promised, full & (promised > PROMISED * here.merit))


def _times(matrices: Array, vectors: Array) -> Array:
    """A matrix times a vector for each goal."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))
