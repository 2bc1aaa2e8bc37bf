"""Integration of a system's equations under a stored control, by DOP853. [Hairer, Nørsett, Wanner I]

A path is integrated piece by piece between the control's breakpoints with one-sided control values, so that no step
straddles a discontinuity. The rotation is integrated as nine plain numbers and never projected: its drift off SO(3)
is one of the things that verification looks at.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isqrt
from typing import Protocol

import casadi as ca
import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.state_space import StateSpace
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import System
from nhpocp.verification.dop853 import NODES, Dop853, Steps, longer
from nhpocp.verification.fast_function import FastFunction
from nhpocp.verification.pieces import Inputs, Pieces, in_pieces

RTOL = ATOL = 1e-12  # the latter in units of the state's scales
METHOD = (
    f"DOP853 with SciPy's coefficients, rtol {RTOL:g}, atol {ATOL:g} of the state's scales, "
    "between the control's breakpoints"
)
MOST_STEPS = 5_000  # of a smooth piece; one takes 20 to 500
STEPS_PER_FUNCTION = 20  # more, for a basis whose functions oscillate: a harmonic takes up to 10
# of the horizon, at most a smooth piece: SciPy's own first step is absolute at a state of zeros
FIRST_STEP = 0.02
MANY = 1000  # pieces, from which on preparing to step over many at once is worth while
SHORTEST_STEP = 1e-9  # fraction of a smooth piece; a path that needs such steps ends there
ROUNDED = 10  # times the spacing of numbers near t: SciPy's least step

Driver = Callable[[Array], Array]  # t (k,) ↦ (k, ·), what stands beside u(t) in a rate


class Looking(Protocol):
    """What follows a path step by step, as `Watch` does."""

    @property
    def looks(self) -> bool: ...

    def look(self, step: Steps, low: float, high: float, end: Array) -> tuple[float, str | None]: ...


@dataclass(frozen=True)
class Path:
    """x(t) on [0, reached]; ``stopped`` says why the rest is missing, None where nothing is."""

    start: Array
    reached: float
    stopped: str | None = None
    _steps: Steps | None = field(default=None, repr=False)

    def __call__(self, times: Array) -> Array:
        """States (k, n) at times (k,) in [0, reached]."""
        times = np.asarray(times, dtype=float)
        if self._steps is None:
            return np.tile(self.start, (len(times), 1))
        return self._steps(times)

    @property
    def times(self) -> Array:
        """Where the integrator's steps end, 0 first."""
        return np.append([] if self._steps is None else self._steps.begins, self.reached)

    def at(self, time: float) -> Array:
        """The state (n,) at one time."""
        return np.asarray(self(np.array([time]))[0])

    def parts(self, many: int) -> list[Path]:
        """The paths of so many equal parts of the state, one after another."""
        size = len(self.start) // many
        return [
            Path(self.start[cut], self.reached, self.stopped, self._steps and self._steps.of_columns(cut))
            for cut in (slice(i * size, (i + 1) * size) for i in range(many))
        ]

    @staticmethod
    def beside(paths: Sequence[Path]) -> Path | None:
        """The path whose `parts` these are; None where they do not share their steps."""
        steps = [path._steps for path in paths]
        first = paths[0]
        shared = all(
            each is not None and steps[0] is not None and each.begins is steps[0].begins for each in steps
        )
        if not shared:
            return None
        start = np.concatenate([path.start for path in paths])
        return Path(start, first.reached, first.stopped, Steps.beside(steps))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Samples:
    """A path on a fine grid; a breakpoint inside stands twice, with the control's limit from either side."""

    times: Array
    states: Array
    controls: Array
    control_rates: Array


class Watch:
    """Follows the determinants that a system's equations divide by, from their value at the start.

    A product below ``vanishing`` times its largest value so far counts as zero: closer to a singularity rounding alone
    turns the step control back, thousands of times over.
    """

    def __init__(self, system: System, start: Array, vanishing: float) -> None:
        self._vanishing, self._names = vanishing, system.breaking()
        x = ca.SX.sym("x", system.state_space.size)
        regularity = system.regularity(x) if self._names else {}
        matrices = [ca.densify(regularity[name]) for name in self._names]
        self._matrices = [FastFunction(ca.Function("matrix", [x], [matrix])) for matrix in matrices]
        self._sign, self._largest = np.sign(self.value(start)), 0.0

    @property
    def looks(self) -> bool:
        """Whether there is anything to see."""
        return bool(self._matrices)

    def value(self, state: Array) -> float:
        """The product of the determinants; 1 for a system that divides by none."""
        product = 1.0
        for matrix in self._matrices:
            entries = matrix(state)
            side = isqrt(len(entries))
            product *= float(np.linalg.det(entries.reshape(side, side)))
        return product

    def look(self, step: Steps, low: float, high: float, end: Array) -> tuple[float, str | None]:
        """Where a step ends, ``high`` unless a zero is met before, and what was met. end: the state at ``high``."""
        value = self.value(end)
        self._largest = max(self._largest, abs(value))
        named = " or ".join(f"det {name.upper()}" for name in self._names)
        if np.sign(value) != self._sign:
            if self.value(step(np.asarray(low))) * value < 0:  # else the value is 0 or not a number
                high = float(
                    brentq(lambda t: self.value(step(np.asarray(t))), low, high, xtol=1e-12 * (high - low))
                )
            return high, f"{named}, by which these equations divide, changes its sign"
        if abs(value) < self._vanishing * self._largest:
            return high, f"{named}, by which these equations divide, vanishes"
        return high, None


def integrate(
    rate: ca.Function,
    control: Control,
    start: Array,
    watch: Looking | None = None,
    scales: Array | float = 1.0,
    driver: Driver | None = None,
    share: float = 1.0,
) -> Path:
    """ẋ = rate over the control's horizon; ends early where it cannot go on, or where ``watch`` meets a zero.

    rate: (x, u) ↦ ẋ, or (x, y, u) ↦ ẋ where a ``driver`` gives y(t). scales: the natural sizes of the state's numbers.
    No step or tolerance has a unit of its own. share: of the tolerances.
    """
    steps = Dop853(rate, share * RTOL, share * ATOL * scales)
    budget = MOST_STEPS + STEPS_PER_FUNCTION * control.basis.size
    run = _Integration(
        steps, np.asarray(start, dtype=float), FIRST_STEP * control.horizon, budget, watch, driver
    )
    many = driver is None and len(control.breakpoints) > MANY and steps.quick
    with np.errstate(all="ignore"):  # a step that overflows is rejected and shortened
        for pieces in in_pieces(control):
            done = run.stride(pieces) if many else 0
            for k in range(done, len(pieces)):
                if not run.stopped:
                    run.follow(pieces.inputs(k), *map(float, pieces.ends[k : k + 2]))
            if run.stopped:
                break
    return Path(np.asarray(start), run.reached, run.stopped, Steps.joined(run.steps) if run.steps else None)


@dataclass
class _Integration:
    """How far a path has been followed, and how."""

    step: Dop853
    state: Array
    longest: float  # of a first step
    budget: int  # steps of a piece
    watch: Looking | None
    driver: Driver | None
    reached: float = 0.0
    stopped: str | None = None
    steps: list[Steps] = field(default_factory=list)

    def stride(self, pieces: Pieces) -> int:
        """Over the first pieces in one step each; how many."""
        steps, ends = self.step.along(self.state, pieces, self.longest)
        if self.watch and self.watch.looks:
            for k, end in enumerate(ends):
                self._keep(steps[k : k + 1], float(pieces.ends[k + 1]), end)
                if self.stopped:
                    break
        elif len(ends):
            self.steps.append(steps)
            self.reached = float(pieces.ends[len(ends)])
        self.state = ends[-1] if len(ends) else self.state
        return len(ends)

    def follow(self, inputs: Inputs, first: float, last: float) -> None:
        """Over one piece, in as many steps as it takes."""
        time, width, taken, rejected = first, min(last - first, self.longest), 0, False
        while time < last and self.stopped is None:
            least = ROUNDED * float(np.spacing(time))
            if rejected and width < least:
                self.stopped = "the step size collapsed"
                return
            end = min(time + max(width, least), last)
            state, error, powers = self.step(self.state, end - time, self._given(inputs, time, end))
            if not taken and np.isnan(error) and not self._begins(inputs, time):
                self.stopped = "the rate there is not finite"
                return
            width, rejected = longer(end - time, error, rejected), not error < 1
            if rejected:
                continue
            taken += 1
            if end < last and end - time < SHORTEST_STEP * (last - first):
                self.stopped = "the step size collapsed"
            self._keep(
                Steps(np.array([time]), np.array([end - time]), self.state[None], powers[None]), end, state
            )
            if taken >= self.budget and end < last and self.stopped is None:
                self.stopped = (
                    f"{taken} steps were not enough for the smooth piece from t={first:g} to {last:g}"
                )
            time, self.state = end, state

    def _given(self, inputs: Inputs, time: float, end: float) -> Array:
        """What stands beside the state in the rate, where a step takes it."""
        times = time + (end - time) * NODES
        return np.hstack([self.driver(times), inputs(times)]) if self.driver else inputs(times)

    def _begins(self, inputs: Inputs, time: float) -> bool:
        """Whether the rate is finite where a piece begins."""
        return self.step.finite(self.state, self._given(inputs, time, time))

    def _keep(self, step: Steps, end: float, state: Array) -> None:
        """One step more, as far as nothing is met on it."""
        if self.watch and self.stopped is None:
            end, self.stopped = self.watch.look(step, self.reached, end, state)
        if end > self.reached:
            self.reached = end
            self.steps.append(step)


def replay(numeric: NumericSystem, control: Control, start: Array, scales: Array | float = 1.0) -> Path:
    """The system's own equations ẋ = G(x) u under the control; ``scales`` as for `integrate`."""
    patient = Watch(numeric.system, start, vanishing=1e-7)  # to stop here is to refute
    return integrate(numeric.rate_function, control, start, patient, scales)


def sample(path: Path, control: Control, count: int) -> Samples:
    """``count`` equidistant times over [0, reached], and both sides of every breakpoint."""
    breaks = np.asarray(control.breakpoints, dtype=float)
    inside = breaks[(breaks > 0) & (breaks < path.reached)]
    right = np.union1d(np.linspace(0.0, path.reached, count)[:-1], inside)
    left = np.append(inside, path.reached)
    together = np.concatenate([left, right])
    order = np.argsort(together, kind="stable")  # at a breakpoint, from the left first
    controls, rates = (
        np.concatenate([of(left, "left"), of(right, "right")])[order] for of in (control, control.derivative)
    )
    return Samples(together[order], path(together[order]), controls, rates)


def weighted_difference(space: StateSpace, points: Array, origins: Array, error_length: float) -> Array:
    """Tangent vectors (k, dimension) from origins to points (k, size) with the weights of E; SciPy's own logarithm."""
    here, there = space.split(points), space.split(origins)
    parts = []
    for block in space.blocks:
        a, b = here[block.name], there[block.name]
        if block.kind == "rotation":
            parts.append(Rotation.from_matrix(a @ b.transpose(0, 2, 1)).as_rotvec())
        else:
            parts.append((a - b).reshape(len(a), -1))
    return np.hstack(parts) * np.asarray(space.weights(error_length))
