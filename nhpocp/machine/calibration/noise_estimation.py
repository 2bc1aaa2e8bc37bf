"""The noise of each kind of measurement from its residuals. [Förstner 1979]"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from nhpocp.arrays import Array
from nhpocp.machine.calibration.fitting import Fit, Fitted, Model
from nhpocp.machine.calibration.measurements import Measurements
from nhpocp.machine.calibration.noise import KINDS, Noise, kinds_of
from nhpocp.systems.parallel_robot import ParallelRobot

ROUNDS = 30
SETTLED = 0.01  # of a noise: a smaller change is none
FEW = 5.0  # residuals, less the numbers fitted to them, of which nothing is estimated
THIRD = 20.0  # the variance of third differences of noise, of its own
REMEMBERED = 2  # rounds
LARGEST = np.log(100.0)  # change in a round


def estimate_noise(fit: Fit, here: Fitted, model: Model, least: Noise, check: Callable[[], None]) -> Fitted:
    """The iterate judged by the noise that its own residuals have, which is the fit's from now on.

    What is estimated of one noise depends on the others, slowly where positions and lengths say the same: the rounds
    are a fixed-point iteration of the logarithms, accelerated. [Anderson 1965] ``least``: taken for what is exact.
    """
    tried: list[Array] = []
    changes: list[Array] = []
    for _ in range(ROUNDS):
        check()
        logarithms = np.log([getattr(fit.noise, kind) for kind in KINDS])
        aimed = fit.noise.scaled(_factors(fit, here, model), least)
        change = np.log(fit.noise.ratios(aimed))
        if np.abs(change).max() < SETTLED:
            break
        tried, changes = [*tried, logarithms][-REMEMBERED - 1 :], [*changes, change][-REMEMBERED - 1 :]
        step = change
        if len(tried) > 1:
            ahead, falls = np.diff(tried, axis=0).T, np.diff(changes, axis=0).T
            weights = np.linalg.lstsq(falls, change, rcond=1e-6)[0]
            step = change - (ahead + falls) @ weights
        here = fit.with_noise(fit.noise.scaled(np.exp(np.clip(step, -LARGEST, LARGEST)), least), here)
        model = fit.model(here)
        trial = fit.moved(here, model, 1.0)
        if trial.cost < here.cost:
            here, model = trial, fit.model(trial)
    return here


def noise_by_differences(runs: Sequence[Measurements], system: ParallelRobot, least: Noise) -> Noise:
    """The noise before anything is fitted, by third differences of samples, in which a smooth motion hardly shows."""
    kinds, space = kinds_of(system), system.state_space
    found: list[list[Array]] = [[], [], []]
    for run in runs:
        moved = np.diff(run.lengths, 3, axis=0)
        found[2].append(moved.ravel())
        points = run.points[run.posed]
        ways = np.array([space.difference(b, a) for a, b in pairwise(points)]).reshape(-1, space.dimension)
        bent = np.diff(ways, 2, axis=0)
        for kind in (0, 1):
            found[kind].append(bent[:, kinds[: space.dimension] == kind].ravel())
    sizes = [np.concatenate(each) for each in found]
    likely = Noise.likely(system)
    values = [
        float(np.sqrt(np.mean(size**2) / THIRD)) if len(size) >= FEW else getattr(likely, kind)
        for size, kind in zip(sizes, KINDS, strict=True)
    ]
    return Noise(*values).scaled(np.ones(3), least)


def _factors(fit: Fit, here: Fitted, model: Model) -> Array:
    """By what factors the noise of each kind is larger than it was taken to be; 1 where too little is left to tell.

    Of every kind the sum of squares is divided by how many numbers there are less how many were fitted to them, the
    trace of their part of the hat matrix.
    """
    scatter = fit.noise.of_rows(fit.kinds)
    squares, numbers, fitted = np.zeros(3), np.zeros(3), np.zeros(3)
    for i, run in enumerate(fit.runs):
        seen, there = here.seen[i], run.posed
        white = np.concatenate([seen.by_state, seen.by_values[:, :, : len(model.step)]], axis=2)
        white = white / scatter[:, None]
        spread = model.swept[i].covariances(model.steps[i], model.covariance)
        leverage = np.sum((white @ spread) * white, axis=2)
        for kind in range(3):
            rows = fit.kinds == kind
            squares[kind] += np.sum((seen.residuals / scatter)[:, rows] ** 2)
            numbers[kind] += rows.sum() * (len(there) if kind == 2 else there.sum())
            fitted[kind] += leverage[:, rows].sum()
    left = numbers - fitted
    known = left >= FEW
    factors: Array = np.where(known, np.sqrt(squares / np.where(known, left, 1.0)), 1.0)
    return factors
