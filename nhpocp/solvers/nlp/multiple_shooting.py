"""The steering task as an optimal-control problem: direct shooting, solved by an NLP optimizer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from nhpocp import declared
from nhpocp.constraints.leg_acceleration import lacking_derivative
from nhpocp.constructed import Constructed
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.declared import check
from nhpocp.errors import CallError, InvalidProblemError, describe
from nhpocp.flow.compiled.kernels import CompiledWhenReady, Kernels
from nhpocp.flow.step_error import FOLLOWED
from nhpocp.interruption import Interruption
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution, telling
from nhpocp.solvers.continuation.auto import Auto
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.nlp.first_plan import LoweredGuess, dearer, handed_back, kept, reaches
from nhpocp.solvers.nlp.guesses import GuessMaker, ProblemGuess, SolverGuess, StraightGuess
from nhpocp.solvers.nlp.ipopt import Ipopt
from nhpocp.solvers.nlp.least_time import COARSER, COARSEST, CoarseGuess, singular_arcs
from nhpocp.solvers.nlp.optimizer import Optimizer
from nhpocp.solvers.nlp.shooting_run import Run
from nhpocp.solvers.nlp.single_shooting import SingleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from nhpocp.solvers.nlp.transcription import Transcription

# iterations, or a quarter of those allowed, after which another guess is likelier to lead somewhere
PATIENCE = 200


@dataclass(frozen=True)
class MultipleShooting(Constructed):
    """Solver: minimises the problem's objective subject to the dynamics, the goal and every bound.

    transcription: `StagedTranscription`, or `SingleShooting`. optimizer: `Ipopt()` or `Fatrop()`. guess: where to
    begin, `ProblemGuess()`, `SolverGuess(solver)` or `StraightGuess()`. kernels: `Interpreted()`, `Compiled()` or
    `CompiledWhenReady()` evaluate the intervals for IPOPT. Bounds that are broken between the nodes are tightened there
    by as much, and the problem is solved again. Where no start leads to an optimum, other guesses are tried within the
    iterations that are left. No solution is dearer than the plan of a `SolverGuess`, or of the Jacobian method where
    other guesses are tried: what that plan comes to in the null space is handed back instead, and called so.
    """

    intervals: int = declared.count(50, "equal parts of the horizon, each with one value of the control")
    steps_per_interval: int | None = declared.declared(
        "auto or whole",
        None,
        "RK4 steps; None: enough, as four times as many confirm",
    )
    over_basis: bool = declared.declared(
        "truth", False, "the control over the problem's basis, not piecewise constant"
    )
    transcription: type[Transcription] = StagedTranscription
    optimizer: Optimizer = field(default_factory=Ipopt)
    guess: GuessMaker = field(default_factory=ProblemGuess)
    starts: int = declared.count(1, "tries: the guess, then seeded ones; the least objective is kept")
    seed: int = declared.whole(0, "of everything random")
    mesh_check: bool = declared.declared(
        "truth", False, "solve again with twice the intervals and say what changes"
    )
    kernels: Kernels = field(default_factory=CompiledWhenReady)
    name: ClassVar[str] = "nlp"
    chooses_horizon: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check(self)
        if not (isinstance(self.transcription, type) and issubclass(self.transcription, Transcription)):
            words = f"expected a class such as SingleShooting, got {describe(self.transcription)}"
            raise CallError(words, path="MultipleShooting.transcription")
        wanted = {"optimizer": "an optimizer such as Ipopt()", "guess": "a guess such as StraightGuess()"}
        for part, method in (("optimizer", "solve"), ("guess", "control")):
            given = getattr(self, part)
            if isinstance(given, type) or not hasattr(given, method):
                words = f"expected {wanted[part]}, got {describe(given)}"
                raise CallError(words, path=f"MultipleShooting.{part}")

    @property
    def tolerance(self) -> float:
        return self.optimizer.tolerance

    def settings(self) -> dict[str, Any]:
        return {
            "control": "basis" if self.over_basis else "piecewise_constant",
            "intervals": self.intervals,
            "steps_per_interval": self.steps_per_interval or "auto",
            "shooting": "single" if self.transcription is SingleShooting else "multiple",
            "initial": self.guess.kind,
            **self.optimizer.settings(),
            "starts": self.starts,
            "seed": self.seed,
            "mesh_check": self.mesh_check,
        }

    def solve(self, problem: PlanningProblem, progress: Progress | None = None) -> Solution:
        with Interruption():  # also between the optimizer's calls; the next one stops at once
            return self._best(problem, progress)

    def _best(self, problem: PlanningProblem, progress: Progress | None) -> Solution:
        basis = problem.basis if self.over_basis else PiecewiseConstant(self.intervals)
        cost = OBJECTIVES[problem.objective]
        if words := cost.lacking_control(basis) or lacking_derivative(problem.bounds, basis):
            hint = "" if self.over_basis else "; write control: basis"
            raise InvalidProblemError(f"{words}{hint}", path="solvers.nlp.control")
        runs = list(self._from_starts(problem, progress))
        ended, plan = [solution for solution, _ in runs], self._plan(runs[0][1])
        details: dict[str, Any] = {}
        if self.starts > 1:
            details["starts"] = [
                {"start": i, "outcome": solution.outcome.value, "objective": _objective(solution)}
                for i, solution in enumerate(ended)
            ]
        best = max(ended, key=_rank)
        if best.outcome is Outcome.INTERRUPTED:
            best = kept(best, plan) if plan else best
        elif not _well(best, plan):
            best = self._from_other_guesses(problem, progress, best, ended, plan)
        best = _summed(best, ended, details)
        if self.mesh_check and best.outcome is Outcome.CONVERGED and best.details.get("certified", True):
            began = perf_counter()
            told = telling(progress, way=f"mesh check with {2 * self.intervals} intervals")
            change = mesh_check(self, problem, best, told)
            checked = {"mesh_check": change, "mesh_check_s": perf_counter() - began}
            best = replace(best, details={**best.details, **checked})
        if problem.objective == "time" and best.outcome is Outcome.CONVERGED:
            words = singular_arcs(problem, best.control)
            best = replace(best, warnings=[*best.warnings, *filter(None, [words])])
        return best

    def _from_starts(
        self, problem: PlanningProblem, progress: Progress | None
    ) -> Iterator[tuple[Solution, Run]]:
        """One solution a start, and the run that led to it."""
        for start in range(self.starts):
            maker = self.guess if start == 0 else ProblemGuess()
            told = telling(progress, way=f"start {start + 1} of {self.starts}" if self.starts > 1 else None)
            run = self._run(problem, told, maker, self.seed + start if start else 0, self._allowed)
            solution = run.solve()
            yield solution, run
            if solution.outcome is Outcome.INTERRUPTED:
                break

    def _from_other_guesses(
        self,
        problem: PlanningProblem,
        progress: Progress | None,
        best: Solution,
        ended: list[Solution],
        plan: Solution | None,
    ) -> Solution:
        """What other guesses lead to, added to ``ended``: the first that ends well, else the best so far, or the plan.

        plan: another solver's, at hand, than which nothing may be dearer.
        """
        tried = [f"{self.guess.kind}: {_in_short(best)}"]
        budget = self._allowed
        left = budget * self.starts - sum(map(_iterations, ended)) if budget else None
        known: list[GuessMaker] = [StraightGuess(), SolverGuess(self._continuation), ProblemGuess()]
        waiting: list[GuessMaker] = []
        if not _well(best):  # else it is an optimum, and only the plan's own valley may be deeper
            waiting = [maker for maker in known if maker.kind != self.guess.kind]
        lowered = self._lowered(problem, plan) if plan else None
        if lowered:
            lowered = lowered.mended(best) or lowered
            waiting = [lowered, *waiting] if lowered.differs else waiting
        while waiting:
            if left is not None and left <= 0:
                tried.append("max_iterations was reached")
                break
            maker = waiting.pop(0)
            told = telling(progress, way=f"from the guess {maker.kind}")
            last = not waiting and plan is None and not isinstance(maker, SolverGuess)
            run = self._run(problem, told, maker, 0, left, last=last)
            solution = run.solve()
            ended.append(solution)
            if solution.outcome is Outcome.INTERRUPTED:
                return kept(solution, plan) if plan else solution
            before = lowered
            if plan is None and (plan := self._plan(run)):
                lowered = self._lowered(problem, plan)
            if _well(solution, plan) and not (lowered and lowered.far_below(solution)):
                words = f"this is the plan from the guess {maker.kind}; others before: {'; '.join(tried)}"
                return replace(solution, warnings=[*solution.warnings, words])
            tried.append(f"{maker.kind}: {_in_short(solution)}")
            left = left - _iterations(solution) if left is not None else None
            lowered = (lowered.mended(solution) or lowered) if lowered else None
            if lowered and lowered is not before and lowered.differs:
                waiting.insert(0, lowered)
        words = f"Guesses that were tried: {'; '.join(tried)}."
        stalled = _uncertified(ended)
        if stalled and (plan is None or not dearer(stalled, plan)):
            return replace(stalled, message=f"{stalled.message} {words}")
        if plan and lowered:
            best = handed_back(best, plan, lowered)
        return replace(best, message=f"{best.message} {words}")

    def _plan(self, run: Run) -> Solution | None:
        """The plan that a run began with, if another solver made one that counts: by its own tolerance, at least.

        Of many manoeuvres, each of which multiplies errors, some cannot be brought nearer.
        """
        return run.origin if run.origin and reaches(run.origin, run.origin.tolerance) else None

    def _lowered(self, problem: PlanningProblem, plan: Solution) -> LoweredGuess:
        basis = problem.basis if self.over_basis else PiecewiseConstant(self.intervals)
        return LoweredGuess(plan, basis, self.tolerance)

    def _run(
        self,
        problem: PlanningProblem,
        progress: Progress | None,
        maker: GuessMaker,
        seed: int,
        iterations: int | None,
        last: bool = False,
    ) -> Run:
        """One run from one guess; only the last may take all iterations that are left, without a plan to go back to."""
        optimizer: Any = self.optimizer
        if iterations is not None:
            most = iterations if last else min(iterations, max(PATIENCE, (self._allowed or 0) // 4))
            optimizer = replace(optimizer, max_iterations=most)
        if problem.objective == "time" and not self.over_basis and self.intervals >= COARSER * COARSEST:
            coarse = replace(self, intervals=self.intervals // COARSER)
            maker = CoarseGuess(Run(coarse, problem, progress, maker, seed, optimizer), maker)
        return Run(self, problem, progress, maker, seed, optimizer)

    @property
    def _continuation(self) -> Auto:
        return Auto(Continuation(step_rule=Adaptive(), tolerance=self.tolerance))

    @property
    def _allowed(self) -> int | None:
        """Iterations of one start and what takes its place; None where the optimizer counts none."""
        return self.optimizer.settings().get("max_iterations")


def _objective(solution: Solution) -> float:
    value = solution.details.get("objective_value")
    return np.inf if value is None else float(value)


def _well(solution: Solution, plan: Solution | None = None) -> bool:
    """Whether an optimum is what it says, and beats a plan."""
    stands = solution.outcome is Outcome.CONVERGED and _true(solution)
    return stands and (plan is None or (reaches(solution, solution.tolerance) and not dearer(solution, plan)))


def _true(solution: Solution) -> bool:
    """Whether a motion is what it seems to be, as far as finer steps and the determinants' signs tell."""
    told = solution.details
    gap, wrong = told.get("resimulated_gap", 0.0), told.get("path_error", 0.0)
    return bool(told.get("one_side", True) and gap <= solution.tolerance and wrong <= FOLLOWED)


def _uncertified(ended: list[Solution]) -> Solution | None:
    """The least of the points that meet every row and where the optimizer stalled: a plan, if no certified optimum.

    At an abnormal extremal no multipliers exist, and none may ever end otherwise. What met the iteration limit says so.
    """
    plans = [
        solution
        for solution in ended
        if solution.outcome is Outcome.STAGNATED
        and solution.details.get("feasible")
        and solution.final_error <= solution.tolerance
        and _true(solution)
    ]
    if not plans:
        return None
    least, words = min(plans, key=_objective), "Reached; optimality is not certified"
    return replace(
        least,
        outcome=Outcome.CONVERGED,
        message=f"{words}. {least.message}",
        warnings=[*least.warnings, words],
        details={**least.details, "certified": False},
    )


def _rank(solution: Solution) -> tuple[bool, bool, float]:
    return _well(solution), solution.outcome is Outcome.CONVERGED, -_objective(solution)


def _iterations(solution: Solution) -> int:
    return int(solution.iterations[-1]["k"]) if solution.iterations else 0


def _in_short(solution: Solution) -> str:
    status, outcome = solution.details.get("status"), solution.outcome.value
    if not status:
        return f"{outcome} ({solution.message.rstrip('.')})"
    return f"{outcome} ({status} after {_iterations(solution)} iterations)"


def _summed(best: Solution, ended: list[Solution], details: Mapping[str, Any]) -> Solution:
    """The best of some solutions with what all of them took."""
    if len(ended) == 1:
        return replace(best, details={**best.details, **details})
    timing = {key: sum(solution.timing[key] for solution in ended) for key in ("build_s", "solve_s")}
    attempts = [
        {
            "guess": solution.details.get("guess"),
            "outcome": solution.outcome.value,
            "iterations": _iterations(solution),
            "evaluations": solution.evaluations,
            "solve_s": solution.timing["solve_s"],
        }
        for solution in ended
    ]
    return replace(
        best,
        evaluations=sum(solution.evaluations for solution in ended),
        timing={**best.timing, **timing},
        log="\n".join(solution.log for solution in ended if solution.log),
        details={**best.details, **details, "attempts": attempts},
    )


def mesh_check(
    solver: MultipleShooting, problem: PlanningProblem, solution: Solution, progress: Progress | None = None
) -> Mapping[str, Any]:
    """The change of the optimum from N to 2N intervals, and Richardson's estimate of its limit.

    A piecewise-constant control is off the continuous optimum by O(1/N²): the limit is near J(2N) + (J(2N) - J(N))/3.
    """
    finer = replace(solver, intervals=2 * solver.intervals, mesh_check=False).solve(problem, progress)
    coarse, fine = _objective(solution), _objective(finer)
    change = {"intervals": 2 * solver.intervals, "objective_value": fine, "outcome": finer.outcome.value}
    if finer.outcome is Outcome.CONVERGED:
        change |= {"change": fine - coarse, "richardson": fine + (fine - coarse) / 3}
    return change
