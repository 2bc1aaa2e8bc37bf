"""Parameters, and the motions of all runs, fitted together: Gauss–Newton with exact derivatives, shortened steps.

Minimised is the sum of squares of all that was measured less what the motion shows, each divided by its noise, over θ,
the runs' starts and the changes of their lengths. SciPy's `least_squares` finds the same, and is the oracle in the
tests; but its Jacobian has a column for each of those changes, 600 for a run of 200 samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nhpocp.arrays import Array
from nhpocp.machine.calibration.leg_driven_steps import Bends, LegDrivenSteps, Linearised, Observed, Policy
from nhpocp.machine.calibration.measurements import Measurements
from nhpocp.machine.calibration.noise import Noise, kinds_of
from nhpocp.machine.calibration.smoothing import Swept, solved, sweep

ITERATIONS = 30
LIFTED = 6  # of them before those, of points that need not be a motion
SHORTEST = 2.0**-12  # of a step
ENOUGH = 1e-3  # standard deviations: a step of every parameter below it is none
FLAT = 1e-8  # of the sum of squares: a smaller fall is none
HELD = 1e6  # times as firmly as by the prior
FIRM = 1e-6  # of the least noise: what a start that has to fit a joint may miss


@dataclass(frozen=True)
class Fitted:
    """θ and the motions of all runs at one iterate. cost: Σ of squares, the prior's included."""

    values: Array
    points: list[Array]
    changes: list[Array]
    seen: list[Observed]
    cost: float


@dataclass(frozen=True)
class Model:
    """The sum of squares about an iterate: a sweep a run, and what all of them say of θ.

    information: R_θ of all runs, without the prior; step: the best δθ; covariance: of θ, with the prior.
    """

    steps: list[Linearised]
    swept: list[Swept]
    information: Array
    step: Array
    covariance: Array

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.step).all() and np.isfinite(self.covariance).all())


class Fit:
    """What is fitted to which runs. A weak prior holds what no run sees where the model has it.

    ``fixed``: θ stays as it is, and the motions alone are fitted. ``held``: rows (q, n) of directions, each number
    divided by its scale, along which θ stays.
    """

    def __init__(
        self, equations: LegDrivenSteps, runs: Sequence[Measurements], noise: Noise, *, fixed: bool = False
    ) -> None:
        self.equations, self.runs, self.fixed = equations, list(runs), fixed
        self.unknowns = equations.unknowns
        self.bends = [Bends.of(run) for run in runs]
        self.kinds = kinds_of(self.unknowns.system)
        self.noise = noise
        self.held = np.zeros((0, len(self.unknowns)))
        self._known: dict[int, tuple[Array, Array, Linearised]] = {}

    @property
    def samples(self) -> int:
        return sum(len(run.times) for run in self.runs)

    @property
    def _prior(self) -> Array:
        """Rows by θ, which are zero where the model has it."""
        n = len(self.unknowns)
        rows: Array = np.vstack([np.eye(n), HELD * self.held]) / self.unknowns.scales
        return rows

    def begin(self) -> Fitted:
        """Where to begin: what is measured itself, made a motion of the model by a few full steps.

        Between samples the measured poses are no motion of the model; that they become one, each step by little, is
        what makes this end well where a whole motion of a wrong model leads elsewhere (multiple shooting). [Bock 1983]
        """
        points = [self._filled(run) for run in self.runs]
        changes = [np.diff(run.lengths, axis=0) for run in self.runs]
        here = self._at(self.unknowns.start, points, changes)
        for _ in range(LIFTED):
            model = self.model(here)
            if not model.finite:
                break
            points, changes = [], []
            for i in range(len(self.runs)):
                moved, turned = model.swept[i].ways(model.steps[i], model.step)
                points.append(self.equations.retracted(here.points[i], moved))
                changes.append(here.changes[i] + turned)
            trial = self._at(self._values(here, model, 1.0), points, changes)
            if not np.isfinite(trial.cost):
                break
            here = trial
            apart = max(float(np.abs(each.defects).max()) for each in model.steps)
            if self._small(model) and apart < ENOUGH * min(self.noise.position, self.noise.angle):
                break
        return min(self._followed(here, self.model(here)), self._alone(), key=lambda each: each.cost)

    def foreseen(self) -> Model:
        """What the runs can say of θ at all: about the model's own motion along the lengths, smoothed.

        About a motion that is fitted, a machine that stands still would seem to say something, for fitted are the
        lengths' noise and the loops that it makes too.
        """
        return self.model(self._alone(smoothed=True))

    def _alone(self, smoothed: bool = False) -> Fitted:
        """The model's parameters as they are; each run from its first pose, along its lengths as measured."""
        d, m, points, changes = self.equations.dimension, self.equations.motors, [], []
        for run, bends in zip(self.runs, self.bends, strict=True):
            moved = np.diff(_smooth(run.lengths) if smoothed else run.lengths, axis=0)
            policy = Policy(
                np.repeat(run.points[:1], len(run.times), axis=0), moved, np.zeros((len(moved), m, d))
            )
            path, made = self.equations.follow(run, bends, self.unknowns.start, run.points[0], policy)
            points.append(path)
            changes.append(made)
        return self._at(self.unknowns.start, points, changes)

    def _followed(self, here: Fitted, model: Model) -> Fitted:
        """A motion of the model beside points that are none."""
        points, changes = [], []
        for i, run in enumerate(self.runs):
            policy = Policy(here.points[i], here.changes[i], model.swept[i].gains)
            path, made = self.equations.follow(run, self.bends[i], here.values, here.points[i][0], policy)
            points.append(path)
            changes.append(made)
        return self._at(here.values, points, changes)

    def _filled(self, run: Measurements) -> Array:
        """The poses that were measured, and between them the shortest ways."""
        space, there = self.equations.space, np.flatnonzero(run.posed)
        points = run.points.copy()
        for k in np.flatnonzero(~run.posed):
            before, after = there[there < k][-1], there[there > k][:1]
            points[k] = points[before]
            if len(after):
                share = (run.times[k] - run.times[before]) / (run.times[after[0]] - run.times[before])
                way = space.difference(points[after[0]], points[before])
                points[k] = space.retract(points[before], share * np.asarray(way))
        return points

    def _at(self, values: Array, points: list[Array], changes: list[Array]) -> Fitted:
        seen = [self.equations.observed(r, values, p) for r, p in zip(self.runs, points, strict=True)]
        scatter = self.noise.of_rows(self.kinds)
        total = sum(float(np.sum((each.residuals / scatter) ** 2)) for each in seen)
        total += float(np.sum((self._prior @ (values - self.unknowns.start)) ** 2))
        for path in points:
            total += float(np.sum((self.equations.invariants(values, path[0])[0] / self._firm) ** 2))
        return Fitted(values, points, changes, seen, total if np.isfinite(total) else np.inf)

    @property
    def _firm(self) -> float:
        return FIRM * min(self.noise.position, self.noise.leg_length)

    def with_noise(self, noise: Noise, here: Fitted) -> Fitted:
        """The iterate judged by another noise, which counts from now on."""
        self.noise = noise
        return self._at(here.values, here.points, here.changes)

    def model(self, here: Fitted) -> Model:
        """Linearised about an iterate."""
        scatter, n = self.noise.of_rows(self.kinds), 0 if self.fixed else len(self.unknowns)
        steps, swept = [], []
        for i in range(len(self.runs)):
            linear = self._linearised(i, here)
            linear = replace(linear, by_values=linear.by_values[:, :, :n])
            seen = here.seen[i]
            white = Observed(
                seen.residuals / scatter,
                seen.by_state / scatter[:, None],
                seen.by_values[:, :, :n] / scatter[:, None],
            )
            off, by_state, by_values = self.equations.invariants(here.values, here.points[i][0])
            firm = self._firm
            swept.append(sweep(linear, white, (-off / firm, by_state / firm, by_values[:, :n] / firm)))
            steps.append(linear)
        rest = np.vstack([each.rest for each in swept])
        prior = self._prior[:, :n]
        held = np.column_stack([prior, prior @ (self.unknowns.start - here.values)[:n]])
        whole: Array = np.linalg.qr(np.vstack([rest, held]), mode="r")
        whole = whole[:n]
        inverse = solved(whole[:, :n], np.eye(n))
        return Model(steps, swept, rest[:, :n], inverse @ whole[:, n], inverse @ inverse.T)

    def _linearised(self, i: int, here: Fitted) -> Linearised:
        """Of a run; at the last iterate it is known, by whatever noise that is judged."""
        known = self._known.get(i)
        if known is None or known[0] is not here.points[i] or known[1] is not here.values:
            run, bends = self.runs[i], self.bends[i]
            made = self.equations.linearised(run, bends, here.values, here.points[i], here.changes[i])
            self._known[i] = known = (here.points[i], here.values, made)
        return known[2]

    def _values(self, here: Fitted, model: Model, fraction: float) -> Array:
        full = np.zeros(len(self.unknowns))
        full[: len(model.step)] = model.step
        return here.values + fraction * full

    def moved(self, here: Fitted, model: Model, fraction: float) -> Fitted:
        """The iterate after so much of the best step; the changes answer to where the motions really go."""
        values = self._values(here, model, fraction)
        points, changes = [], []
        for i, run in enumerate(self.runs):
            swept = model.swept[i]
            space = self.equations.space
            start = np.asarray(space.retract(here.points[i][0], fraction * swept.start(model.step)))
            ahead = swept.forward - swept.gains_of_values @ model.step
            policy = Policy(here.points[i], here.changes[i] + fraction * ahead, swept.gains)
            path, made = self.equations.follow(run, self.bends[i], values, start, policy)
            points.append(path)
            changes.append(made)
        return self._at(values, points, changes)

    def _small(self, model: Model) -> bool:
        return bool((np.abs(model.step) <= ENOUGH * np.sqrt(np.diag(model.covariance))).all())

    def run(self, here: Fitted, check: Callable[[], None]) -> tuple[Fitted, Model, bool]:
        """To the least sum of squares; the last model, and whether it is one. ``check`` may raise between iterates."""
        for _ in range(ITERATIONS):
            check()
            model = self.model(here)
            if not model.finite:
                return here, model, False
            fraction, trial = 1.0, self.moved(here, model, 1.0)
            while not trial.cost < here.cost and fraction > SHORTEST:
                fraction *= 0.5
                trial = self.moved(here, model, fraction)
            if not trial.cost < here.cost:
                return here, model, self._small(model)
            fall = here.cost - trial.cost
            here = trial
            if fraction == 1.0 and self._small(model) and fall <= FLAT * here.cost + FLAT:
                return here, self.model(here), True
        return here, self.model(here), False


def _smooth(lengths: Array) -> Array:
    """Lengths (k, m) as parabolas over an eighth of the run have them. [Savitzky & Golay 1964]"""
    from scipy.signal import savgol_filter

    window = 2 * (len(lengths) // 16) + 1
    if window < 5:
        return lengths
    smoothed: Array = savgol_filter(lengths, window, 2, axis=0)
    return smoothed
