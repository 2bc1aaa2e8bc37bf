"""Manoeuvres along a route: of many, tried side by side, the cheapest that leads far along it and stays clear."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.flow.end_point_map import flow_through
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import finer, resolving
from nhpocp.horizon import Horizon
from nhpocp.interruption import Interruption
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.bracket_loops import BracketLoops
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.delicate_chain import end_by_start
from nhpocp.solvers.continuation.direct_controls import arriving, cheapest_first
from nhpocp.solvers.continuation.initial_control import drawn
from nhpocp.solvers.route.edges import clear
from nhpocp.solvers.route.loops import Loops
from nhpocp.solvers.route.pose_checks import PoseChecks
from nhpocp.solvers.route.route import Route

SEEDS = 32  # that are drawn where loops do not lead on
WIDTHS = (0.1, 0.3, 0.7, 1.2)  # in turn, with which they are
FEW, MANY = 10, 30  # evaluations of each: from loops, and from what is drawn
# length, in units of the problem's scales, below which the latter are tried too: of parts as long as 1 loops lead over
# 4 of 10, drawn ones over 6
SHORT = 2.0
STEPS = 40  # of a manoeuvre's integration
LEAST = 0.001  # length, in units of the problem's scales, that is tried last
LOOKS = 20  # at a path, before it is held against all checks
RESOLVED = 1e-6  # in units of the problem's scales: between ends with the steps of either simulation
PIECES = 200  # at most
SEEN = 20  # of them, before it is said how many the route takes
DELICATE = 2e6  # times what is off at any time: the replay's own rounding would then be seen
DETOURS, ASIDE = 4, 40  # at most, where no manoeuvre leads on, and the seeded controls that may make one
LONGER = 1.5  # times what has been reached at once, tried next


class Choice(NamedTuple):
    """Of manoeuvres that lead on that of the least effort^power times what errors are multiplied by."""

    most: int  # of the cheapest that are compared
    dearer: float  # times the effort of the first: others are not
    power: float
    of_chain: bool  # whether by the whole chain, else by the manoeuvre itself
    early: (
        bool  # whether, of what is drawn, of those that arrive first; to wait for all takes 1.6 times as long
    )


# the former leads far in few steps; along some routes it multiplies errors a hundred times as much, along others the
# latter takes three times as many steps
FRUGAL, GENTLE = Choice(4, 2.0, 1.0, False, True), Choice(8, 4.0, 0.25, True, False)


class RouteManoeuvres:
    """Controls that lead along a route, one after another.

    A loop of size s moves a driftless system by s² along its brackets, so that short parts of a route are followed by
    manoeuvres that stray from it like √length: where those leave what `PoseChecks` allow, shorter ones are tried.
    [Laumond, ch. 1] They are corrected from `BracketLoops`; where brackets of the second degree are too weak, from
    seeded controls.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        solver: Continuation,
        route: Route,
        checks: PoseChecks,
        seed: int,
        choice: Choice = GENTLE,
    ) -> None:
        """checks: what the manoeuvres' poses have to meet. seed: of the controls that are tried."""
        self.problem, self.checks = problem, checks
        self.whole = self.route = route  # as it was found, and what is left of it after detours
        self.controls: list[Control] = []
        self._choice = choice
        self.walked = 0.0  # of the route
        self._before = 0  # controls that lead to the start of the route
        self._last: Array | None = None  # Λ that leads from its end to the goal, where it ends beside that
        self.here = problem.start_point
        self._along = list[Array]()  # ∂here/∂ of where each control began, in units of the scales
        self.growth = 1.0  # by how much what is off at any of these is multiplied until another, at most
        own = solver.integrator
        kept = own if isinstance(own, RungeKutta4) else RungeKutta4()
        kernels = kept.kernels.for_long_work()
        integrator = resolving(replace(kept, steps=STEPS, kernels=kernels), problem.basis)
        self._solver = replace(solver, integrator=integrator, objective="none")
        self._part = replace(problem, horizon=Horizon(1.0), via=(), bounds=(), initial=None)
        self._loops = BracketLoops(self._part, route.poses.loops or Loops(problem))
        self._random = np.random.default_rng(seed)
        fine = finer(integrator)
        self.steps = int(finer(fine).steps)  # with which each of the controls is known to lead where it does
        self._rough, *self._flows = [
            flow_through(problem.system, problem.basis, 1.0, steps, ())
            for steps in (integrator, fine, finer(fine))
        ]

    @property
    def arrived(self) -> bool:
        """Whether the controls lead to the goal."""
        return self.walked >= self.route.length and self._last is None

    @property
    def delicate(self) -> bool:
        """Whether the controls multiply errors beyond what a replay can check; more of them will not mend that."""
        return self.growth > DELICATE

    @property
    def part(self) -> float:
        """Of the route that is walked."""
        return self.walked / self.route.length

    def walk(self, patience: float = np.inf) -> Iterator[float]:
        """Adds controls of unit time, one after another, until they have arrived, are delicate, or none leads on.

        patience: how many the whole route may seem to take; can be called again with more. Yields the part that is
        walked. Errors: Ctrl-C's.
        """
        step, growth, detours = self.route.length, 1.0, 0
        with Interruption() as interruption, np.errstate(all="ignore"):
            while len(self.controls) < PIECES and not (self.arrived or self.delicate):
                if self.walked >= self.route.length:
                    if not self._last_one(interruption):
                        return
                    continue
                if step <= LEAST:
                    detours += 1
                    if detours > DETOURS or not (self._approach() or self._detour()):
                        return
                    step = self.route.length
                count = len(self.controls) - self._before
                if count >= SEEN and count > patience * self.part:
                    return
                yield self.part
                reach = min(self.route.length, self.walked + step)
                if not self._manoeuvre(reach, interruption):
                    step, growth = 0.5 * step, 1.0
                    continue
                step, growth = growth * (reach - self.walked), LONGER
                self.walked = reach

    def _approach(self) -> bool:
        """Leads to a pose from which the goal was left backwards, if one is in sight; once.

        Where brackets of the second degree lose rank at the goal, no short manoeuvre leads to it, but a long one.
        """
        if self._last is not None or len(self.route.after(self.walked)) > 1:
            return False
        found = self._aside(self.problem.goal_point, self.here)
        if found is None:
            return False
        control, beside = found
        self._last = backwards(control)
        self._begin([self.here, beside])
        return True

    def _aside(self, start: Array, other: Array) -> tuple[Control, Array] | None:
        """Of some controls from a pose the one from whose end another pose is reached with the fewest manoeuvres."""
        best, fewest = None, np.inf
        for draw in range(ASIDE):
            control = Control(self._part.basis, drawn(self._part, self._random, WIDTHS[draw % len(WIDTHS)]))
            end = self._end(control, start)
            if end is None or not self.route.poses.valid(end, other):
                continue
            count = self.route.poses.manoeuvres(end, other)
            if count < fewest:
                best, fewest = (control, end), count
        return best

    def _begin(self, waypoints: Sequence[Array]) -> None:
        """Another route from here."""
        self.route = Route(np.array(waypoints), self.route.poses)
        self.walked, self._before = 0.0, len(self.controls)

    def _last_one(self, interruption: Interruption) -> bool:
        """Takes what leads from beside the goal to it, corrected for where one stands; whether that succeeds."""
        if self._last is None:
            return False
        part = replace(self._part, start=self._values(self.here))
        arrivals = arriving(self._solver, part, [self._last], MANY, interruption)
        if not self._best(cheapest_first(arrivals)):
            return False
        self._last = None
        return True

    def _detour(self) -> bool:
        """Steps aside to a pose from which the rest of the route is in sight; whether there is one among some."""
        ahead = self.route.after(self.walked)
        found = self._aside(self.here, ahead[0])
        if found is None:
            return False
        self._take(*found, self._derivative(found[0]))
        self._begin([self.here, *ahead])
        return True

    def _take(self, control: Control, end: Array, derivative: Array) -> None:
        self.growth = max(self.growth, self._grown(derivative))
        self._along = [derivative @ before for before in (*self._along, np.eye(len(derivative)))]
        self.controls.append(control)
        self.here = end

    def _derivative(self, control: Control) -> Array:
        """∂end/∂start of a control from `here`, in units of the scales."""
        return end_by_start(self.problem, self._rough, self.here, control)

    def _manoeuvre(self, reach: float, interruption: Interruption) -> bool:
        """Takes one that leads to that much of the route at little cost and stays clear; whether there is one."""
        there = self.route.at(reach)
        part = replace(self._part, start=self._values(self.here), goal=self._values(there))
        displacement, _ = self.route.poses.tangent(there, self.here)
        starts = self._loops.seeds(self.here, displacement)
        if self._best(cheapest_first(arriving(self._solver, part, starts, FEW, interruption))):
            return True
        if reach - self.walked >= SHORT:
            return False
        starts = [drawn(part, self._random, WIDTHS[seed % len(WIDTHS)]) for seed in range(SEEDS)]
        arrivals = arriving(self._solver, part, starts, MANY, interruption)
        return any(map(self._best, arrivals if self._choice.early else [cheapest_first(arrivals)]))

    def _best(self, controls: list[Control]) -> bool:
        """Takes the best of these, the cheapest first, if any is clear."""
        choice, clear_ones = self._choice, list[tuple[Control, Array, Array]]()
        for control in controls:
            if clear_ones and (
                len(clear_ones) == choice.most or control.effort > choice.dearer * clear_ones[0][0].effort
            ):
                break
            end = self._end(control, self.here)
            if end is not None:
                clear_ones.append((control, end, self._derivative(control)))
        if clear_ones:
            self._take(
                *min(clear_ones, key=lambda one: one[0].effort ** choice.power * self._weighed(one[2]))
            )
        return bool(clear_ones)

    def _weighed(self, derivative: Array) -> float:
        """What a manoeuvre with this derivative multiplies errors by, as the choice counts it."""
        return self._grown(derivative) if self._choice.of_chain else float(np.linalg.norm(derivative, 2))

    def _grown(self, derivative: Array) -> float:
        """By how much what is off at the start of any control, one with this derivative the last, is multiplied.

        Seen from the whole chain, manoeuvres whose errors cancel are preferred.
        """
        before = np.array([*self._along, np.eye(len(derivative))])
        return float(np.linalg.norm(derivative @ before, 2, axis=(1, 2)).max())

    def _end(self, control: Control, start: Array) -> Array | None:
        """Where a control leads; None where its path is not clear, or so steep that steps decide it."""
        path = self._flows[0].states(start, control.coefficients)
        if not np.isfinite(path).all() or not self.checks.valid(path[:: len(path) // LOOKS]):
            return None  # most that are not clear, in little time
        if not clear(self.checks, path):
            return None
        end = self._flows[1].end(start, control.coefficients)
        error = np.abs(end - path[-1]) / self.problem.scales.points
        return self.problem.system.state_space.nearest(end) if error.max() <= RESOLVED else None

    def _values(self, pose: Array) -> dict[str, Array]:
        return self.problem.system.state_space.unpack(pose)


def backwards(control: Control) -> Array:
    """Λ of -u(T - t), as far as the basis can make it, which leads a driftless system back."""
    basis, count = control.basis, 8 * control.basis.size
    times = control.horizon * (np.arange(count) + 0.5) / count
    table = basis.table(times, control.horizon)
    return np.asarray(np.linalg.lstsq(table, -control(times[::-1]), rcond=None)[0].T)
