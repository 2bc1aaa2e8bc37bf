"""Whether the steps of an integration are fine enough: the one answer to it, for whoever asks.

Fixed steps must see every oscillation of a control (`enough_steps`, `resolving`). What is claimed on them is held
against a path of finer steps (`finer`, `settled_path`), and a search that could gain by their error asks how large it
is (`StepError`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.flow.dynamics import dynamics
from nhpocp.flow.integrators import CasadiRungeKutta, Flow, Integrator, RungeKutta4, uniform_grid
from nhpocp.problem import PlanningProblem

FEWEST, ENOUGH = 5.0, 10.0  # steps for each period of the fastest function of a basis
# Times the steps: at order 4 they leave 1/256 of the error, so that the distance between two paths is the error itself.
FINER = 4
MOST = 100_000  # steps: no integrator takes more
# in units of the problem's scales: by how much a path of manoeuvres may be wrong anywhere; verification holds stored
# trajectories to as much where the tolerance is tight
FOLLOWED = 1e-5
DOUBLINGS = 7
RUN_AWAY = 2  # of them, after which a path that is not finite is taken for one that has no end
CLOSE = 1e-7  # between the ends of a path and of the same with half the steps, over the state's scales
ALLOWED = 0.1  # of the tolerance on E: the error of integration that a plan may carry


def enough_steps(steps: int, basis: ControlBasis) -> int:
    """These, or with fewer than `FEWEST` a period, so that they are blind to the control, as many as it takes."""
    return steps if steps >= FEWEST * basis.oscillations else ceil(ENOUGH * basis.oscillations)


def resolving(integrator: Integrator, basis: ControlBasis) -> Integrator:
    """An integrator whose fixed steps see every oscillation of a basis: with more steps, where its own are too few."""
    if not isinstance(integrator, RungeKutta4 | CasadiRungeKutta):
        return integrator
    steps = enough_steps(integrator.steps, basis)
    return integrator if steps == integrator.steps else replace(integrator, steps=steps)


def finer(integrator: Integrator) -> Integrator:
    """Runge and Kutta's with `FINER` times the steps, `MOST` at most, which takes controls with jumps too."""
    steps = min(MOST, FINER * getattr(integrator, "steps", RungeKutta4.steps))
    return replace(integrator, steps=steps) if isinstance(integrator, RungeKutta4) else RungeKutta4(steps)


def settled_path(
    problem: PlanningProblem,
    control: Control,
    steps: int,
    start: Array | None = None,
    grid: Callable[[int, Array, float], Array] = uniform_grid,
) -> tuple[Array, Array]:
    """Times and states by RK4 from the start, or another point, the steps doubled until that no longer moves the path.

    grid: (steps, breakpoints, horizon) ↦ times.
    """
    start = problem.start_point if start is None else start
    rate = dynamics(problem.system)  # whose kernel there may be
    last: tuple[Array, Array] | None = None
    for doubling in range(DOUBLINGS + 1):
        times = grid(steps * 2**doubling, control.breakpoints, control.horizon)
        flow = RungeKutta4().flow(rate, control.basis, control.horizon, times)
        path = flow.states(start, control.coefficients)
        if not np.isfinite(path).all():
            if doubling >= RUN_AWAY:
                break
            continue
        if last is not None:
            before, coarse = last
            shared = path[np.searchsorted(times, before - 1e-9 * control.horizon)]
            moved = np.abs(shared - coarse) / problem.scales.points
            if moved.max() < CLOSE * (1.0 + np.abs(path[-1] / problem.scales.points).max()):
                break
        last = times, path
    return times, path


def path_error(problem: PlanningProblem, control: Control, integrator: Integrator) -> float:
    """How wrong a path is where it is so most, in units of the problem's scales; estimated as `StepError` does.

    The end may be right where a loop close to a singular surface is not, and comes back.
    """
    if not isinstance(integrator, RungeKutta4):
        return 0.0
    rate, start = dynamics(problem.system), problem.start_point
    few = replace(integrator, steps=max(1, integrator.steps // FINER))
    fine, coarse = (each.flow(rate, control.basis, control.horizon) for each in (integrator, few))
    states = [flow.states(start, control.coefficients) for flow in (fine, coarse)]
    if not all(np.isfinite(each).all() for each in states):
        return np.inf
    places = np.searchsorted(fine.times, coarse.times - 1e-9 * control.horizon)
    shared = np.abs(fine.times[places] - coarse.times) < 1e-9 * control.horizon
    change = np.abs(states[0][places] - states[1])[shared] / problem.scales.points
    return float(change.max()) / (FINER**4 - 1)


def following(problem: PlanningProblem, control: Control) -> RungeKutta4:
    """Steps with which the whole path is `FOLLOWED`, the default's or `FINER` times as many, up to `MOST`.

    The default's where the path is not finite with more either: it has no end then.
    """
    integrator, blown = RungeKutta4(), 0
    while integrator.steps < MOST:
        wrong = path_error(problem, control, integrator)
        blown += not np.isfinite(wrong)
        if blown == RUN_AWAY:
            return RungeKutta4()
        if wrong <= FOLLOWED:
            break
        integrator = replace(integrator, steps=min(MOST, FINER * integrator.steps))
    return integrator


class StepError:
    """How wrong the end of a path is, estimated from the same path with 1/`FINER` of the steps [E's unit].

    Near det S = 0 the position moves at next to no cost, and fixed steps jump across: there least effort would be an
    artefact. Integrators that choose their own steps are taken at their word.
    """

    def __init__(self, problem: PlanningProblem, integrator: Integrator, horizon: float) -> None:
        self._problem = problem
        self._coarse: Flow | None = None
        if isinstance(integrator, RungeKutta4):
            coarse = replace(integrator, steps=max(1, integrator.steps // FINER))
            self._coarse = coarse.flow(dynamics(problem.system), problem.basis, horizon)

    def error(self, coefficients: Array, end: Array) -> float:
        """Of the end point ``end`` (packed) under a control; infinite where the coarse path has no end."""
        if self._coarse is None:
            return 0.0
        coarse = self._coarse.end(self._problem.start_point, coefficients)
        if not np.isfinite(coarse).all():
            return np.inf
        space = self._problem.system.state_space
        change = space.lower(end, coarse - end)  # both are near; no logarithm is needed
        weighted = np.asarray(space.weights(self._problem.error_length)) * change
        # [Hairer, Nørsett, Wanner] II.4: a scheme of order 4 is wrong by 4⁴ times as much with a quarter of the steps
        return float(np.linalg.norm(weighted)) / (FINER**4 - 1)
