"""One start of the NLP: guess, transcribe, optimise, refine the steps, tighten the bounds, say how it ended."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, ClassVar, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.deferred import Deferred
from nhpocp.flow.compiled.kernels import Interpreted, Kernels
from nhpocp.flow.simulation import Motion, simulate
from nhpocp.flow.step_error import ALLOWED, FINER, following, path_error
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Progress, Solution
from nhpocp.solvers.claimed import unsolved
from nhpocp.solvers.nlp.ending import Ending, excess
from nhpocp.solvers.nlp.first_plan import LoweredGuess, kept
from nhpocp.solvers.nlp.guesses import GuessMaker, NoGuessError, make_guess, meets
from nhpocp.solvers.nlp.kkt_residuals import kkt_residuals
from nhpocp.solvers.nlp.optimizer import Look, Optimizer, Optimum, failed
from nhpocp.solvers.nlp.transcription import Guess, Transcription
from nhpocp.systems.numeric import numeric_system
from nhpocp.task import total_error

MOST_STEPS = 16  # per interval
TIGHTENINGS = 4
FURTHER = 1.5  # times what breaks a bound between the nodes is what it is moved by
# relative excess of a bound between the nodes that is left alone; verification allows 1e-3
BETWEEN_NODES = 5e-4


class Asked(Protocol):
    """What a run takes from the solver that it belongs to, see `MultipleShooting`."""

    name: ClassVar[str]

    @property
    def intervals(self) -> int: ...

    @property
    def steps_per_interval(self) -> int | None: ...

    @property
    def over_basis(self) -> bool: ...

    @property
    def transcription(self) -> type[Transcription]: ...

    @property
    def optimizer(self) -> Optimizer: ...

    @property
    def kernels(self) -> Kernels: ...

    @property
    def tolerance(self) -> float: ...

    def settings(self) -> dict[str, Any]: ...


class Run:
    """One start: guess, transcribe, optimise, refine, tighten."""

    def __init__(
        self,
        solver: Asked,
        problem: PlanningProblem,
        progress: Progress | None,
        maker: GuessMaker,
        seed: int,
        optimizer: Optimizer,
    ) -> None:
        self.solver, self.problem, self.progress = solver, problem, progress
        self.maker, self.seed, self.optimizer = maker, seed, optimizer
        self.numeric = numeric_system(problem.system)
        self.basis: ControlBasis | None = problem.basis if solver.over_basis else None
        self.bounds = list(problem.bounds)
        self.records: list[dict[str, Any]] = []
        self.warnings: list[str] = []
        self.logs: list[str] = []
        self.evaluations = 0
        self.origin: Solution | None = None  # of the guess
        self.build_seconds = 0.0
        self.details: dict[str, Any] = {"guess": maker.kind}
        self.softening, *self.harder = OBJECTIVES[problem.objective].softenings

    def solve(self) -> Solution:
        began = perf_counter()
        try:
            guess = make_guess(
                self.maker,
                self.problem,
                self.basis,
                self.solver.intervals,
                self.seed,
                self.solver.tolerance,
            )
        except NoGuessError as error:
            self.origin = error.origin
            sentence, seconds = f"No guess to start from: {error.message}.", perf_counter() - began
            ended = unsolved(self.problem, self.solver, error.outcome, sentence, build_seconds=seconds)
            halfway = error.origin if error.outcome is Outcome.INTERRUPTED else None
            return kept(replace(ended, evaluations=halfway.evaluations), halfway) if halfway else ended
        self.evaluations += self.maker.evaluations if isinstance(self.maker, LoweredGuess) else 0
        with Interruption() as interruption:
            if interruption.noted and isinstance(self.maker, LoweredGuess):  # the plan itself is at hand
                return unsolved(self.problem, self.solver, Outcome.INTERRUPTED, f"{STOPPED}.")
        self.origin = guess.origin or getattr(self.maker, "origin", None)
        if guess.origin:
            self.evaluations += guess.origin.evaluations
            if guess.origin.outcome is not Outcome.CONVERGED:
                self.warnings.append(
                    f"the guess is where the {guess.origin.solver} solver ended as {guess.origin.outcome.value}: "
                    + guess.origin.message
                )
        steps = self.solver.steps_per_interval or self._steps_for(guess.control)
        programme, optimum = self._refine(*self._harden(*self._optimise(guess, steps, None)))
        plan = programme.unpack(optimum.x)
        motion = simulate(self.problem, plan.control)
        programme, optimum, plan, motion = self._tighten(programme, optimum, plan, motion)
        return self._solution(programme, optimum, plan, motion, perf_counter() - began - self.build_seconds)

    @property
    def _kernels(self) -> Kernels:
        return self.solver.kernels if self.optimizer.takes_derivatives else Interpreted()

    # --- the stages ---------------------------------------------------------------------------------------------

    def _optimise(
        self, guess: Guess, steps: int, before: tuple[Transcription, Optimum] | None
    ) -> tuple[Transcription, Optimum]:
        """From a guess; warm where the optimum of a programme before is one."""
        began = perf_counter()
        programme = self.solver.transcription(
            self.problem,
            guess,
            self.basis,
            self.solver.intervals,
            steps,
            self.bounds,
            self._kernels,
            self.softening,
        )
        start = programme.pack(guess)
        _, constraints = programme.functions["nlp"](start, [])
        if "guess_defect" not in self.details:
            self.details["guess_defect"] = float(np.max(excess(programme, np.array(constraints).ravel())))
        self.build_seconds += perf_counter() - began
        first = self.records[-1]["k"] + 1 if self.records else 0
        multipliers = carried(*before, programme) if before else None
        with Interruption() as interruption:

            def watch(k: int, objective: float, look: Look) -> bool:
                if self.progress:
                    cost = objective * programme.cost_unit
                    known = {"k": first + k, "objective": cost, **self._prospect(programme, k)}
                    self.progress(Deferred(look, known))
                return interruption.noted

            if self.progress and not self.optimizer.heeds_stops:
                words = f"{self.optimizer.kind} is at work, and Ctrl-C waits until it has ended"
                self.progress({"k": None, "error": None, "stage": words})
            began = perf_counter()
            try:
                optimum = self.optimizer.solve(programme, start, multipliers, watch)
                programme.note(perf_counter() - began)
            except RuntimeError as error:  # what CasADi raises, whatever went wrong
                optimum = failed(programme, start, error)
            if interruption.noted:  # fatrop cannot be stopped, but what comes after it can
                optimum = replace(optimum, outcome=Outcome.INTERRUPTED)
        unit = programme.cost_unit
        self.records += [
            {**record, "k": first + record["k"], "objective": record["objective"] * unit}
            for record in optimum.iterations
        ]
        self.logs.append(optimum.log)
        self.evaluations += optimum.evaluations
        if optimum.cut_back:
            self.warnings.append(
                f"{optimum.cut_back} trial steps left the region where the equations are defined and were cut back"
            )
        return programme, optimum

    def _prospect(self, programme: Transcription, k: int) -> dict[str, Any]:
        """What a listener is told besides, see `Progress`."""
        limit = self.optimizer.settings().get("max_iterations")
        phase = f"{self.solver.intervals} intervals × {programme.steps} RK4"
        left = limit - k if limit else None
        return {"tolerance": self.solver.tolerance, "phase": phase, "at_most": left, "expected": None}

    def _steps_for(self, control: Control) -> int:
        """The least number of RK4 steps per interval that integrates the guess well enough."""
        steps = 1
        while steps < MOST_STEPS and self._resimulation_gap(control, steps) > ALLOWED * self.solver.tolerance:
            steps *= 2
        return steps

    def _meets(self, control: Control, steps: int) -> Array:
        """Where a control leads at the times of the tasks, with ``steps`` RK4 steps per interval."""
        return meets(self.problem, control, self.solver.intervals, steps)

    def _resimulation_gap(self, control: Control, steps: int) -> float:
        """Distance at the end and the via poses with ``steps`` and with `FINER` times as many steps per interval."""
        coarse, fine = (self._meets(control, n) for n in (steps, FINER * steps))
        if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
            return np.inf
        space = self.problem.system.state_space
        apart = [space.difference(*pair) for pair in zip(coarse, fine, strict=True)]
        return float(np.linalg.norm(np.array(space.weights(self.problem.error_length)) * np.array(apart)))

    def _harden(self, programme: Transcription, optimum: Optimum) -> tuple[Transcription, Optimum]:
        """From one softened objective to the next, as long as each is solved; the last solved one counts."""
        for softening in self.harder:
            if optimum.outcome is not Outcome.CONVERGED:
                break
            before, self.softening = self.softening, softening
            plan = programme.unpack(optimum.x)
            harder = self._optimise(plan, programme.steps, (programme, optimum))
            if harder[1].outcome not in (Outcome.CONVERGED, Outcome.INTERRUPTED):
                self.softening = before
                break
            programme, optimum = harder
        return programme, optimum

    def _refine(self, programme: Transcription, optimum: Optimum) -> tuple[Transcription, Optimum]:
        """Doubles the steps of `steps_per_interval: auto` until the re-simulated end agrees with the NLP's."""
        while self.solver.steps_per_interval is None and optimum.outcome is Outcome.CONVERGED:
            plan = programme.unpack(optimum.x)
            gap = self._resimulation_gap(plan.control, programme.steps)
            self.details["resimulated_gap"] = gap
            if gap <= ALLOWED * self.solver.tolerance or programme.steps >= MOST_STEPS:
                break
            programme, optimum = self._optimise(plan, 2 * programme.steps, (programme, optimum))
        return programme, optimum

    def _tighten(
        self, programme: Transcription, optimum: Optimum, plan: Guess, motion: Motion
    ) -> tuple[Transcription, Optimum, Guess, Motion]:
        """Moves bounds inwards by what is broken between the nodes, and solves again."""
        for _ in range(TIGHTENINGS):
            if optimum.outcome is not Outcome.CONVERGED:
                break
            amounts = [b.passed(motion.trajectory[b.quantity], BETWEEN_NODES) for b in self.problem.bounds]
            labels = {
                bound.label
                for bound, pair in zip(self.problem.bounds, amounts, strict=True)
                if any(np.any(side) for side in pair)
            }
            if not labels:
                break
            tightened = [
                bound.tightened(FURTHER * below, FURTHER * above)
                for bound, (below, above) in zip(self.bounds, amounts, strict=True)
            ]
            if None in tightened:
                self.warnings.append(
                    f"{', '.join(sorted(labels))} holds at the nodes but not between them, and is too narrow to be "
                    "tightened; use more intervals"
                )
                break
            self.bounds = [bound for bound in tightened if bound]
            self.details["tightened"] = sorted({*self.details.get("tightened", []), *labels})
            programme, optimum = self._optimise(plan, programme.steps, (programme, optimum))
            plan = programme.unpack(optimum.x)
            motion = simulate(self.problem, plan.control)
        return programme, optimum, plan, motion

    # --- endings ------------------------------------------------------------------------------------------------

    def _solution(
        self, programme: Transcription, optimum: Optimum, plan: Guess, motion: Motion, seconds: float
    ) -> Solution:
        outcome = optimum.outcome
        if outcome is Outcome.INFEASIBLE:
            outcome = Outcome.STAGNATED  # a local word: it cannot know of other paths
        met = self._meets(plan.control, programme.steps)
        cost, ending = self._objective(programme, optimum, motion), Ending(programme, optimum)
        costates = programme.costates(optimum.x, optimum.multipliers)
        if ending.feasible:  # a step may jump across a pole, to where it is right again
            followed = following(self.problem, plan.control)
            self.details["path_error"] = path_error(self.problem, plan.control, followed)
        self.details |= {
            "status": optimum.status,
            "feasible": ending.feasible,
            "one_side": self._one_side(plan.states),
            "objective_value": cost,
            "steps_per_interval": programme.steps,
            "optimality": kkt_residuals(programme, optimum.x, optimum.multipliers),
            "costates": costates.tolist() if costates is not None else None,
        }
        return Solution(
            problem=self.problem,
            solver=self.solver.name,
            settings=self.solver.settings(),
            tolerance=self.solver.tolerance,
            outcome=outcome,
            message=self._sentence(outcome, ending, cost),
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

    def _one_side(self, states: Array) -> bool:
        """Whether no determinant that the equations divide by changes its sign from node to node: a step can jump."""
        determinants = self.numeric.determinants(states)
        return all(
            bool(np.all(values * values[0] > 0))
            for values in (determinants[name] for name in self.problem.system.breaking())
        )

    def _objective(self, programme: Transcription, optimum: Optimum, motion: Motion) -> float:
        """The cost; of a softened one, what it stands for."""
        name = self.problem.objective
        softened = any(OBJECTIVES[name].softenings)
        return motion.costs[name] if softened else optimum.objective * programme.cost_unit

    def _sentence(self, outcome: Outcome, ending: Ending, cost: float) -> str:
        count = self.records[-1]["k"]
        if outcome is Outcome.CONVERGED:
            return f"{self.problem.objective} {cost:.6g} after {count} iterations."
        words = f"{self.optimizer.kind} ended with {ending.optimum.status} after {count} iterations"
        return ending.sentence(outcome, words)


def carried(before: Transcription, optimum: Optimum, after: Transcription) -> Array:
    """The multipliers of one programme for another: of the rows that both have; finer steps bring further ones."""
    known = {
        (row.name, round(row.time, 12)): value
        for row, value in zip(before.rows, optimum.multipliers, strict=True)
    }
    return np.array([known.get((row.name, round(row.time, 12)), 0.0) for row in after.rows])
