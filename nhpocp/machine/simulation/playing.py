"""A plan played on the machine: its leg lengths as set-points over time, and what the machine makes of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import Any

import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array
from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import STOPPED, Interruption
from nhpocp.machine.model_errors import ModelErrors
from nhpocp.machine.simulation.building import drive_of
from nhpocp.machine.simulation.built import Drive
from nhpocp.machine.simulation.machine import CONTROL_STEP, LONGEST_SETTLING, Machine, MachineBroke
from nhpocp.machine.simulation.settings import MachineSettings
from nhpocp.solution import Solution
from nhpocp.systems.system import System

SAMPLES = 400  # over the duration
SHORTEST, LONGEST = 0.01, 3600.0  # s
REST = 0.5  # s that the last set-point is held for at least, until nothing moves, before the end is judged
TOLERANCE = 5e-3  # units of length, and degrees


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """A plan and what a machine made of it.

    solution: the plan. system: with the machine's own parameters. settings: of the machine. duration: that the plan was
    played over [s]. tolerance: by which the end may miss the plan's, in units of length and in degrees. trajectory:
    arrays by name, samples first: "t" [s], of the machine "position", "orientation", "leg_lengths", "motor_force" [N],
    "normal_force", "friction_force" [N] and "slip_rate", "slip" [length/s, length] of the rollers, and of the plan
    "planned_position", "planned_orientation", "planned_leg_lengths", "position_error" [length], "angle_error" [rad].
    drive: what the motors follow; where that are no leg lengths, arrays are called by its name. rollers: numbers of the
    contacts, those of their legs, in the order of the arrays. failure: in words, "" for none; what
    was measured before it is there, and the errors at the end are those where it ended. interrupted: whether somebody
    stopped it. model: the machine as MJCF. engine: which, and its version. seconds: that the computer took.
    """

    solution: Solution
    system: System
    settings: MachineSettings
    duration: float
    tolerance: float
    trajectory: Mapping[str, Array]
    drive: Drive
    rollers: tuple[int, ...]
    failure: str
    interrupted: bool
    model: str = field(repr=False)
    engine: str
    seconds: float

    @property
    def motors(self) -> tuple[str, ...]:
        """The last words of the motors' labels, numbers of legs, in the order of the arrays."""
        return tuple(label.split()[-1] for label in self.drive.labels)

    @property
    def position_error(self) -> float:
        """Distance of the platform's origin from the plan's at the end [length]."""
        return float(self.trajectory["position_error"][-1])

    @property
    def angle_error(self) -> float:
        """Angle of the platform from the plan's at the end [rad]."""
        return float(self.trajectory["angle_error"][-1])

    @property
    def slip(self) -> float:
        """The way that a ball has slipped along the axle of its roller, of the worst of them [length]."""
        slip = self.trajectory["slip"]
        return float(slip[-1].max()) if slip.size else 0.0

    @property
    def outcome(self) -> str:
        """`reached`, `missed`, `interrupted` by hand, or `broken` by what it was to do."""
        if self.interrupted:
            return "interrupted"
        return "broken" if self.failure else "reached" if self.reached else "missed"

    @property
    def reached(self) -> bool:
        """Whether the plan was one to its goal, and its end was met within the tolerance."""
        met = self.position_error <= self.tolerance and degrees(self.angle_error) <= self.tolerance
        return bool(met and self.solution.converged and not self.failure)

    @property
    def worst_following(self) -> tuple[float, float]:
        """The largest errors on the way [length, rad]."""
        position, angle = (self.trajectory[name] for name in ("position_error", "angle_error"))
        return float(np.nanmax(position)), float(np.nanmax(angle))


def play(
    solution: Solution,
    settings: MachineSettings | None = None,
    *,
    duration: float = 10.0,
    tolerance: float = TOLERANCE,
    progress: Callable[[int, int], Any] | None = None,
) -> Simulation:
    """Builds the machine at the plan's start, lets it settle, plays the plan's leg lengths over ``duration`` [s].

    A driftless plan may be played at any speed: the path is the same. The encoders are set to the plan's lengths at the
    start. ``progress(done, count)`` is told of steps. Errors: `InvalidProblemError` for a robot that cannot be built or
    a plan without a finite path; `MissingDependencyError` without MuJoCo.
    """
    began = time.perf_counter()
    settings = settings or MachineSettings()
    if not SHORTEST <= duration <= LONGEST:
        raise InvalidProblemError(f"{duration:g} s; expected {SHORTEST} to {LONGEST:g} s", path="duration")
    if not tolerance > 0:
        raise InvalidProblemError(f"{tolerance:g}; expected a number > 0", path="tolerance")
    system = solution.problem.system
    drive = drive_of(system)
    plan = _Plan(solution, drive)
    start = {"position": plan.position(0.0), "orientation": plan.orientation(0.0)}
    own = ModelErrors.parsed(settings.errors, system).machine()[0]
    machine = Machine(own, start, settings)
    log = _Log(machine, plan, drive.name)
    failure, interrupted = "", False
    with Interruption() as interruption:
        try:
            _follow(machine, plan, log, duration, progress, interruption.check)
        except KeyboardInterrupt:
            failure, interrupted = f"{STOPPED} after {machine.time:.3g} s", True
        except MachineBroke as error:
            failure = str(error)
        log.sample()
    return Simulation(
        solution=solution,
        system=own,
        settings=settings,
        duration=duration,
        tolerance=tolerance,
        trajectory=log.trajectory(),
        drive=drive,
        rollers=tuple(roller.leg for roller in machine.built.rollers),
        failure=failure,
        interrupted=interrupted,
        model=machine.built.text,
        engine=machine.engine,
        seconds=time.perf_counter() - began,
    )


def _follow(
    machine: Machine,
    plan: _Plan,
    log: _Log,
    duration: float,
    progress: Callable[[int, int], Any] | None,
    check: Callable[[], None],
) -> None:
    """Until the plan is over and nothing moves any more; between two steps ``check`` may raise."""
    machine.home(plan.set_points(0.0))
    machine.settle()
    steps = max(1, round(duration / CONTROL_STEP))
    every = max(1, round(steps / SAMPLES))
    least, most = (steps + round(seconds / CONTROL_STEP) for seconds in (REST, LONGEST_SETTLING))
    log.sample()
    for k in range(1, most + 1):
        check()
        log.now, log.share = k * CONTROL_STEP, min(1.0, k / steps)
        if k <= steps:
            machine.command(plan.set_points(log.share))
        machine.advance(CONTROL_STEP)
        if k >= least and machine.at_rest:
            break
        if k % every == 0:
            log.sample()
            if progress:
                progress(min(k, steps), steps)


class _Plan:
    """The plan's pose and its driven legs' lengths at a share of its horizon."""

    def __init__(self, solution: Solution, drive: Drive) -> None:
        from scipy.interpolate import CubicSpline

        path = {name: np.asarray(solution.trajectory[name]) for name in ("t", "position", "orientation")}
        lengths = np.asarray(solution.trajectory[drive.source]).reshape(len(path["t"]), -1)
        if len(path["t"]) < 2 or not all(np.isfinite(values).all() for values in (*path.values(), lengths)):
            raise InvalidProblemError(
                f"this plan has no finite path to follow ({solution.outcome.value}); solve again, then simulate"
            )
        self._shares = path["t"] / path["t"][-1]
        self._lengths = CubicSpline(self._shares, lengths[:, list(drive.columns)])
        self._position = CubicSpline(self._shares, path["position"])
        self._rotations = path["orientation"].reshape(-1, 3, 3)

    def set_points(self, share: float) -> Array:
        return self._lengths(share)

    def position(self, share: float) -> Array:
        return self._position(share)

    def orientation(self, share: float) -> Array:
        k = int(np.clip(np.searchsorted(self._shares, share) - 1, 0, len(self._shares) - 2))
        first, second = self._rotations[k], self._rotations[k + 1]
        part = (share - self._shares[k]) / (self._shares[k + 1] - self._shares[k])
        return so3.exp(part * so3.log(second @ first.T)) @ first


class _Log:
    """What is measured, sample by sample, at a time [s] that is a share of the plan's."""

    def __init__(self, machine: Machine, plan: _Plan, driven: str) -> None:
        self._machine, self._plan, self._driven = machine, plan, driven
        self.now = self.share = 0.0
        self._rows: dict[str, list[Any]] = {}

    def sample(self) -> None:
        """At this time; once."""
        if self.now in self._rows.get("t", [])[-1:]:
            return
        machine, plan, share = self._machine, self._plan, self.share
        pose, contacts = machine.measure(), machine.contacts()
        planned, turned = plan.position(share), plan.orientation(share)
        values = {
            "t": self.now,
            **pose,
            self._driven: machine.leg_lengths(),
            "motor_force": machine.motor_forces(),
            "normal_force": contacts.normal,
            "friction_force": contacts.friction,
            "slip_rate": contacts.slip,
            "planned_position": planned,
            "planned_orientation": turned,
            f"planned_{self._driven}": plan.set_points(share),
            "position_error": float(np.linalg.norm(pose["position"] - planned)),
            "angle_error": float(so3.angle(pose["orientation"] @ turned.T)),
        }
        for name, value in values.items():
            self._rows.setdefault(name, []).append(value)

    def trajectory(self) -> dict[str, Array]:
        made = {name: np.array(values) for name, values in self._rows.items()}
        rates = np.abs(made["slip_rate"])
        steps = np.diff(made["t"])[:, None] * 0.5 * (rates[1:] + rates[:-1])
        made["slip"] = np.concatenate([np.zeros((1, rates.shape[1])), np.cumsum(steps, axis=0)])
        return made
