"""Iterative steering: plan, run, measure, and plan the rest again from there. [Lucibello & Oriolo 2001]"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from time import perf_counter
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import BoundReport
from nhpocp.constructed import Constructed
from nhpocp.declared import check, count, positive
from nhpocp.errors import CallError, InvalidProblemError, OrientationAtPiError, describe
from nhpocp.frozen import replace as changed
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.machine.feedback.executed_path import ExecutedPath, RecordedPlant
from nhpocp.machine.feedback.guarded_plant import GuardedPlant, PlantError
from nhpocp.machine.feedback.model_estimate import ModelEstimate, WatchedPlant
from nhpocp.machine.feedback.planning_again import FINER, PlannedRun, Replanner
from nhpocp.machine.feedback.plant import Plant
from nhpocp.machine.feedback.set_points import STEPS, SetPoints
from nhpocp.machine.feedback.under_way import LAST, corrected
from nhpocp.objectives.registry import costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.verification import verify

PROGRESS = 0.95  # of the error before: what a cycle has to end below


class Ending(Enum):
    """How a steering can end."""

    REACHED = "reached"
    CYCLE_LIMIT = "cycle_limit"
    NO_PROGRESS = "no_progress"
    PLAN_FAILED = "plan_failed"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Cycle:
    """What was measured after a run, and of the plan that was run; the first is before any run, and has no plan.

    error: E [rad]; position_error [length], angle_error [rad]: of the goal's parts, None where it has none. plan_s:
    seconds of the clock. plan: the `Solution`. returned: whether the machine was taken back, for this run had made the
    error larger, and to what E (None: it was not). corrections: of the rest of the plan, under way. path: that the
    machine made, to where it was measured, and how it kept the problem's bounds; None where nobody knows it, as of a
    machine outside the computer, or nothing is bounded.
    """

    measured: Mapping[str, Any]
    error: float
    position_error: float | None
    angle_error: float | None
    plan: Solution | None = None
    plan_s: float | None = None
    returned: float | None = None
    corrections: int = 0
    path: ExecutedPath | None = field(default=None, repr=False)

    def to_json(self) -> dict[str, Any]:
        """Plain data of steer.json."""
        plan = self.plan
        return {
            "error": self.error,
            "position_error": self.position_error,
            "angle_error": self.angle_error,
            "plan_s": self.plan_s,
            "plan_outcome": plan.outcome.value if plan else None,
            "effort": plan.control.effort if plan else None,
            "evaluations": plan.evaluations if plan else None,
            "corrections": self.corrections,
            "returned": self.returned,
            "broken": None if self.path is None else len(self.path.broken),
            "measured": dict(self.measured),
        }


@dataclass(frozen=True)
class Steered:
    """How a steering ended.

    problem: that was steered. tolerance: E [rad] that counts as reached. outcome: an `Ending`. message: the same in a
    sentence. cycles: a `Cycle` for each measurement after a run, and the first before any. refused: the plan that
    failed, where one did. unfinished: the path of the run that was interrupted, as a cycle's.
    """

    problem: PlanningProblem
    tolerance: float
    outcome: Ending
    message: str
    cycles: tuple[Cycle, ...]
    refused: Solution | None = None
    unfinished: ExecutedPath | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        error = f", E = {self.cycles[-1].error:.3g}" if self.cycles else ""
        return f"<Steered {self.outcome.value} after {max(len(self.cycles) - 1, 0)} cycles{error}>"

    @property
    def reached(self) -> bool:
        return self.outcome is Ending.REACHED

    @property
    def broken(self) -> tuple[tuple[int, BoundReport], ...]:
        """Bounds of the problem that the machine did not keep on its way, each with the number of the cycle."""
        paths = [*(cycle.path for cycle in self.cycles[1:]), self.unfinished]
        return tuple((k, report) for k, path in enumerate(paths, 1) if path for report in path.broken)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The same in sentences."""
        return tuple(f"cycle {k}: {report.broken_words()}" for k, report in self.broken)

    @property
    def error(self) -> float:
        """E where the machine stands, as measured last; NaN where it never was."""
        if not self.cycles:
            return float("nan")
        last = self.cycles[-1]
        return last.error if last.returned is None else last.returned


@dataclass(frozen=True)
class Steering(Constructed):
    """Brings a machine to a goal by plans that are made again from where it is found to stand.

    tolerance: E [rad] that counts as reached, by measurement. cycles: runs at most. objective: what each plan
    minimises, None: as the problem's own method. duration: of a run [time of the machine], None: the problem's horizon;
    driftless systems only. patience: seconds of the clock after which a method of the plant counts as failed, None: it
    is waited for. verified: whether each plan is verified before it is run. settling: how long the machine is given to
    come to rest before it is measured between two runs [its time]. rate: how often in a unit of the machine's time the
    rest of the first plan is corrected from a measurement under way, None: never.
    Errors: `InvalidProblemError` for numbers that are none.
    """

    tolerance: float = positive(1e-3, "the error E at which to stop")
    cycles: int = count(6, "runs at most")
    objective: str | None = None
    duration: float | None = None
    patience: float | None = None
    verified: bool = True
    rate: float | None = None
    settling: float = 0.0
    progress: Callable[[Cycle], None] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check(self)
        known = ["none", *costs_of_motion()]
        if self.objective is not None and self.objective not in known:
            words = f"{self.objective!r} is none of {', '.join(known)}"
            raise InvalidProblemError(words, path="Steering.objective")
        for name in ("duration", "patience", "rate"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InvalidProblemError(
                    f"{describe(value)}; expected a number > 0", path=f"Steering.{name}"
                )
        if not self.settling >= 0:
            words = f"{describe(self.settling)}; expected a number >= 0"
            raise InvalidProblemError(words, path="Steering.settling")

    def with_progress(self, progress: Callable[[Cycle], None] | None) -> Steering:
        """This steering, which tells somebody of every cycle that it measures."""
        return replace(self, progress=progress)

    def run(self, problem: PlanningProblem, plant: Plant, plan: Solution | None = None) -> Steered:
        """From where the machine stands to the problem's goal; ``plan``: from near there, to begin planning with.

        What the plant raises, and Ctrl-C, end it as `interrupted`; what was measured is kept. Errors: `CallError` for
        what is no plant, `InvalidProblemError` for a problem whose horizon is free, or a duration for a drift.
        """
        if not isinstance(plant, Plant):
            words = f"expected a plant with measure(), command(set_points) and advance(seconds), got {describe(plant)}"
            raise CallError(words, path="plant")
        if self.duration is not None and not problem.system.driftless:
            words = f"{problem.system.model} has a drift, which knows its own time only"
            raise InvalidProblemError(words, path="Steering.duration")
        problem.horizon.fixed  # noqa: B018 - errors where there is none
        return _Run(self, problem, GuardedPlant(plant, self.patience), plan).result()


class _Run:
    """One steering of one machine."""

    def __init__(
        self, steering: Steering, problem: PlanningProblem, plant: GuardedPlant, plan: Solution | None
    ) -> None:
        self.steering, self.problem, self.begun = steering, problem, plan
        self.plant = RecordedPlant(plant, problem)
        self.replanner = Replanner.of(problem, steering.tolerance, steering.objective)
        self.cycles: list[Cycle] = []
        self.refused: Solution | None = None
        self.told: Array | None = None  # where the actuators are told to be

    def result(self) -> Steered:
        with Interruption() as interruption:
            self.check = interruption.check
            try:
                outcome, message = self._cycles()
            except KeyboardInterrupt:
                outcome, message = Ending.INTERRUPTED, f"{STOPPED}; the machine stands where it is"
            except PlantError as error:
                outcome, message = Ending.INTERRUPTED, f"The machine failed: {error}"
        steering = self.steering
        cycles, unfinished = tuple(self.cycles), self.plant.ended()
        return Steered(
            self.problem, steering.tolerance, outcome, f"{message}.", cycles, self.refused, unfinished
        )

    def _cycles(self) -> tuple[Ending, str]:
        """Until one of the endings."""
        tolerance = self.steering.tolerance
        here = self._at_rest()
        self._keep(judged(self.problem, here.start_point))
        last = PlannedRun(self.begun, self.cycles[0].error) if self.begun else None
        while True:
            before, runs = self.cycles[-1].error, len(self.cycles) - 1
            if before <= tolerance:
                return Ending.REACHED, f"E = {before:.3g} after {runs} cycles"
            if runs == self.steering.cycles:
                return Ending.CYCLE_LIMIT, f"E = {before:.3g} after {runs} cycles, the limit"
            began = perf_counter()
            plan = self.replanner.plan(here, last)
            seconds = perf_counter() - began
            if plan.outcome is Outcome.INTERRUPTED:
                raise KeyboardInterrupt
            if self.steering.verified and plan.outcome is Outcome.CONVERGED:
                plan = plan.judged(verify(plan))
            if plan.outcome is not Outcome.CONVERGED:
                self.refused = plan
                words = (
                    f"The plan of cycle {runs + 1} failed, and the machine stays where it is: {plan.message}"
                )
                return Ending.PLAN_FAILED, words.rstrip(".")
            self.plant.begin()
            run, corrections = self._run(plan)
            here = self._at_rest()
            cycle = replace(
                judged(self.problem, here.start_point), plan=plan, plan_s=seconds, corrections=corrections
            )
            if not cycle.error <= before:
                return self._undone(cycle, before, run)
            self._keep(cycle)
            if cycle.error > max(tolerance, PROGRESS * before):
                return (
                    Ending.NO_PROGRESS,
                    f"E = {before:.3g} before cycle {runs + 1}, {cycle.error:.3g} after it",
                )
            last = PlannedRun(plan, before)

    def _undone(self, cycle: Cycle, before: float, run: SetPoints) -> tuple[Ending, str]:
        """A run that led away from the goal is run backwards, where the machine is driftless."""
        words = f"E = {before:.3g} before cycle {len(self.cycles)}, {cycle.error:.3g} after it"
        if not self.problem.system.driftless:
            self._keep(cycle)
            return Ending.NO_PROGRESS, words
        try:
            self._follow(run.backwards())
            cycle = replace(cycle, returned=judged(self.problem, self._at_rest().start_point).error)
        finally:
            self._keep(cycle)
        return Ending.NO_PROGRESS, f"{words}; taken back along its path to E = {cycle.returned:.3g}"

    def _run(self, plan: Solution) -> tuple[SetPoints, int]:
        """Has the machine run a plan, corrected under way; what it was told, and how many corrections there were."""
        steering, control, corrections = self.steering, plan.control, 0
        duration = steering.duration or control.horizon
        run = SetPoints.of(plan.problem, control, duration).begun_at(self.told)
        times = self._corrected_at(duration)
        if not len(times):
            self._follow(run)
            return run, 0
        estimate = ModelEstimate(changed(self.problem, start=plan.problem.start), duration, STEPS)
        watched = WatchedPlant(self.plant, estimate)
        done: SetPoints | None = None
        for time in times:
            if time <= run.times[0]:  # a command lasts longer than that
                continue
            part = run.until(time)
            self._follow(part, watched, goes_on=True)
            done = part if done is None else done.followed_by(part)
            since = float(part.times[-1]) * control.horizon / duration
            point = self._from_here().start_point
            estimate.learn(point)
            point = estimate.without_lag(point)
            near = FINER * steering.tolerance
            correction = corrected(estimate.problem, control, since, point, near, self.replanner.metric)
            if correction is None:
                run = run.after(part)
                continue
            control, corrections = correction.control, corrections + 1
            rest = SetPoints.of(estimate.problem, control, duration, since, point)
            run = rest.through(estimate.gains).begun_at(self.told)
        self._follow(run)
        return (run if done is None else done.followed_by(run)), corrections

    def _corrected_at(self, duration: float) -> Array:
        """Times of the first run [time of the machine] at which its rest is corrected; the last part is left alone."""
        if self.steering.rate is None or len(self.cycles) > 1:
            return np.empty(0)
        return np.arange(1, int(LAST * duration * self.steering.rate * (1 + 1e-9)) + 1) / self.steering.rate

    def _follow(self, run: SetPoints, plant: Plant | None = None, *, goes_on: bool = False) -> None:
        self.told = run.begun_at(self.told).run(plant or self.plant, self.check, goes_on=goes_on)

    def _at_rest(self) -> PlanningProblem:
        """`_from_here`, once the machine has come to rest."""
        if self.steering.settling:
            self.plant.advance(self.steering.settling)
        return self._from_here()

    def _from_here(self) -> PlanningProblem:
        """The problem from where the machine is found to stand; after the first run there is nothing on the way."""
        measured = self.plant.measure()
        try:
            started = changed(self.problem, start=measured)
        except InvalidProblemError as error:
            raise PlantError(f"measure() gave no pose to plan from: {error}") from error
        return changed(started, via=()) if self.cycles and started.via else started

    def _keep(self, cycle: Cycle) -> None:
        cycle = replace(cycle, path=self.plant.ended())
        self.cycles.append(cycle)
        if self.steering.progress:
            self.steering.progress(cycle)


def judged(problem: PlanningProblem, point: Array) -> Cycle:
    """How far a packed state is from a problem's goal."""
    task = problem.tasks[-1]
    units = np.array(task.units)
    try:
        difference = task.difference(point)
    except OrientationAtPiError:
        difference = np.where(units == "angle", np.nan, 0.0)
    parts = {unit: float(np.linalg.norm(difference[units == unit])) for unit in set(task.units)}
    measured = problem.system.state_space.unpack(np.asarray(point))
    return Cycle(measured, problem.goal_error(point), parts.get("length"), parts.get("angle"))
