"""A plan as a machine runs it: everything that moves, sampled at the machine's rate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nhpocp.arrays import Array
from nhpocp.csv_writer import identifiers
from nhpocp.declared import real
from nhpocp.errors import InvalidProblemError, suggestion
from nhpocp.machine.export.limits import find_peaks
from nhpocp.machine.export.planned_path import PlannedPath, Sampled
from nhpocp.machine.export.time_scaling import PROFILES, TimeScaling
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Solution
from nhpocp.state_space import Block
from nhpocp.units import Units

RATE = 100.0  # samples per unit of time
MOST = 500_000  # samples
ROOM = 1e-9  # of a duration: as much longer than the least one as rounding is worth


@dataclass(frozen=True)
class Entry:
    """One quantity. values: (samples, …); unit: in words, "" for none; meaning: words."""

    name: str
    values: Array
    unit: str
    meaning: str


@dataclass(frozen=True)
class Joint:
    """What a controller moves: a leg, or a number of the state. position, velocity, acceleration: (samples,)."""

    name: str
    unit: str
    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class Motion:
    """A plan in the machine's time.

    name: the problem's. times: (samples,) from 0 to the duration [time], a step of 1/rate between, the last one shorter
    where that does not go into the duration. entries: every quantity, the first one "t". joints: none where a state
    without legs has rotations. system: model and parameters. converged: whether the plan is solved and verified.
    """

    name: str
    times: Array
    scaling: TimeScaling
    rate: float
    entries: tuple[Entry, ...]
    joints: tuple[Joint, ...]
    units: Units
    system: dict[str, Any]
    converged: bool

    def columns(self) -> list[Entry]:
        """An entry for every number, components counted from 1: `position_1`, `orientation_1_2`."""
        return _renamed(
            Entry(
                "_".join([entry.name, *(str(i + 1) for i in place)]),
                entry.values[(slice(None), *place)],
                entry.unit,
                entry.meaning,
            )
            for entry in self.entries
            for place in np.ndindex(*entry.values.shape[1:])
        )


def _renamed(entries: Iterable[Entry]) -> list[Entry]:
    """With names that are identifiers, each once."""
    every = list(entries)
    names = identifiers(entry.name for entry in every)
    return [replace(entry, name=name) for name, entry in zip(names, every, strict=True)]


def make_motion(
    solution: Solution,
    *,
    rate: float = RATE,
    duration: float | None = None,
    profile: str | None = None,
    max_speed: float | None = None,
    max_acceleration: float | None = None,
) -> Motion:
    """The motion of a solution's control, integrated again, for a machine.

    rate: samples per unit of time. duration: D [time]; none: the least that keeps the limits, without limits the
    plan's own. profile: "quintic", at rest at both ends, or "linear", the plan's own timing; none: quintic, but linear
    for a system with drift. max_speed, max_acceleration: of every leg with a motor [length/time, …/time²]; of systems
    without legs of every input.
    Errors: `InvalidProblemError` for a system with drift in another timing than its own or with limits, for limits that
    the duration breaks (naming the least one) or that none keeps, and for a path that does not come to its end.
    """
    rate = _positive(rate, "--rate")
    limits = [
        None if value is None else _positive(value, name)
        for value, name in ((max_speed, "--max-speed"), (max_acceleration, "--max-acceleration"))
    ]
    path = PlannedPath(solution)
    scaling = _scaling(path, duration, profile, *limits)
    times = _times(scaling.duration, rate)
    plan, speed, change = scaling(times)
    at = path.sample(plan)
    problem = solution.problem
    entries = [
        Entry("t", times, _unit(problem.units, "time"), "time of the machine"),
        Entry("plan_t", plan, _unit(problem.units, "time"), "time of the plan at the same pose"),
        *_states(problem, at, speed, change),
        *_inputs(problem, at, speed, change),
        *_legs(path, at, speed, change),
    ]
    for entry in entries:
        lost = ~np.isfinite(entry.values.reshape(len(times), -1)).all(axis=1)
        if lost.any():
            words = f"{entry.meaning} is not finite at t={times[np.argmax(lost)]:g}"
            raise InvalidProblemError(f"{words}; there is nothing for a machine here")
    return Motion(
        name=problem.name,
        times=times,
        scaling=scaling,
        rate=rate,
        entries=tuple(_renamed(entries)),
        joints=tuple(_joints(path, at, speed, change)),
        units=problem.units,
        system={"model": problem.system.model, **problem.system.parameters()},
        converged=solution.converged,
    )


def _positive(value: Any, name: str) -> float:
    number = real(value, name, "a number > 0")
    if number <= 0:
        raise InvalidProblemError(f"{number:g}; expected a number > 0", path=name)
    return number


def _scaling(
    path: PlannedPath,
    duration: float | None,
    name: str | None,
    max_speed: float | None,
    max_acceleration: float | None,
) -> TimeScaling:
    """Errors: `InvalidProblemError` for a timing that this system, or this machine, cannot follow."""
    name = name or ("quintic" if path.system.driftless else "linear")
    if name not in PROFILES:
        raise InvalidProblemError(f"{name!r}; {suggestion(name, PROFILES)}", path="--profile")
    profile = PROFILES[name]
    wanted = None if duration is None else _positive(duration, "--duration")
    limited = max_speed is not None or max_acceleration is not None
    if not path.system.driftless:
        _require_own_time(path, name, wanted, limited)
        return TimeScaling(profile, path.horizon, path.horizon)
    if not limited:
        return TimeScaling(profile, path.horizon, wanted or path.horizon)
    peaks = find_peaks(path, profile)
    least = peaks.least_duration(max_speed, max_acceleration)
    if not np.isfinite(least):
        raise InvalidProblemError(_jumping(peaks.jump, path.horizon, name), path="--max-acceleration")
    if wanted is not None and wanted < least * (1.0 - ROOM):
        words = (
            f"{wanted:g} is too short for these limits; the least duration that keeps them is {_up(least)}"
        )
        raise InvalidProblemError(words, path="--duration")
    # of a plan that stands still the least is 0
    return TimeScaling(profile, path.horizon, wanted or least * (1.0 + ROOM) or path.horizon)


def _require_own_time(path: PlannedPath, profile: str, duration: float | None, limited: bool) -> None:
    """Errors: `InvalidProblemError` for what a system with drift cannot do."""
    itself = f"{path.system.model} moves by itself (it has a drift), so its plan holds in its own time alone"
    if profile != "linear":
        raise InvalidProblemError(f"{itself}; expected --profile linear", path="--profile")
    if duration is not None and not np.isclose(duration, path.horizon, rtol=ROOM, atol=0):
        words = f"{itself}, {path.horizon:.9g}; plan with `horizon: {duration:g}`"
        raise InvalidProblemError(words, path="--duration")
    if limited:
        words = f"{itself}; state limits as `constraints:` of the problem and plan again"
        raise InvalidProblemError(words, path="--max-speed, --max-acceleration")


def _up(value: float) -> str:
    """A number in six figures that is no less."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 5)
    return f"{np.ceil(value / unit) * unit:.6g}"


def _jumping(time: float | None, horizon: float, profile: str) -> str:
    if time in (0.0, horizon):
        where = "starts" if time == 0.0 else "ends"
        return f"this plan {where} in motion, so with --profile {profile} no duration keeps it; try --profile quintic"
    return (
        f"the speeds of this plan jump, first at its t = {time:.6g}, so no duration keeps it; plan with a control that "
        "is continuous (`control: {basis: fourier}` for the Jacobian method, `nlp: {control: basis}` for the NLP)"
    )


def _times(duration: float, rate: float) -> Array:
    """k/rate, and the duration. Errors: `InvalidProblemError` for more than `MOST`."""
    count = duration * rate
    if count > MOST:
        raise InvalidProblemError(
            f"{count:.3g} samples (duration {duration:g} × rate {rate:g}); expected at most {MOST}",
            path="--rate",
        )
    times = np.arange(int(np.ceil(count * (1 - 1e-12)))) / rate
    return np.append(times if len(times) else 0.0, duration)


def _unit(units: Units, unit: str, order: int = 0) -> str:
    """A unit and its rates: m, m/s, m/s^2; "" for a number that has none."""
    time = units.time or "time"
    words = {"length": units.length or "length", "angle": "rad", "time": time}.get(unit, "")
    return words if not (order and words) else f"{words}/{time}" + ("" if order == 1 else f"^{order}")


def _states(problem: PlanningProblem, at: Sampled, speed: Array, change: Array) -> Iterator[Entry]:
    space, units = problem.system.state_space, problem.units
    values = space.split(at.states)
    velocities = at.velocities * speed[:, None]
    accelerations = at.accelerations * speed[:, None] ** 2 + at.velocities * change[:, None]
    for block in space.blocks:
        words = block.words or block.name.replace("_", " ")
        turned, cut = block.kind == "rotation", space.tangent_slice(block.name)
        shape = (len(at.states), *(() if block.kind == "scalar" else (block.dimension,)))
        yield Entry(block.name, values[block.name], "" if turned else _unit(units, block.unit), words)
        if turned:
            yield Entry(
                f"{block.name}_quaternion",
                quaternions(values[block.name]),
                "",
                f"{words} as w, x, y, z, without jumps of sign",
            )
        frame = ", base coordinates" if turned else ""
        kinds = ("angular velocity", "angular acceleration") if turned else ("velocity", "acceleration")
        for suffix, rates, kind, order in (
            ("velocity", velocities, kinds[0], 1),
            ("acceleration", accelerations, kinds[1], 2),
        ):
            unit = _unit(units, block.unit, order)
            name = f"{block.name}_{suffix}"
            yield Entry(name, rates[:, cut].reshape(shape), unit, f"{kind} of {words}{frame}")


def quaternions(rotations: Array) -> Array:
    """(k, 4) w, x, y, z of rotations (k, 3, 3); neighbours have the same sign."""
    numbers = np.roll(Rotation.from_matrix(rotations).as_quat(), 1, axis=1)
    turns = np.where(np.sum(numbers[1:] * numbers[:-1], axis=1) < 0, -1.0, 1.0)
    first = 1.0 if numbers[0, 0] >= 0 else -1.0
    return numbers * np.cumprod(np.append(first, turns))[:, None]


def _inputs(problem: PlanningProblem, at: Sampled, speed: Array, change: Array) -> Iterator[Entry]:
    space = problem.system.input_space
    values = space.split(at.controls * speed[:, None])
    rates = space.split(at.control_rates * speed[:, None] ** 2 + at.controls * change[:, None])
    for block in space.blocks:
        words = f"input: {block.words or block.name.replace('_', ' ')}"
        yield Entry(block.name, values[block.name], _unit(problem.units, block.unit, 1), words)
        unit = _unit(problem.units, block.unit, 2)
        yield Entry(f"{block.name}_rate", rates[block.name], unit, f"rate of {words}")


def _legs(path: PlannedPath, at: Sampled, speed: Array, change: Array) -> Iterator[Entry]:
    if not path.motors:
        return
    for name, values, words, order in zip(
        ("leg_lengths", "leg_speeds", "leg_accelerations"),
        _scaled(at.lengths, at.leg_speeds, at.leg_accelerations, speed, change),
        ("leg length", "leg speed", "leg acceleration"),
        (0, 1, 2),
        strict=True,
    ):
        yield Entry(name, values, _unit(path.problem.units, "length", order), words)


def _scaled(
    values: Array, rates: Array, second: Array, speed: Array, change: Array
) -> tuple[Array, Array, Array]:
    """q, q' and q'' (k, n) of q, q̇ and q̈."""
    speed, change = speed[:, None], change[:, None]
    return values, rates * speed, second * speed**2 + rates * change


def _joints(path: PlannedPath, at: Sampled, speed: Array, change: Array) -> Iterator[Joint]:
    """The legs with a motor; without legs every number of a state without rotations."""
    space = path.system.state_space
    if path.motors:
        named: list[tuple[str, str]] = [(f"leg_{i + 1}", "length") for i in path.motors]
        numbers = at.lengths, at.leg_speeds, at.leg_accelerations
        values, rates, second = (each[:, path.motors] for each in numbers)
    elif any(block.kind == "rotation" for block in space.blocks):
        return
    else:
        named = [(name, block.unit) for block in space.blocks for name in _numbers(block)]
        values, rates, second = at.states, at.velocities, at.accelerations
    every = _scaled(values, rates, second, speed, change)
    names = identifiers(name for name, _ in named)
    for i, (name, (_, unit)) in enumerate(zip(names, named, strict=True)):
        yield Joint(name, _unit(path.problem.units, unit), *(each[:, i] for each in every))


def _numbers(block: Block) -> list[str]:
    return [block.name] if block.kind == "scalar" else [f"{block.name}_{i + 1}" for i in range(block.size)]
