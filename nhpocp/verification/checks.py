"""The checks of a verdict: a replayed path against what a Solution claims, its legs and bounds looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound, BoundReport, check_bounds
from nhpocp.solution import Crossing, Replay, Solution, Verdict
from nhpocp.state_space import Block
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS, SPEEDS
from nhpocp.systems.margins import sigma
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.system import DISTANCE, System
from nhpocp.verification import geometry
from nhpocp.verification.accelerations import second_differences
from nhpocp.verification.crossings import find_crossings
from nhpocp.verification.distances import distance_report, measured_by
from nhpocp.verification.replay import (
    METHOD,
    Path,
    sample,
    weighted_difference,
)

SAMPLES = 1001
SLACK = 1.01  # on the solver's tolerance, for the difference between two integrators
GEOMETRY_TOLERANCE = 1e-6  # on rolling and leg_rate
NEAR_SINGULAR = 1e-3  # σ_min under which the system's own rates have too few digits left for that
DRIFT = 1e-5  # on RᵀR; a start may be off by 1e-6, and the exact flow keeps RᵀR as it is
QUANTITY_TOLERANCE = 1e-4  # of a quantity's largest magnitude on the path; of one radian for angles
NUDGE = 1e-9  # relative change of the state; what that does to a quantity is never held against it
# relative: a sequence's durations add up to rounding, and optimizers may relax a bound by 1e-8
SAME_TIME = 1e-6
JUMP = 1e-6  # of the largest leg speed: what two pieces that are meant to meet may differ by
PATH_TOLERANCE = 1e-5  # fraction of the mechanism's length by which a stored trajectory may be off


@dataclass
class Check:
    """One verification under way: each method is one check, and notes what it finds in reasons and warnings."""

    solution: Solution
    numeric: NumericSystem
    path: Path
    reasons: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.problem, self.control = self.solution.problem, self.solution.control
        self.system: Any = self.problem.system
        self.space = self.system.state_space
        self.samples = sample(self.path, self.control, SAMPLES)
        self.allowed = SLACK * self.solution.tolerance

    def verdict(self, original: Path | None) -> Verdict:
        """All checks; original: the path of eq. (3), where there is one."""
        self.horizon()
        error = self.end_error()
        rolling, leg_rate = self.legs()
        replayed = self.original(original)
        return Verdict(
            error=error,
            method=self.method,
            reached=float(self.path.reached),
            original=replayed,
            rolling=rolling,
            leg_rate=leg_rate,
            orthogonality=self.orthogonality(),
            trajectory_deviation=self.trajectory_deviation(),
            crossings=self.judged_crossings(),
            bounds=self.bounds(),
            # last, since the checks above fill them
            reasons=tuple(self.reasons),
            warnings=tuple(self.warnings),
            ok=not self.reasons,
        )

    @property
    def method(self) -> str:
        legs = "; legs by five-point differences of their frames" if geometry.has_legs(self.system) else ""
        distances = f"; {measured_by(self.system.surroundings)}" if self._apart else ""
        return f"{METHOD}{legs}{distances}"

    @cached_property
    def trajectory(self) -> dict[str, Array]:
        """The replay's blocks, inputs, outputs and margins at the samples."""
        samples = self.samples
        return self.numeric.trajectory(
            samples.states, samples.controls, self.problem.scale, samples.control_rates
        )

    def pose_error(self, point: Array, goal: Mapping[str, Any]) -> float:
        """E over the blocks and outputs that ``goal`` fixes. [Paper] section 4"""
        values = {name: goal.get(name, value) for name, value in self.problem.start.items()}
        target = np.asarray(self.space.pack(values), dtype=float)
        difference = weighted_difference(self.space, point[None], target[None], self.problem.error_length)[0]
        parts = [difference[self.space.tangent_slice(name)] for name in goal if name in self.space.names]
        still = np.zeros((1, self.system.input_space.size))
        outputs = self.numeric.outputs(point[None], still) if len(parts) < len(goal) else {}
        for output in self.system.pose_outputs:
            if output.name in goal:
                parts.append(self._output_error(output, np.ravel(outputs[output.name][0]), goal[output.name]))
        return float(np.linalg.norm(np.concatenate(parts)))

    def _output_error(self, output: Block, value: Array, wanted: Array) -> Array:
        """Differences in the units of E; of a direction the angle, by the half-angle formula."""
        if output.kind == "direction":
            value = value / np.linalg.norm(value)
            return np.array([2 * np.arctan2(np.linalg.norm(value - wanted), np.linalg.norm(value + wanted))])
        return (value - np.ravel(wanted)) / (self.problem.error_length if output.unit == "length" else 1.0)

    def horizon(self) -> None:
        """Whether the control lasts as long as the problem says."""
        wanted, duration = self.problem.horizon, self.control.horizon
        if not wanted.free:
            if wanted.initial is not None and not np.isclose(
                duration, wanted.initial, rtol=SAME_TIME, atol=0
            ):
                self.reasons.append(
                    f"the control lasts {duration:g}; the problem's horizon is {wanted.initial:g}"
                )
            return
        low, high = wanted.minimum or 0.0, wanted.maximum or np.inf
        if not low * (1 - SAME_TIME) <= duration <= high * (1 + SAME_TIME):
            self.reasons.append(
                f"the control lasts {duration:g}, outside the problem's horizon [{low:g}, {high:g}]"
            )

    def end_error(self) -> float | None:
        """E at T and at the via poses, together."""
        horizon, errors = self.control.horizon, []
        for via in self.problem.via:
            if via.share * horizon <= self.path.reached:
                missed = self.pose_error(self.path(np.array([via.share * horizon]))[0], via.goal)
                errors.append(missed)
                if not missed <= self.allowed:
                    self.reasons.append(
                        f"the via pose at {via.share:g} of the horizon is missed by {missed:.3g}"
                    )
        if self.path.stopped:
            self.reasons.append(f"the replay stopped at {self._stop(self.path)}")
            return None
        error = self.pose_error(self.path(np.array([horizon]))[0], self.problem.goal)
        if not error <= self.allowed:
            self.reasons.append(
                f"the replayed end misses the goal by {error:.3g}; the tolerance is {self.solution.tolerance:g}"
            )
        whole = float(np.linalg.norm([*errors, error]))
        if not whole <= self.allowed and not self.reasons:
            self.reasons.append(
                f"goal and via poses are missed by {whole:.3g} together; the tolerance is {self.solution.tolerance:g}"
            )
        return whole

    def _stop(self, path: Path) -> str:
        """Where and why a path ends early, and how close to a singularity."""
        least = self.numeric.sigmas(path(np.array([path.reached])), self.problem.scale)
        places = [f"{sigma(name).name} = {values[0]:.2g}" for name, values in least.items()]
        return f"t={path.reached:.6g} of {self.control.horizon:g}: {path.stopped}" + (
            f" ({', '.join(places)} there)" if places else ""
        )

    def legs(self) -> tuple[float | None, float | None]:
        """(rolling, leg_rate), the worst of all samples that are not close to where the equations divide by zero."""
        if not geometry.has_legs(self.system):
            return None, None
        margins = [sigma(name).name for name in self.system.breaking()]
        clear = np.all([self.trajectory[name] > NEAR_SINGULAR for name in margins], axis=0)
        if not clear.all():
            self.warnings.append(
                f"rolling and leg speeds were not checked at {np.sum(~clear)} of {len(clear)} samples, "
                f"where {' or '.join(margins)} is below {NEAR_SINGULAR:g}"
            )
        if not clear.any():
            self.reasons.append("the whole path is too close to a singularity to check that the legs roll")
            return None, None
        by_geometry = geometry.residuals(
            self.numeric, self.samples.states[clear], self.samples.controls[clear]
        )
        rolling, leg_rate = (float(np.max(values)) for values in by_geometry)
        if not rolling <= GEOMETRY_TOLERANCE:
            self.reasons.append(
                f"the legs turn about r: |r·ω|/|ω| is {rolling:.3g}, allowed {GEOMETRY_TOLERANCE:g}"
            )
        if not leg_rate <= GEOMETRY_TOLERANCE:
            self.reasons.append(
                f"the legs' lengths do not change as u says: off by {leg_rate:.3g}, allowed {GEOMETRY_TOLERANCE:g}"
            )
        return rolling, leg_rate

    def passes_over(self, other: System) -> bool:
        """Whether the whole path can be followed by equations that divide by other determinants."""
        return self.path.stopped is None and not self._touched(other)

    def _touched(self, other: System) -> list[Crossing]:
        """Zeros that an integrator's steps may pass over as if they were not there."""
        return [c for c in self.crossings if c.touches and c.matrix in other.breaking()]

    def original(self, path: Path | None) -> Replay | None:
        """Open-loop replay of eq. (3) under u(t) recovered by eq. (6) along the replay of eq. (7)."""
        actuated = self.system.actuated()
        if actuated is None or self.path.stopped:
            return None
        if path is None:
            touched = self._touched(actuated[0])[0]
            self.warnings.append(
                f"the original equations (3) divide by det {touched.letter}, which is zero at t={touched.time:.6g}"
            )
            return Replay(None, touched.time, False)
        if path.stopped:
            self.warnings.append(
                f"the original equations (3) under the recovered leg speeds can be followed only to {self._stop(path)}"
            )
            return Replay(None, path.reached, False)
        times = np.unique(self.samples.times)
        apart = weighted_difference(self.space, path(times), self.path(times), self.problem.error_length)
        error = self.pose_error(path(times[-1:])[0], self.problem.goal)
        agreement = float(np.linalg.norm(apart, axis=1).max())
        return Replay(error, path.reached, error <= self.allowed, agreement)

    def orthogonality(self) -> float | None:
        """max |RᵀR - I| along the replay."""
        blocks = [block.name for block in self.space.blocks if block.kind == "rotation"]
        if not blocks:
            return None
        states = self.space.split(self.samples.states)
        drift = max(float(np.abs(_gram(states[name]) - np.eye(3)).max()) for name in blocks)
        if not drift <= DRIFT:
            self.reasons.append(f"the replayed orientation leaves the rotations: |RᵀR - I| = {drift:.3g}")
        return drift

    def trajectory_deviation(self) -> float | None:
        """Largest distance of the stored trajectory from the replay, at the stored times that the replay reached."""
        stored = self.solution.trajectory
        if "t" not in stored or any(name not in stored for name in self.space.names):
            self.reasons.append("no stored trajectory to compare with the replay")
            return None
        times, horizon = np.asarray(stored["t"], dtype=float), self.control.horizon
        blocks = {name: np.asarray(stored[name], dtype=float) for name in self.space.names}
        if not len(times) or any(len(block) != len(times) for block in blocks.values()):
            self.reasons.append("the stored trajectory's arrays are of different lengths, or empty")
            return None
        for block in self.space.blocks:
            if not self._has_shape(block.name, blocks[block.name], (len(times), *block.shape)):
                return None
        states = np.hstack([block.reshape(len(times), -1) for block in blocks.values()])
        if not (np.isfinite(states).all() and np.isfinite(times).all()):
            self.reasons.append("the stored trajectory is not finite")
            return None
        if max(abs(times[0]), abs(times[-1] - horizon)) > 1e-9 * horizon or np.any(np.diff(times) < 0):
            self.reasons.append(
                f"the stored times run from {times[0]:g} to {times[-1]:g}; expected 0 to {horizon:g}, in order"
            )
        seen = (times >= 0) & (times <= self.path.reached + 1e-9 * horizon)
        if not seen.any():
            return None
        here = self.path(np.minimum(times[seen], self.path.reached))
        apart = weighted_difference(self.space, states[seen], here, self.problem.error_length)
        distances = np.linalg.norm(apart, axis=1)
        worst = int(np.argmax(distances))
        fraction = PATH_TOLERANCE * self.problem.scale / self.problem.error_length  # in the units of E
        if not distances[worst] <= max(fraction, self.solution.tolerance):
            self.reasons.append(
                f"the stored trajectory is off the replay by {distances[worst]:.3g} at t={times[seen][worst]:.4g}"
            )
        self._compare_quantities(times[seen], here, seen)
        return float(distances[worst])

    def _compare_quantities(self, times: Array, states: Array, seen: Array) -> None:
        """Stored controls, outputs and margins against those of the replay."""
        controls, rates = self.control(times), self.control.derivative(times)
        expected = self.numeric.trajectory(states, controls, self.problem.scale, rates)
        # one that is zero up to rounding has no scale of its own, and one at a pole has no digits
        nudged = self.numeric.trajectory(states * (1 + NUDGE), controls, self.problem.scale, rates)
        blocks = {block.name: block for _, block in self.problem.quantities}
        for name, values in expected.items():
            if name in self.space.names or name not in self.solution.trajectory:
                continue
            stored = np.asarray(self.solution.trajectory[name], dtype=float)
            if not self._has_shape(name, stored, (len(seen), *values.shape[1:])):
                continue
            stored = stored[seen]
            block = blocks[name]
            scale = 1.0 if block.wraps else _largest(values)
            apart = _largest(_apart(block, stored, values))
            if not apart <= QUANTITY_TOLERANCE * scale + 10 * _largest(_apart(block, nudged[name], values)):
                self.reasons.append(f"the stored {name} is off the replay's by {apart:.3g}")

    def _has_shape(self, name: str, stored: Array, shape: tuple[int, ...]) -> bool:
        """Whether a stored array can be compared at all; notes it where not."""
        if stored.shape != shape:
            self.reasons.append(f"the stored {name} is of shape {stored.shape}; expected {shape}")
        return bool(stored.shape == shape)

    @cached_property
    def crossings(self) -> list[Crossing]:
        """Zeros of the determinants along the replay."""
        return find_crossings(self.numeric, self.path, self.samples.times, self.problem.scale)

    def judged_crossings(self) -> list[Crossing]:
        """The zeros of the determinants; fatal where the system's own equations divide by one."""
        for crossing in self.crossings:
            letter, where = crossing.letter, f"t={crossing.time:.6g}"
            does = "touches zero" if crossing.touches else "changes its sign"
            if crossing.matrix in self.system.breaking():
                if not self.path.stopped:  # else the replay ended there and has said so
                    self.reasons.append(f"det {letter}, by which these equations divide, is zero at {where}")
            elif letter == "W":
                self.warnings.append(
                    f"det W {does} at {where}: a parallel singularity, where the actuators lose the platform"
                )
            else:
                self.warnings.append(f"det {letter} {does} at {where}")
        return self.crossings

    @cached_property
    def _apart(self) -> list[Bound]:
        """The bounds on distances."""
        return [bound for bound in self.problem.bounds if bound.quantity == DISTANCE]

    def _measured(self, bound: Bound) -> BoundReport:
        """A bound on distances, by another measurement, between the samples too."""
        report, bounded = distance_report(bound, self.system, self.path, np.unique(self.samples.times))
        if not bounded:
            self.warnings.append(
                f"{bound.label} was looked at on samples only: between them it changes too fast"
            )
        return report

    def _accelerations(self) -> dict[str, Array]:
        """Of the legs, by differences of their replayed lengths; infinite where their speeds jump."""
        if not self.system.accelerated:
            return {}
        times, speeds = self.samples.times, self.trajectory[SPEEDS]
        values = second_differences(self.system, self.path, times, self.control)
        jumped = np.diff(speeds, axis=0) * (np.diff(times) == 0)[:, None]
        jumped[np.abs(jumped) <= JUMP * _largest(speeds)] = 0.0
        for side in (values[:-1], values[1:]):
            side[jumped != 0] = np.copysign(np.inf, jumped[jumped != 0])
        return {LEG_ACCELERATIONS: values}

    def bounds(self) -> list[BoundReport]:
        """Every stated constraint on the fine grid."""
        if not self.problem.bounds:
            return []
        others = [bound for bound in self.problem.bounds if bound not in self._apart]
        trajectory = {**self.trajectory, **self._accelerations()}
        found = dict(zip(others, check_bounds(others, self.samples.times, trajectory), strict=True))
        found |= {bound: self._measured(bound) for bound in self._apart}
        reports = [found[bound] for bound in self.problem.bounds]
        self.reasons.extend(_broken_words(report) for report in reports if not report.ok)
        return reports


def _broken_words(report: BoundReport) -> str:
    if report.bound.quantity == LEG_ACCELERATIONS and np.isinf(report.value):
        return f"the legs' speeds jump at t={report.time:.4g}, where {report.name} is infinite"
    return f"{report.broken_words()}, more than the {report.bound.figure(report.allowed, '.3g')} allowed"


def _gram(rotations: Array) -> Array:
    return rotations.transpose(0, 2, 1) @ rotations


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _apart(block: Block, values: Array, others: Array) -> Array:
    """The difference; the shorter way round for angles that jump by 2π where they are cut."""
    difference = values - others
    return np.angle(np.exp(1j * difference)) if block.wraps else difference
