"""The plan of another solver that an NLP begins with: over the NLP's control, at less cost, or handed back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nhpocp.constraints.bound import check_bounds
from nhpocp.constraints.leg_acceleration import lacking_derivative
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.projection import project
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.simulation import simulate
from nhpocp.flow.step_error import following
from nhpocp.interruption import STOPPED
from nhpocp.objectives.registry import OBJECTIVES, costs_of_motion
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.solvers.continuation.confirmation import begun_from, confirmed
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.continuation_result import ContinuationResult
from nhpocp.solvers.continuation.step_rules import Adaptive

NEARER = 0.1  # of the tolerance: so near does a plan come that is handed back, whoever integrates it
UPDATES = 60  # to the goal over another basis; what fits that basis takes a few
ROUNDS = 4  # of the search for less cost: begun anew, it often gets by what has held it up
DESCENT = 300  # updates to less cost
LOOSE = 1e-3  # E of that search, which refuses what its steps do not resolve
# rows of the bounds at one time, by coefficients, for which SLSQP is not begun: of a robot's 17 manoeuvres among
# obstacles, 20 by 255, it takes 0.7 s a step, and hundreds of steps
MANY = 2000
TOWARDS = "falls_towards"  # among the details of a search for less
LESS = 0.99  # times a cost, what is worth another solve
SAME = 1e-9  # of a cost: rounding
# what is said of an optimizer's end, and not of the point that it ended at
KEPT = ("status", "guess_defect", "starts", "attempts")


def brought(plan: Solution, tolerance: float) -> Solution:
    """A plan of a looser solver, as near to the goal as ``tolerance`` asks and within the bounds; itself if not."""
    reached = plan.outcome is Outcome.CONVERGED or plan.final_error <= plan.tolerance
    if not reached or lacking_derivative(plan.problem.bounds, plan.control.basis):
        return plan
    found = _search(plan.problem, plan.control, NEARER * tolerance)
    if found.outcome is not Outcome.CONVERGED:
        return plan
    return replace(_made(plan, found, tolerance), evaluations=plan.evaluations + len(found.records))


def over(problem: PlanningProblem, control: Control, basis: ControlBasis, tolerance: float) -> Control | None:
    """The nearest control over a basis, corrected until it leads to the goal; None where it does not."""
    if control.basis == basis:
        return control
    found = _search(replace(problem, bounds=()), project(control, basis), NEARER * tolerance, UPDATES)
    return found.control if found.outcome is Outcome.CONVERGED else None


def reaches(plan: Solution | None, tolerance: float) -> bool:
    """Whether there is a plan that comes so near to the goal and keeps every bound."""
    if plan is None or plan.outcome is not Outcome.CONVERGED or not plan.final_error <= tolerance:
        return False
    if lacking_derivative(plan.problem.bounds, plan.control.basis):
        return False
    return all(
        report.ok for report in check_bounds(plan.problem.bounds, plan.trajectory["t"], plan.trajectory)
    )


def cost_of(solution: Solution) -> float:
    """By the problem's objective; of the motion, not what an optimizer makes of it."""
    return float(solution.costs.get(solution.problem.objective, solution.control.horizon))


def dearer(solution: Solution, plan: Solution) -> bool:
    """Whether a solution costs more than a plan, or nobody knows what."""
    return not cost_of(solution) <= cost_of(plan) + SAME * abs(cost_of(plan))


def _search(
    problem: PlanningProblem,
    control: Control,
    tolerance: float,
    updates: int = 500,
    objective: str = "none",
) -> ContinuationResult:
    """The Jacobian method from a control, confirmed by finer steps."""
    # with fewer steps manoeuvres beside a surface seem to cross it; a search for less is to end where the usual ones no
    # longer resolve the path: with more it ends where no NLP can begin
    integrator = following(problem, control) if objective == "none" else RungeKutta4()
    solver = Continuation(
        step_rule=Adaptive(),
        tolerance=tolerance,
        max_iterations=updates,
        objective=objective,
        integrator=integrator,
    )
    return confirmed(solver, begun_from(problem, control))


def _made(plan: Solution, found: ContinuationResult, tolerance: float) -> Solution:
    """A plan with what a search to a tolerance found in the place of its control."""
    motion = simulate(plan.problem, found.control)
    return replace(
        plan,
        outcome=found.outcome,
        message=f"{found.message}.",
        tolerance=tolerance,
        final_error=found.error,
        control=found.control,
        trajectory=motion.trajectory,
        costs=motion.costs,
        evaluations=len(found.records),
    )


@dataclass(frozen=True)
class LoweredGuess:
    """A plan at less cost: taken down in the null space of the end point's Jacobian, where every step is a plan.

    Over its own basis, and over the NLP's, from where only what that search has left is the NLP's to do. The former
    because a plan of many manoeuvres may fit the NLP's basis only once it has become calmer, and ends elsewhere.
    plan: that reaches the goal. basis: the NLP's. kind: what it is called.
    """

    plan: Solution
    basis: ControlBasis
    tolerance: float
    kind: str = "jacobian, at less cost"

    def control(self, problem: PlanningProblem, horizon: float, seed: int) -> Control:
        mine = [plan for plan in self._plans if plan.control.basis == self.basis]
        return min(mine or self._plans, key=cost_of).control

    @property
    def least(self) -> Solution:
        """The plan itself, or what costs less."""
        return min(self._plans, key=cost_of)

    @cached_property
    def _plans(self) -> list[Solution]:
        """The plan, and what the search leads to from it."""
        plans = [self.plan, *self._lowered(self.plan.control)]
        for plan in list(plans):
            control = over(plan.problem, plan.control, self.basis, self.tolerance)
            if control and plan.control.basis != self.basis:
                plans += self._lowered(control)
        return plans

    def _lowered(self, control: Control) -> list[Solution]:
        """One plan at less cost, or none: the search, begun anew where it ended for as long as that gains."""
        plan, name, before = self.plan, self.plan.problem.objective, np.inf
        if _too_many(plan, control):
            return []
        found: list[ContinuationResult] = []
        searched = name in costs_of_motion() and not OBJECTIVES[name].lacking_control(control.basis)
        for _ in range(ROUNDS if searched and not plan.problem.bounds else 1):
            ended = _search(plan.problem, control, LOOSE, DESCENT, name if searched else "none")
            if ended.outcome is not Outcome.CONVERGED:
                break
            found.insert(0, ended)
            cost = ended.details.get("objective_value", np.inf)
            if not cost < LESS * before:
                break
            control, before = ended.control, cost
        for ended in found:  # the last may be too wild to be brought nearer
            nearer = _search(plan.problem, ended.control, NEARER * self.tolerance)
            lowered = _made(plan, nearer, self.tolerance)
            if reaches(lowered, self.tolerance):
                return [replace(lowered, details={TOWARDS: ended.details.get(TOWARDS, [])})]
        return []

    @property
    def differs(self) -> bool:
        """Whether it begins anywhere else than the plan itself."""
        return len(self._plans) > 1

    @property
    def evaluations(self) -> int:
        """Of the end point, that the search took."""
        return sum(plan.evaluations for plan in self._plans[1:])

    def far_below(self, solution: Solution) -> bool:
        """Whether this costs less than a solution by more than a little."""
        return cost_of(self.least) < LESS * cost_of(solution)

    def mended(self, ended: Solution) -> LoweredGuess | None:
        """Where an NLP ended short of a plan, corrected and taken down, if that costs less by more than a little.

        An optimizer that gives up has often come near to a far cheaper motion than the plan.
        """
        held = self.plan.problem
        if ended.control.horizon != held.horizon.fixed or not np.isfinite(ended.final_error):
            return None
        if _too_many(self.plan, ended.control):
            return None
        corrected = _search(held, ended.control, NEARER * self.tolerance, UPDATES)
        found = _made(self.plan, corrected, self.tolerance)
        if not reaches(found, self.tolerance):
            return None
        guess = replace(self, plan=found, kind="where the NLP ended, corrected, at less cost")
        return guess if guess.far_below(self.least) else None


def _too_many(plan: Solution, control: Control) -> bool:
    """Whether bounds have more rows than a search over a control within them can take in."""
    rows = sum(np.size(plan.trajectory[bound.quantity][0]) for bound in plan.problem.bounds)
    return rows * control.coefficients.size > MANY


def handed_back(failed: Solution, plan: Solution, lowered: LoweredGuess) -> Solution:
    """What there is where no NLP ended with an optimum that costs less than the plan it began with, in true words.

    failed: how the NLP ended. lowered: knows of the least that the plan came to.
    """
    name, cost, least = failed.problem.objective, cost_of(failed), lowered.least
    if failed.outcome is Outcome.CONVERGED and reaches(failed, failed.tolerance):
        why = f"the NLP's optimum costs {name} {cost:.6g}, the plan {cost_of(plan):.6g}"
    elif failed.outcome is Outcome.CONVERGED:
        why = "finer steps refute the NLP's optimum"
    else:
        why = f"the NLP ended as {failed.outcome.value} ({failed.message.rstrip('.')})"
    if cost_of(least) < cost_of(plan):
        way = "motion in the null space" if lowered.plan is plan else "where the NLP ended, corrected,"
        why += f"; {way} took its {name} from {cost_of(plan):.6g} to {cost_of(least):.6g}"
    if towards := least.details.get(TOWARDS):
        why += f"; from there it falls towards {' and '.join(towards)}, where there is no least"
    if least.tolerance > failed.tolerance:
        why += f"; it is within E = {least.tolerance:g} of the goal, and could not be brought to {failed.tolerance:g}"
    which = "plan it began with" if failed.settings["initial"] == "jacobian" else "Jacobian method's plan"
    words = f"Reached; optimality is not certified; the {which} is handed back: {why}"
    instead = _instead(failed, plan, least)
    warnings = [*instead.warnings, words]
    return replace(instead, outcome=Outcome.CONVERGED, message=f"{words}.", warnings=warnings)


def kept(stopped: Solution, plan: Solution) -> Solution:
    """What is at hand in the place of what an NLP had come to when it was stopped: a plan, or the half of one."""
    if plan.outcome is Outcome.CONVERGED:
        words = (
            f"{STOPPED}; the Jacobian method's plan is kept, of {plan.problem.objective} {cost_of(plan):.6g}."
        )
    else:
        words = f"no guess yet; what the {plan.solver} solver had come to is kept: {plan.message}"
    return replace(_instead(stopped, plan, plan), message=words)


def _instead(failed: Solution, plan: Solution, least: Solution) -> Solution:
    """A solution with the motion of another in the place of its own, and nothing that was said of its own."""
    details = {key: failed.details[key] for key in KEPT if key in failed.details} | {
        "guess": "jacobian",
        "objective_value": cost_of(least),
        "certified": False,
        "handed_back": {"outcome": failed.outcome.value, "plan": cost_of(plan)},
    }
    return replace(
        failed,
        tolerance=max(failed.tolerance, least.tolerance),
        final_error=least.final_error,
        control=least.control,
        trajectory=least.trajectory,
        costs=least.costs,
        details=details,
    )
