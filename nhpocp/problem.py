"""A planning problem: a system, where it starts, where it should end, and what the plan must respect."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from nhpocp.arrays import Array
from nhpocp.bodies.obstacles import Obstacle, among_bodies
from nhpocp.bodies.surroundings import alone
from nhpocp.constraints.bound import Bound
from nhpocp.constraints.registry import bounds_of
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.declared import real, whole_number
from nhpocp.errors import InvalidProblemError, describe, expect, refuse
from nhpocp.frozen import ByValue, FixedDict, Frozen, as_value, fixed
from nhpocp.horizon import Horizon
from nhpocp.objectives.registry import available
from nhpocp.plain_text import brief
from nhpocp.poses import checked_goal, checked_start, goal_blocks
from nhpocp.scales import Scales, natural_scales
from nhpocp.shown import Shown
from nhpocp.state_space import Block
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS, SPEEDS
from nhpocp.systems.margins import margin
from nhpocp.systems.quantities import quantities
from nhpocp.systems.system import DISTANCE, System
from nhpocp.units import Units
from nhpocp.via import Via

if TYPE_CHECKING:
    from nhpocp.task import Task

ASSEMBLED = 1e-6  # fraction of the machine's length by which a start may miss what its joints hold
NUDGE = 1e-6  # of their scales, by which states and inputs are changed to see what an output's size is
SAME_TIME = 1e-6  # fractions of the horizon that are nearer have no room for a motion between them


@dataclass(kw_only=True, eq=False)
class PlanningProblem(ByValue, Frozen, Shown):
    """A task: steer a system from a start to a goal. Frozen; equal to its copies; `replace(problem, …)` makes another.

    system: such as `ThreeUPU()`. start: a value for every block of the state, as {"position": [0, 0, 25],
    "orientation": {"rpy": [0, 0, -30 * deg]}}: vectors (n,) in their unit ([length], [rad]), rotations as rpy,
    quaternion, rotvec, matrix or an array (3, 3). goal: the same for every block that matters (the others are free), or
    for outputs of the pose, such as leg_lengths. via: `Via(0.5, pose)`, or {"at": 0.5, "position": …}: what to meet on
    the way. name: in folders and reports. horizon: the duration T [time]: a number, a `Horizon`, or {"min": …, "max":
    …}. basis: of the control, such as `Fourier(2)`. initial: coefficients Λ₀, inputs × basis functions, or None to let
    the solver draw a seeded start. objective: the name of a cost, "effort" say. obstacles: as in a file,
    [{"sphere": {"centre": [8, 0, 30], "radius": 2}}]. bounds: as in a file, {"leg_length":
    [20, 60], "joint_angle": {"theta4": {"max": 20 * deg}}}, or a list of `Bound`s. error_length: the length [length]
    that counts as much as one radian in E. length_scale: divides the rotation columns of the regularity matrices (None:
    the system's own length, else error_length). solvers: solver objects by name, used by `nhpocp.solve`. samples: of
    trajectories. pictures: whether folders have any. reference: known results, for tests.
    units: words for labels and tables, {"length": "m", "time": "s"}.
    Errors: `InvalidProblemError` where the parts do not fit together; the first, and all `others`.
    """

    noun: ClassVar[str] = "problem"

    system: System
    start: Mapping[str, Any]
    goal: Mapping[str, Any]
    name: str = "problem"
    horizon: Horizon = field(default_factory=Horizon)
    basis: ControlBasis = field(default_factory=Fourier)
    initial: Any = None
    objective: str = "effort"
    error_length: float = 1.0
    length_scale: float | None = None
    via: Sequence[Via] = ()
    obstacles: Sequence[Obstacle] = ()
    bounds: Sequence[Bound] = ()
    solvers: Mapping[str, Any] = field(default_factory=dict)
    samples: int = 201
    pictures: bool = True
    reference: Mapping[str, Any] = field(default_factory=dict)
    units: Units = field(default_factory=Units)
    source: str | None = field(default=None, init=False, compare=False)  # see `read_from`

    def __repr__(self) -> str:
        horizon = self.horizon
        time = f"{horizon.range[0]:g} … {horizon.range[1]:g}" if horizon.free else f"{horizon.fixed:g}"
        more = [
            f"{len(part)} {word}"
            for part, word in (
                (self.via, "via poses"),
                (self.obstacles, "obstacles"),
                (self.bounds, "bounds"),
            )
            if part
        ]
        words = ", ".join([brief(self.basis), f"T = {time}", f"objective {self.objective}", *more])
        return f"<PlanningProblem {brief(self.name)}: {self.system.model}, {words}>"

    def __hash__(self) -> int:
        """Of what most problems differ in; solvers may have none."""
        return hash((self.name, as_value(self.system), as_value(self.start), as_value(self.goal)))

    def __post_init__(self) -> None:
        wrong: list[InvalidProblemError] = []
        self._take_as_written()
        self.start = checked_start(self.system.state_space, self.start, wrong)
        self.goal = checked_goal(self.system, self.goal, "goal", wrong)
        self.via = self._checked_via(wrong)
        if self.initial is not None:
            self.initial = self._checked_initial(wrong)
        if self.objective not in (known := [objective.name for objective in available(self.system)]):
            words = f"{self.objective!r} is none of {', '.join(known)}, the objectives of {self.system.model}"
            wrong.append(InvalidProblemError(words, path="objective"))
        for name in ("error_length", "length_scale"):
            value = getattr(self, name)
            try:
                if value is not None and not real(value, name, "a length > 0") > 0:
                    raise InvalidProblemError(f"{value:g} is not a length > 0", path=name)
            except InvalidProblemError as error:
                wrong.append(error)
        if self.samples < 2:
            wrong.append(InvalidProblemError("a trajectory needs at least 2 samples", path="output.samples"))
        refuse(wrong)
        self._take_rest()
        self._check_room(wrong)
        self._check_assembly(wrong)
        self._check_bounds(wrong)
        refuse(wrong)
        self.bounds = tuple(self._measured(bound) for bound in self.bounds)

    def _take_as_written(self) -> None:
        """Parts as Python or a file may write them, made into what they are from here on.

        Errors: `InvalidProblemError` for a part of another kind.
        """
        expect(self.system, System, "a system such as ThreeUPU()", "system")
        expect(self.basis, ControlBasis, "a basis such as Fourier(2)", "control.basis")
        expect(self.name, str, "a text", "name")
        expect(self.objective, str, "the name of an objective", "objective")
        expect(self.solvers, Mapping, "solvers by name, such as {'jacobian': Continuation()}", "solvers")
        expect(self.reference, Mapping, "a mapping", "reference")
        self.written = {"start": self.start, "goal": self.goal, "via": self.via}
        self.horizon = Horizon.of(self.horizon)
        self.units = Units.of(self.units)
        self.samples = whole_number(self.samples, "output.samples")
        if isinstance(self.initial, str) and self.initial == "auto":
            self.initial = None
        self._take_obstacles()
        if isinstance(self.bounds, Mapping):
            self.bounds = bounds_of(self.bounds, self.system)
        wanted = "a list of `Bound`s, or a mapping such as {'leg_length': [20, 60]}"
        expect(self.bounds, (list, tuple), wanted, "constraints")
        expect(self.via, (list, tuple), "a list of via poses", "via")
        for bound in self.bounds:
            expect(bound, Bound, "Bound(label, quantity, lower, upper)", "constraints")
        self.system = self.system.accelerating(LEG_ACCELERATIONS in {b.quantity for b in self.bounds})
        self.via = [Via.of(via, f"via[{i}]") for i, via in enumerate(self.via)]

    def _take_obstacles(self) -> None:
        """The system among its obstacles, where there are any or distances are bounded."""
        self.obstacles = Obstacle.several(self.obstacles)
        if self.obstacles and not self.system.has_bodies:
            words = f"the system {self.system.model} has no bodies to keep away from them; remove them"
            raise InvalidProblemError(words, path="obstacles", at_key=True)
        bounds = self.bounds if isinstance(self.bounds, list | tuple | Mapping) else ()
        named = [getattr(bound, "quantity", bound) for bound in bounds]
        asked = bool(self.obstacles) or (DISTANCE in named and self.system.has_bodies)
        if asked or self.system.surroundings is not None:
            self.system = self.system.among(self.obstacles if asked else None)
        if self.obstacles:
            among_bodies(self.obstacles, self.system.model, self.system.bodies_somewhere())

    def _take_rest(self) -> None:
        """The system with its start for its pose at rest, where a bound counts from there."""
        counting = {block.name for block in self.system.rest_blocks}
        asked = any(bound.quantity in counting for bound in self.bounds)
        if asked or self.system.rest is not None:
            self.system = self.system.resting(self.start_point if asked else None)

    def _check_assembly(self, wrong: list[InvalidProblemError]) -> None:
        """Whether the machine can be put together at the start."""
        allowed = ASSEMBLED * max(1.0, self.system.default_length_scale())
        for name, (value, wanted) in self._invariants.items():
            if wanted is not None and not abs(float(value) - wanted) <= allowed:
                words = f"{name} is {float(value):.6g} here; the machine's joints hold it at {wanted:g}"
                wrong.append(InvalidProblemError(words, path="start"))

    @cached_property
    def _invariants(self) -> Mapping[str, tuple[Array, float | None]]:
        return self.system.invariants(self.start_point)

    def _check_room(self, wrong: list[InvalidProblemError]) -> None:
        """A goal that fixes what never changes makes the Jacobian of the end point singular, for every control."""
        held, room = len(self._invariants), self.system.state_space.dimension
        blocks = goal_blocks(self.system)
        for part, goal in (("goal", self.goal), *((f"via[{i}]", via.goal) for i, via in enumerate(self.via))):
            count = sum(b.dimension for b in blocks if b.name in goal)
            if held and count > room - held:
                names = ", ".join(block.name for block in blocks)
                words = (
                    f"fixes {count} numbers, but holonomic joints hold {held} of this machine's {room} as they are, "
                    f"which leaves {room - held} to choose; ask for fewer of {names}"
                )
                wrong.append(InvalidProblemError(words, path=part))

    def _checked_via(self, wrong: list[InvalidProblemError]) -> tuple[Via, ...]:
        """The via poses in the order of time."""
        checked: list[Via] = []
        taken = [0.0, 1.0]  # in order
        for i, via in enumerate(self.via):
            at, path = via.share, f"via[{i}]"
            place = bisect(taken, at)
            beside = [time for time in taken[max(place - 1, 0) : place + 1] if abs(at - time) < SAME_TIME]
            if not 0 < at < 1:
                words = f"{at:g} is not inside the horizon; expected a share between 0 and 1"
                wrong.append(InvalidProblemError(words, path=f"{path}.at"))
            elif beside:
                other = {0.0: "the start", 1.0: "the goal"}.get(beside[0], "another via pose")
                wrong.append(InvalidProblemError(f"{other} is at {at:g} already", path=f"{path}.at"))
            taken.insert(place, at)
            checked.append(Via(at, checked_goal(self.system, via.goal, path, wrong)))
        return tuple(sorted(checked, key=lambda via: via.share))

    def _checked_initial(self, wrong: list[InvalidProblemError]) -> Array:
        path, inputs, functions = "control.initial", self.system.input_space, self.basis.size
        try:
            sizes = [len(row) for row in self.initial]
            rows = [np.array(row, dtype=float) for row in self.initial]
        except (TypeError, ValueError):
            words = f"expected one row of numbers per input, got {describe(self.initial)}"
            wrong.append(InvalidProblemError(words, path=path))
            return self.initial
        before = len(wrong)
        if len(rows) != inputs.size:
            names = ", ".join(inputs.labels[:6])
            words = f"{len(rows)} rows; expected {inputs.size}, one per input ({names})"
            wrong.append(InvalidProblemError(words, path=path))
        shown = ", ".join(self.basis.labels[:5]) + (", …" if functions > 5 else "")
        for i, size in enumerate(sizes):
            if size != functions:
                words = f"{size} numbers; expected {functions} ({shown})"
                wrong.append(InvalidProblemError(words, path=f"{path}[{i}]"))
            elif not np.isfinite(rows[i]).all():
                wrong.append(
                    InvalidProblemError("NaN or infinity; expected finite numbers", path=f"{path}[{i}]")
                )
        return self.initial if len(wrong) > before else Control(self.basis, self.initial).coefficients

    @cached_property
    def quantities(self) -> list[tuple[str, Block]]:
        """What a trajectory consists of, as `systems.quantities`."""
        return quantities(self.system)

    def _check_bounds(self, wrong: list[InvalidProblemError]) -> None:
        blocks = {block.name: block for _, block in self.quantities}
        known = [block.name for block in blocks.values() if _may_be_bounded(block)]
        for bound in self.bounds:
            path, block = f"constraints.{bound.label}", blocks.get(bound.quantity)
            if block is not None and block.kind == "rotation":
                words = f"a rotation cannot be bounded; bound one of {', '.join(known)}"
                wrong.append(InvalidProblemError(words, path=path, at_key=True))
            elif block is None or not _may_be_bounded(block):
                words = f"unknown quantity {bound.quantity!r}"
                wrong.append(InvalidProblemError(words, path=path, word=bound.quantity, known=known))
            elif block.name == DISTANCE and not block.entries:
                wrong.append(InvalidProblemError(alone(self.system.model), path=path, at_key=True))
            elif words := bound.misfit(block.shape):
                wrong.append(InvalidProblemError(words, path=path))
            elif block.name == DISTANCE and np.isfinite(np.asarray(bound.upper, dtype=float)).any():
                words = "an upper side; distances are bounded from below alone"
                wrong.append(InvalidProblemError(words, path=path))

    def _measured(self, bound: Bound) -> Bound:
        """With the scale of its quantity: by unit for states and inputs, else by what these change of it."""
        system, name, scales = self.system, bound.quantity, self.scales
        units = {block.name: block.unit for block in system.state_space.blocks}
        if name in units:
            return replace(bound, scale=scales.of(units[name]), coordinate=True)
        if name == DISTANCE:
            entries = {block.name: block.entries for _, block in self.quantities}[name]
            return replace(bound, scale=scales.length, entries=entries)
        inputs = {block.name: block.unit for block in system.input_space.blocks}
        if name in inputs:
            return replace(bound, scale=scales.of(inputs[name]) / scales.time)
        if name == LEG_ACCELERATIONS:
            of_speeds = self._measured(replace(bound, quantity=SPEEDS)).scale
            return replace(bound, scale=of_speeds / scales.time)
        return replace(bound, scale=1.0 if bound.margin else self._size_of_output(name))

    def _size_of_output(self, name: str) -> float:
        """How much an output changes, to first order about the start, when states and inputs do by their scales."""
        scales, space = self.scales, self.system.state_space
        still, changed = np.zeros(self.system.input_space.size), []
        try:
            with np.errstate(all="ignore"):  # as of a leg along its own axis w4
                here = np.asarray(self.system.quantity(name, self.start_point, still), dtype=float)
                for step in NUDGE * np.diag(scales.states):
                    moved = np.asarray(space.retract(self.start_point, step))
                    changed.append(self.system.quantity(name, moved, still) - here)
                for step in NUDGE * np.diag(scales.inputs):
                    changed.append(self.system.quantity(name, self.start_point, step) - here)
        except np.linalg.LinAlgError:  # it has no size where the machine is singular
            return 1.0
        size = np.abs(np.array(changed, dtype=float)).sum(axis=0).max(initial=0.0) / NUDGE
        largest = float(np.abs(here).max(initial=0.0))
        return next((float(s) for s in (size, largest) if np.isfinite(s) and s > 0), 1.0)

    def read_from(self, text: str) -> Self:
        """This problem with the text that says all of it; what is made of it by a change has none."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, source=text)
        return other

    def towards(self, goal: Mapping[str, Any]) -> Self:
        """This problem with another goal; what a goal does not touch is not checked again."""
        wrong: list[InvalidProblemError] = []
        other = object.__new__(type(self))
        goal = checked_goal(self.system, goal, "goal", wrong)
        written = FixedDict({**self.written, "goal": goal})
        other.__dict__.update(self.__dict__, goal=goal, source=None, written=written)
        refuse(wrong)
        for name in ("goal_point", "tasks", "scales"):
            other.__dict__.pop(name, None)
        other._check_room(wrong)
        refuse(wrong)
        return other

    @cached_property
    def start_point(self) -> Array:
        """The start as a packed point (size,)."""
        point: Array = fixed(np.asarray(self.system.state_space.pack(self.start), dtype=float))
        return point

    @cached_property
    def goal_point(self) -> Array:
        """The goal as a packed point; free blocks keep the start's value (and have weight 0)."""
        values = {name: self.goal.get(name, value) for name, value in self.start.items()}
        point: Array = fixed(np.asarray(self.system.state_space.pack(values), dtype=float))
        return point

    @cached_property
    def tasks(self) -> tuple[Task, ...]:
        """What the path must meet, in the order of time; the goal is the last."""
        from nhpocp.task import Task  # and CasADi, which `check` does without

        wanted = [*((via.share, via.goal) for via in self.via), (1.0, self.goal)]
        length = self.scales.length
        return tuple(
            Task(self.system, goal, fraction, self.error_length, length) for fraction, goal in wanted
        )

    @cached_property
    def scales(self) -> Scales:
        """What counts as 1: what solvers divide by, so that a plan depends on no unit."""
        poses = [self.start, *(via.goal for via in self.via), self.goal]
        durations = (self.horizon.initial, self.horizon.maximum, self.horizon.minimum)
        boxes = [(bound.quantity, bound.lower, bound.upper) for bound in self.bounds]
        return natural_scales(self.system, poses, boxes, durations, self.error_length, self.length_scale)

    @property
    def bounds_on_rates(self) -> list[Bound]:
        """Those that the same path keeps where it is run more slowly: on inputs, and on outputs that are rates.

        With a drift a motion cannot be run at another pace.
        """
        system = self.system
        outputs = [block for kind, block in self.quantities if block.rate]
        rates = {*system.input_space.names, *(block.name for block in outputs)}
        return [bound for bound in self.bounds if system.driftless and bound.quantity in rates]

    @property
    def goal_is_a_pose(self) -> bool:
        """Whether the goal fixes the whole state; else many states may meet it."""
        return set(self.goal) == set(self.system.state_space.names)

    def goal_error(self, point: Array) -> float:
        """E at a packed point, [Paper] section 4; NaN where it has none."""
        return self.tasks[-1].error(point)

    @property
    def scale(self) -> float:
        """The length that divides the rotation columns of the regularity matrices, and by which angles count."""
        return self.scales.radius

    def control(self, coefficients: Array, horizon: float | None = None) -> Control:
        """A control over the problem's own basis."""
        return Control(self.basis, coefficients, horizon or self.horizon.fixed)


def _may_be_bounded(block: Block) -> bool:
    """Not a rotation, nor a determinant, whose zero is what counts and whose size nothing."""
    named = margin(block.name)
    return block.kind != "rotation" and (named is None or named.kind == "sigma")
