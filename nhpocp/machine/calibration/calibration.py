"""A robot's parameters from what was measured of its runs, with how well each is seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.errors import CallError, InvalidProblemError, describe
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.machine.calibration.fitting import Fit, Fitted, Model
from nhpocp.machine.calibration.identifiability import Direction, correlations, directions, unseen_words
from nhpocp.machine.calibration.leg_driven_steps import LegDrivenSteps
from nhpocp.machine.calibration.measurements import Measurements, measured
from nhpocp.machine.calibration.noise import LEAST, Noise, kinds_of
from nhpocp.machine.calibration.noise_estimation import estimate_noise, noise_by_differences
from nhpocp.machine.calibration.unknowns import OFFSET, Unknown, Unknowns
from nhpocp.problem import PlanningProblem
from nhpocp.systems.system import System

SUSPECT = 0.5  # correlation of neighbouring residuals from which they are no noise
NEGLIGIBLE = 1e-5  # of the robot's length, and of a radian: smaller residuals are the integration's
LARGER = 1.5  # times the noise that was stated: such residuals are no noise


class Ending(Enum):
    """How a calibration can end."""

    FITTED = "fitted"  # everything that was asked for is seen
    NOT_SEEN = "not_seen"  # some of it is not, and stays where the model has it
    NOT_CONVERGED = "not_converged"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Estimate:
    """One parameter: before, value, and its standard deviation [its unit].

    seen: whether the data say what it is; where they do not, the deviation is NaN, and the value has changed only as
    far as those of others did with which it is seen together.
    """

    unknown: Unknown
    value: float
    deviation: float
    seen: bool

    @property
    def name(self) -> str:
        return self.unknown.name

    @property
    def before(self) -> float:
        return self.unknown.value


@dataclass(frozen=True)
class Residuals:
    """Measured less predicted of one run, (k, d + m): before, with the model's parameters, and after, with the fitted.

    Of both the motion fits as well as it can. Poses that were not measured are NaN.
    """

    run: Measurements
    before: Array
    after: Array


@dataclass(frozen=True)
class Calibration:
    """What was fitted.

    problem: as it was. system: with the fitted parameters; None where they make no robot. outcome: an `Ending`.
    message: the same in a sentence. estimates: one a parameter, `Estimate`. covariance: (n, n) of them, in their
    order. directions: of the parameters, each with its singular value, the best seen first. noise: standard
    deviations; stated: by who called, or else estimated. residuals: one a run. variance: of a residual divided by the
    noise, 1 where that is right. changes: parameters of the system that differ, plain data. doubts: sentences.
    """

    problem: PlanningProblem
    system: System | None
    outcome: Ending
    message: str
    estimates: tuple[Estimate, ...]
    covariance: Array
    directions: tuple[Direction, ...]
    noise: Noise
    stated: bool
    residuals: tuple[Residuals, ...]
    variance: float
    changes: Mapping[str, Any]
    doubts: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        shown = ", ".join(f"{e.name} {e.value:.6g} ± {e.deviation:.1g}" for e in self.estimates)
        return f"<Calibration {self.outcome.value}: {shown}>"

    @property
    def fitted(self) -> bool:
        """Whether it converged and everything that was asked for is seen."""
        return self.outcome is Ending.FITTED

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter by its name."""
        return {each.name: each for each in self.estimates}[name]

    def size(self, kind: int, after: bool = True) -> float:
        """Root of the mean square of the residuals of a kind of `KINDS` [its unit]."""
        rows = kinds_of(self.problem.system) == kind  # type: ignore[arg-type]
        tables = [(each.after if after else each.before)[:, rows] for each in self.residuals]
        return float(np.sqrt(np.nanmean(np.concatenate([table.ravel() for table in tables]) ** 2)))


@dataclass(frozen=True)
class Calibrating:
    """What is fitted of a problem's robot, with its equations made once, for any number of calibrations.

    noise: as stated; None: it is estimated from the residuals.
    """

    problem: PlanningProblem
    equations: LegDrivenSteps
    noise: Noise | None = None

    @classmethod
    def of(
        cls, problem: PlanningProblem, fit: str | Sequence[str] | None = None, noise: Any = None
    ) -> Calibrating:
        """Errors: `InvalidProblemError` for a name that is none, a noise that is none, a system without legs."""
        unknowns = Unknowns.parsed(fit, problem.system)
        stated = None if noise is None else noise if isinstance(noise, Noise) else Noise.parsed(noise)
        return cls(problem, LegDrivenSteps(unknowns), stated)

    @property
    def unknowns(self) -> Unknowns:
        return self.equations.unknowns

    def run(self, runs: Sequence[Mapping[str, Any] | Measurements]) -> Calibration:
        """From what was measured, a mapping of arrays or `Measurements` a run.

        Ctrl-C ends it as `interrupted`, with what it has. Errors: `InvalidProblemError` for runs that are none.
        """
        if isinstance(runs, Mapping | str) or not isinstance(runs, Sequence) or not runs:
            hint = "; write [run] for a single one" if isinstance(runs, Mapping) else ""
            raise CallError(f"expected several runs, got {describe(runs)}{hint}", path="runs")
        system = self.unknowns.system
        taken = [measured(run, system, f"run {i}") for i, run in enumerate(runs, 1)]
        with np.errstate(all="ignore"):  # of a motion that runs away, which its sum of squares says
            return self._fitted(taken, Noise.likely(system, LEAST))

    def _fitted(self, taken: Sequence[Measurements], least: Noise) -> Calibration:
        noise = self.noise or noise_by_differences(taken, self.unknowns.system, least)
        fit = Fit(self.equations, taken, noise)
        fit.held = self._unseen(fit, fit.foreseen())
        with Interruption() as interruption:
            here, model, outcome, message = self._settled(fit, least, interruption.check)
            before = self._before(fit, taken, interruption.check)
        return self._judged(fit, here, model, outcome, message, before)

    def _settled(
        self, fit: Fit, least: Noise, check: Callable[[], None]
    ) -> tuple[Fitted, Model, Ending, str]:
        """Fitted, the noise estimated, and fitted with that."""
        here = fit.begin()
        model, converged = fit.model(here), False
        try:
            for _ in range(len(self.unknowns) + 1):
                here, model, converged = fit.run(here, check)
                if converged and self.noise is None:
                    here, model, converged = fit.run(estimate_noise(fit, here, model, least, check), check)
                unseen = self._unseen(fit, model)
                if not converged or len(unseen) <= len(fit.held):
                    break
                fit.held = unseen
                here = fit.begin()
        except KeyboardInterrupt:
            return here, model, Ending.INTERRUPTED, f"{STOPPED}; the parameters are those of the last step"
        if not converged:
            words = f"the sum of squares could not be made less step by step; {self._worst(fit, here)}"
            return here, model, Ending.NOT_CONVERGED, words
        return here, model, Ending.FITTED, "everything that was asked for is seen"

    def _unseen(self, fit: Fit, model: Model) -> Array:
        if not model.finite:
            return np.zeros((0, len(self.unknowns)))
        vectors = [each.vector for each in self._directions(fit, model) if not each.seen]
        return np.array(vectors).reshape(len(vectors), len(self.unknowns))

    def _directions(self, fit: Fit, model: Model) -> list[Direction]:
        return directions(model.information, self.unknowns.scales, self.unknowns.names, fit.samples)

    def _worst(self, fit: Fit, here: Fitted) -> str:
        """Where the model is furthest from what was measured."""
        scatter = fit.noise.of_rows(fit.kinds)
        sizes = [np.linalg.norm(each.residuals / scatter, axis=1) for each in here.seen]
        i = int(np.argmax([size.max() for size in sizes]))
        time = fit.runs[i].times[int(np.argmax(sizes[i]))]
        return (
            f"measurements and model are furthest apart in {fit.runs[i].name} at t={time:.4g}; a machine that passes a "
            "singular pose, or slips, is not described by any parameters"
        )

    def _before(self, fit: Fit, runs: Sequence[Measurements], check: Callable[[], None]) -> list[Array]:
        """Residuals of the model as it was, its motions fitted."""
        alone = Fit(self.equations, runs, fit.noise, fixed=True)
        here = alone.begin()
        with suppress(KeyboardInterrupt):
            here = alone.run(here, check)[0]
        return [each.residuals for each in here.seen]

    def _judged(
        self, fit: Fit, here: Fitted, model: Model, outcome: Ending, message: str, before: list[Array]
    ) -> Calibration:
        unknowns, covariance = self.unknowns, model.covariance
        deviations = np.sqrt(np.diag(covariance))
        along = self._directions(fit, model)
        unseen = [each for each in along if not each.seen]
        lost = {name for each in unseen for name, _ in each.parts} if along else set(unknowns.names)
        estimates = tuple(
            Estimate(
                unknown,
                float(value),
                np.nan if unknown.name in lost else float(deviation),
                unknown.name not in lost,
            )
            for unknown, value, deviation in zip(unknowns.every, here.values, deviations, strict=True)
        )
        if outcome is Ending.FITTED and unseen:
            outcome = Ending.NOT_SEEN
            message = f"{unseen_words(along, unknowns.names)}; it stays as the model has it"
        system, changes, wrong = None, {}, ""
        try:
            changes = unknowns.changes(here.values)
            system = unknowns.fitted(here.values)
        except InvalidProblemError as error:
            outcome, wrong = Ending.NOT_CONVERGED, f"no robot has these parameters: {error}; "
        there = [run.posed for run in fit.runs]
        tables = [
            (self._gaps(old, posed), self._gaps(seen.residuals, posed))
            for old, seen, posed in zip(before, here.seen, there, strict=True)
        ]
        variance = self._variance(fit, here, len(unknowns))
        return Calibration(
            problem=self.problem,
            system=system,
            outcome=outcome,
            message=_sentence(f"{wrong}{message}"),
            estimates=estimates,
            covariance=covariance,
            directions=tuple(along),
            noise=fit.noise,
            stated=self.noise is not None,
            residuals=tuple(Residuals(run, *pair) for run, pair in zip(fit.runs, tables, strict=True)),
            variance=variance,
            changes=changes,
            doubts=tuple(self._doubts(fit, here, covariance, variance, lost)),
        )

    def _gaps(self, residuals: Array, posed: Array) -> Array:
        table = np.array(residuals)
        table[~posed, : self.equations.dimension] = np.nan
        return table

    def _variance(self, fit: Fit, here: Fitted, count: int) -> float:
        """The sum of squares over how many numbers there are, less how many were fitted to them."""
        d, m = self.equations.dimension, self.equations.motors
        scatter = fit.noise.of_rows(fit.kinds)
        squares = sum(float(np.sum((each.residuals / scatter) ** 2)) for each in here.seen)
        numbers = sum(d * run.posed.sum() + m * len(run.times) for run in fit.runs)
        fitted = count + sum(d + m * (len(run.times) - 1) for run in fit.runs)
        return squares / max(1.0, float(numbers - fitted))

    def _doubts(
        self, fit: Fit, here: Fitted, covariance: Array, variance: float, lost: set[str]
    ) -> list[str]:
        found = [
            f"the errors of {one} and {other} go together (correlation {value:+.3f})"
            for one, other, value in correlations(covariance, self.unknowns.names)
            if one not in lost and other not in lost
        ]
        if self.noise is not None and variance > LARGER**2:
            found.append(
                f"the residuals are {np.sqrt(variance):.2g} times as large as the noise that was stated, so that the "
                "standard deviations are too small"
            )
        neighbours = self._neighbours(fit, here)
        least = Noise.likely(self.unknowns.system, NEGLIGIBLE)
        exact = fit.noise.position < least.position and fit.noise.angle < least.angle
        if neighbours > SUSPECT and not exact:
            offset = any(each.kind == OFFSET for each in self.unknowns.every)
            more = "" if offset else f"; encoders that were set to something else are fitted with {OFFSET}"
            found.append(
                f"the residuals are no noise (neighbours correlate by {neighbours:.2f}): the machine does something "
                f"that these parameters do not describe, and the standard deviations are too small{more}"
            )
        thinned = [run for run in fit.runs if run.every > 1]
        return [
            *found,
            *(f"{run.name} is long: each {run.every}th sample was used" for run in thinned),
        ]

    def _neighbours(self, fit: Fit, here: Fitted) -> float:
        """Correlation of residuals with those of the next sample."""
        scatter, both, alone = fit.noise.of_rows(fit.kinds), 0.0, 0.0
        for seen in here.seen:
            white = seen.residuals / scatter
            both += float(np.sum(white[1:] * white[:-1]))
            alone += float(0.5 * (np.sum(white[1:] ** 2) + np.sum(white[:-1] ** 2)))
        return both / alone if alone > 0 else 0.0


def _sentence(words: str) -> str:
    """With a full stop; names of parameters stay as they are."""
    first = words.split(" ")[0]
    return f"{words}." if "_" in first or "[" in first else f"{words[:1].upper()}{words[1:]}."
