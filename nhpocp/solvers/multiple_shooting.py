"""The steering task as an optimal-control problem: direct shooting, solved by an NLP optimizer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints import check_bounds
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.deferred import Deferred
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.kernels import CompiledWhenReady, Interpreted, Kernels
from nhpocp.flow.simulation import Motion, simulate
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome, Progress, Solution, telling
from nhpocp.solvers.certificate import optimality
from nhpocp.solvers.guesses import (
    GuessMaker,
    NoGuessError,
    ProblemGuess,
    make_guess,
    meets,
    starting_horizon,
)
from nhpocp.solvers.interruption import Interruption
from nhpocp.solvers.optimizers import Ipopt, Look, Optimizer, Optimum, failed
from nhpocp.solvers.single_shooting import SingleShooting
from nhpocp.solvers.transcription import Guess, Transcription
from nhpocp.systems.numeric import numeric_system
from nhpocp.task import total_error

MOST_STEPS = 16  # per interval
RESIMULATION_SHARE = 0.1  # of the tolerance: the integration error that a plan may carry
FINER = 8  # times the NLP's own steps, for the re-simulation
TIGHTENINGS = 4
BETWEEN_NODES = (
    5e-4  # relative excess of a bound between the nodes that is left alone; verification allows 1e-3
)


@dataclass(frozen=True)
class MultipleShooting:
    """Solver: minimises the problem's objective subject to the dynamics, the goal and every bound.

    ``over_basis``: the control over the problem's basis, else piecewise constant on ``intervals``.
    ``steps_per_interval``: RK4 steps in each interval; None refines them until a simulation with ``FINER`` times as
    many steps ends within a tenth of the tolerance. Bounds that are broken between the nodes are tightened there by as
    much, and the problem is solved again. ``starts``: the first is ``guess``, the others seeded; the least objective
    of those that end well is kept. ``mesh_check``: solve again with twice as many intervals and say what that changes.
    ``kernels``: whether compiled ones evaluate the intervals for IPOPT.
    """

    intervals: int = 50
    steps_per_interval: int | None = None
    over_basis: bool = False
    transcription: type[Transcription] = Transcription
    optimizer: Optimizer = field(default_factory=Ipopt)
    guess: GuessMaker = field(default_factory=ProblemGuess)
    starts: int = 1
    seed: int = 0
    mesh_check: bool = False
    kernels: Kernels = field(default_factory=CompiledWhenReady)
    name: ClassVar[str] = "nlp"

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
        best: Solution | None = None
        tried, ended = [], []
        for start in range(self.starts):
            maker = self.guess if start == 0 else ProblemGuess()
            told = telling(progress, way=f"start {start + 1} of {self.starts}" if self.starts > 1 else None)
            solution = _Run(self, problem, told, maker, self.seed + start if start else 0).solve()
            tried.append(
                {"start": start, "outcome": solution.outcome.value, "objective": _objective(solution)}
            )
            ended.append(solution)
            if best is None or _better(solution, best):
                best = solution
            if solution.outcome is Outcome.INTERRUPTED:
                break
        if best is None:
            raise InvalidProblemError("starts must be at least 1", path="solvers.nlp.starts")
        details = {**best.details, "starts": tried} if self.starts > 1 else dict(best.details)
        if self.mesh_check and best.outcome is Outcome.CONVERGED:
            began = perf_counter()
            told = telling(progress, way=f"mesh check with {2 * self.intervals} intervals")
            details["mesh_check"] = mesh_check(self, problem, best, told)
            details["mesh_check_s"] = perf_counter() - began
        timing = {key: sum(one.timing[key] for one in ended) for key in best.timing}
        evaluations = sum(one.evaluations for one in ended)
        return replace(best, details=details, timing=timing, evaluations=evaluations)


def _objective(solution: Solution) -> float:
    return float(solution.details.get("objective_value", np.inf))


def _better(one: Solution, other: Solution) -> bool:
    claims = [solution.outcome is Outcome.CONVERGED for solution in (one, other)]
    return claims[0] > claims[1] or (claims[0] == claims[1] and _objective(one) < _objective(other))


class _Run:
    """One start: guess, transcribe, optimise, refine, tighten."""

    def __init__(
        self,
        solver: MultipleShooting,
        problem: PlanningProblem,
        progress: Progress | None,
        maker: GuessMaker,
        seed: int,
    ) -> None:
        self.solver, self.problem, self.progress, self.maker, self.seed = (
            solver,
            problem,
            progress,
            maker,
            seed,
        )
        self.numeric = numeric_system(problem.system)
        self.basis: ControlBasis | None = problem.basis if solver.over_basis else None
        self.bounds = list(problem.bounds)
        self.records: list[dict[str, Any]] = []
        self.warnings: list[str] = []
        self.logs: list[str] = []
        self.evaluations = 0
        self.build_seconds = 0.0
        self.details: dict[str, Any] = {}

    def solve(self) -> Solution:
        began = perf_counter()
        try:
            guess = make_guess(self.maker, self.problem, self.basis, self.solver.intervals, self.seed)
        except NoGuessError as error:
            return self._without_optimum(error, perf_counter() - began)
        steps = self.solver.steps_per_interval or self._enough_steps(guess.control)
        programme, optimum = self._refine(*self._optimise(guess, steps, None))
        plan = programme.unpack(optimum.x)
        motion = simulate(self.problem, plan.control)
        programme, optimum, plan, motion = self._tighten(programme, optimum, plan, motion)
        return self._solution(programme, optimum, plan, motion, perf_counter() - began - self.build_seconds)

    @property
    def _kernels(self) -> Kernels:
        return self.solver.kernels if self.solver.optimizer.takes_derivatives else Interpreted()

    # --- the stages ---------------------------------------------------------------------------------------------

    def _optimise(self, guess: Guess, steps: int, multipliers: Array | None) -> tuple[Transcription, Optimum]:
        began = perf_counter()
        programme = self.solver.transcription(
            self.problem, guess, self.basis, self.solver.intervals, steps, self.bounds, self._kernels
        )
        start = programme.pack(guess)
        _, constraints = programme.functions["nlp"](start, [])
        if "guess_defect" not in self.details:
            self.details["guess_defect"] = float(np.max(_excess(programme, np.array(constraints).ravel())))
        self.build_seconds += perf_counter() - began
        before = self.records[-1]["k"] + 1 if self.records else 0
        with Interruption() as interruption:

            def watch(k: int, objective: float, look: Look) -> bool:
                if self.progress:
                    known = {"k": before + k, "objective": objective, **self._prospect(programme, k)}
                    self.progress(Deferred(look, known))
                return interruption.noted

            if multipliers is not None and len(multipliers) != len(programme.rows):
                multipliers = None  # finer steps bring further rows of the same bounds
            began = perf_counter()
            try:
                optimum = self.solver.optimizer.solve(programme, start, multipliers, watch)
                programme.note(perf_counter() - began)
            except RuntimeError as error:  # what CasADi raises, whatever went wrong
                optimum = failed(programme, start, error)
            if interruption.noted:  # fatrop cannot be stopped, but what comes after it can
                optimum = replace(optimum, outcome=Outcome.INTERRUPTED)
        self.records += [{**record, "k": before + record["k"]} for record in optimum.iterations]
        self.logs.append(optimum.log)
        self.evaluations += optimum.evaluations
        if optimum.cut_back:
            self.warnings.append(
                f"{optimum.cut_back} trial steps left the region where the equations are defined and were cut back"
            )
        return programme, optimum

    def _prospect(self, programme: Transcription, k: int) -> dict[str, Any]:
        """What a listener is told besides, see `Progress`."""
        limit = self.solver.optimizer.settings().get("max_iterations")
        phase = f"{self.solver.intervals} intervals × {programme.steps} RK4"
        left = limit - k if limit else None
        return {"tolerance": self.solver.tolerance, "phase": phase, "at_most": left, "expected": None}

    def _enough_steps(self, control: Control) -> int:
        """The least number of RK4 steps per interval that integrates the guess well enough."""
        steps = 1
        while (
            steps < MOST_STEPS
            and self._resimulation_gap(control, steps) > RESIMULATION_SHARE * self.solver.tolerance
        ):
            steps *= 2
        return steps

    def _meets(self, control: Control, steps: int) -> Array:
        """Where a control leads at the times of the tasks, with ``steps`` RK4 steps per interval."""
        return meets(self.problem, control, self.solver.intervals, steps)

    def _resimulation_gap(self, control: Control, steps: int) -> float:
        """Distance at the end and the via poses with ``steps`` and with ``FINER`` times as many steps per interval."""
        coarse, fine = (self._meets(control, n) for n in (steps, FINER * steps))
        if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
            return np.inf
        space = self.problem.system.state_space
        apart = [space.difference(*pair) for pair in zip(coarse, fine, strict=True)]
        return float(np.linalg.norm(np.array(space.weights(self.problem.error_length)) * np.array(apart)))

    def _refine(self, programme: Transcription, optimum: Optimum) -> tuple[Transcription, Optimum]:
        """Doubles the steps of `steps_per_interval: auto` until the re-simulated end agrees with the NLP's."""
        while self.solver.steps_per_interval is None and optimum.outcome is Outcome.CONVERGED:
            plan = programme.unpack(optimum.x)
            gap = self._resimulation_gap(plan.control, programme.steps)
            self.details["resimulated_gap"] = gap
            if gap <= RESIMULATION_SHARE * self.solver.tolerance or programme.steps >= MOST_STEPS:
                break
            programme, optimum = self._optimise(plan, 2 * programme.steps, optimum.multipliers)
        return programme, optimum

    def _tighten(
        self, programme: Transcription, optimum: Optimum, plan: Guess, motion: Motion
    ) -> tuple[Transcription, Optimum, Guess, Motion]:
        """Moves bounds inwards by what is broken between the nodes, and solves again."""
        for _ in range(TIGHTENINGS):
            if optimum.outcome is not Outcome.CONVERGED or not self.bounds:
                break
            reports = check_bounds(
                self.problem.bounds, motion.trajectory["t"], motion.trajectory, BETWEEN_NODES
            )
            broken = {report.bound.quantity: report.worst for report in reports if not report.ok}
            tightened = [bound.tightened(1.5 * broken.get(bound.quantity, 0.0)) for bound in self.bounds]
            if not broken or not np.isfinite(list(broken.values())).all():
                break
            if None in tightened:
                names = ", ".join(report.bound.label for report in reports if not report.ok)
                self.warnings.append(
                    f"{names} holds at the nodes but not between them, and is too narrow to be tightened; use more "
                    "intervals"
                )
                break
            self.bounds = [bound for bound in tightened if bound]
            labels = {report.bound.label for report in reports if not report.ok}
            self.details["tightened"] = sorted({*self.details.get("tightened", []), *labels})
            programme, optimum = self._optimise(plan, programme.steps, None)
            plan = programme.unpack(optimum.x)
            motion = simulate(self.problem, plan.control)
        return programme, optimum, plan, motion

    # --- endings ------------------------------------------------------------------------------------------------

    def _solution(
        self, programme: Transcription, optimum: Optimum, plan: Guess, motion: Motion, seconds: float
    ) -> Solution:
        outcome = optimum.outcome
        if outcome is Outcome.INFEASIBLE and not self._violated(programme, optimum):
            outcome = Outcome.STAGNATED  # restoration gave up next to a feasible point
        met = self._meets(plan.control, programme.steps)
        costates = programme.costates(optimum.x, optimum.multipliers)
        self.details |= {
            "status": optimum.status,
            "objective_value": optimum.objective,
            "steps_per_interval": programme.steps,
            "optimality": optimality(programme, optimum.x, optimum.multipliers),
            "costates": costates.tolist() if costates is not None else None,
        }
        return Solution(
            problem=self.problem,
            solver=self.solver.name,
            settings=self.solver.settings(),
            tolerance=self.solver.tolerance,
            outcome=outcome,
            message=self._sentence(outcome, programme, optimum),
            final_error=total_error(self.problem.tasks, met),
            control=plan.control,
            trajectory=motion.trajectory,
            costs=motion.costs,
            iterations=self.records,
            evaluations=self.evaluations,
            objective=self.problem.objective,
            warnings=self.warnings,
            timing={"build_s": self.build_seconds, "solve_s": seconds},
            log="\n".join(self.logs),
            details=self.details,
        )

    def _sentence(self, outcome: Outcome, programme: Transcription, optimum: Optimum) -> str:
        if outcome is Outcome.CONVERGED:
            return (
                f"{self.problem.objective} {optimum.objective:.6g} after {self.records[-1]['k']} iterations."
            )
        words = f"{self.solver.optimizer.kind} ended with {optimum.status} after {self.records[-1]['k']} iterations"
        if outcome is Outcome.INFEASIBLE:
            words += f". Most violated: {'; '.join(self._violated(programme, optimum)[:3])}"
            if pressed := self._pressed(programme, optimum):
                words += f". Held at their limits there: {'; '.join(pressed[:3])}"
        if outcome is Outcome.NOT_FINITE:
            words += f". {self._undefined(programme, optimum)}"
        return f"{words}. {outcome.advice}"

    def _violated(self, programme: Transcription, optimum: Optimum) -> list[str]:
        """Constraints that do not hold, the stated ones first, most violated first."""
        excess = _excess(programme, optimum.constraints)
        horizon = programme.unpack(optimum.x).control.horizon
        rows = programme.rows
        order = sorted(np.flatnonzero(excess > 1e-6), key=lambda i: (not rows[i].stated, -excess[i]))
        return [f"{rows[i].name} at t={rows[i].time * horizon:.4g} by {excess[i]:.3g}" for i in order]

    def _pressed(self, programme: Transcription, optimum: Optimum) -> list[str]:
        """Stated constraints that hold and push back, the strongest of each name."""
        horizon = programme.unpack(optimum.x).control.horizon
        excess, force = _excess(programme, optimum.constraints), np.abs(optimum.multipliers)
        strongest: dict[str, int] = {}
        for i in np.argsort(-force):
            row = programme.rows[i]
            if row.stated and excess[i] <= 1e-6 and force[i] > 1e-3 * force.max():
                strongest.setdefault(row.name, int(i))
        return [f"{name} at t={programme.rows[i].time * horizon:.4g}" for name, i in strongest.items()]

    def _undefined(self, programme: Transcription, optimum: Optimum) -> str:
        """Which constraint is not a number, at which node."""
        _, constraints = programme.functions["nlp"](optimum.x, [])
        undefined = np.flatnonzero(~np.isfinite(np.array(constraints).ravel()))
        if not undefined.size:
            return "A derivative is not a number"
        row = programme.rows[int(undefined[0])]
        if row.name.startswith(("goal of", "via pose")):
            return f"{row.name} is not a number: the path there is half a turn from it; try another control.initial"
        divided = " or ".join(f"det {name.upper()}" for name in self.problem.system.breaking())
        why = f"; {divided}, by which the equations divide, vanishes near it" if divided else ""
        return f"{row.name} is not a number at share {row.time:.4g} of the horizon{why}"

    def _without_optimum(self, error: NoGuessError, seconds: float) -> Solution:
        """There was no guess to start from."""
        zeros = np.zeros((self.problem.system.input_space.size, self.problem.basis.size))
        control = Control(self.problem.basis, zeros, starting_horizon(self.problem))
        motion = simulate(self.problem, control)
        return Solution(
            problem=self.problem,
            solver=self.solver.name,
            settings=self.solver.settings(),
            tolerance=self.solver.tolerance,
            outcome=error.outcome,
            message=f"No guess to start from: {error.message}.",
            final_error=float("nan"),
            control=control,
            trajectory=motion.trajectory,
            costs=motion.costs,
            objective=self.problem.objective,
            timing={"build_s": seconds, "solve_s": 0.0},
        )


def _excess(programme: Transcription, constraints: Array) -> Array:
    """How far every constraint is outside its bounds; infinite where it is not a number."""
    excess = np.maximum(programme.lower - constraints, constraints - programme.upper)
    return np.where(np.isnan(excess), np.inf, np.maximum(excess, 0.0))


def mesh_check(
    solver: MultipleShooting, problem: PlanningProblem, solution: Solution, progress: Progress | None = None
) -> Mapping[str, Any]:
    """The change of the optimum from N to 2N intervals, and Richardson's estimate of its limit.

    A piecewise-constant control is off the continuous optimum by O(1/N²): the limit is near J(2N) + (J(2N) - J(N))/3.
    """
    finer = replace(solver, intervals=2 * solver.intervals, mesh_check=False).solve(problem, progress)
    coarse, fine = _objective(solution), _objective(finer)
    found = {"intervals": 2 * solver.intervals, "objective_value": fine, "outcome": finer.outcome.value}
    if finer.outcome is Outcome.CONVERGED:
        found |= {"change": fine - coarse, "richardson": fine + (fine - coarse) / 3}
    return found
