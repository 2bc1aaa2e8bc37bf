"""A planning problem: a system, where it starts, where it should end, and what the plan must respect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from nhpocp.arrays import Array
from nhpocp.constraints.bound import Bound
from nhpocp.controls.basis import ControlBasis
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.frozen import FixedDict, Frozen, fixed
from nhpocp.objectives.registry import available
from nhpocp.scales import Scales, natural_scales
from nhpocp.state_space import Block, StateSpace
from nhpocp.systems.margins import det
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System, check_names
from nhpocp.task import Task

ASSEMBLED = 1e-6  # share of the machine's length by which a start may miss what its joints hold
INSTANT = 1e-12  # share of a duration, in the place of 0
NUDGE = 1e-6  # of their scales, by which states and inputs are changed to see what an output's size is
SAME_TIME = 1e-6  # shares of the horizon that are nearer have no room for a motion between them


@dataclass(frozen=True)
class Horizon:
    """The duration T: fixed, or free between two values for the solvers that can choose it."""

    initial: float | None = 1.0
    minimum: float | None = None
    maximum: float | None = None

    def __post_init__(self) -> None:
        for name in ("initial", "minimum", "maximum"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InvalidProblemError(
                    f"{value:g} is not a duration; expected a number > 0", path="horizon"
                )
        lower, upper = self.minimum or 0.0, self.maximum or np.inf
        if self.free and not lower < upper:
            raise InvalidProblemError("min must be below max", path="horizon")
        if self.free and self.initial is not None and not lower <= self.initial <= upper:
            raise InvalidProblemError(
                f"initial {self.initial:g} is outside [{lower:g}, {upper:g}]", path="horizon"
            )

    @property
    def free(self) -> bool:
        return self.minimum is not None or self.maximum is not None

    @property
    def range(self) -> tuple[float, float]:
        """The shortest and the longest duration; without a minimum, an instant beside the first of those known."""
        known = next(value for value in (self.initial, self.maximum, self.minimum) if value is not None)
        return self.minimum or INSTANT * known, self.maximum or np.inf

    @property
    def first(self) -> float:
        """The duration to begin with: the one that is given, or the middle of a free one's range."""
        if self.initial is not None:
            return self.initial
        if self.minimum is not None and self.maximum is not None:
            return 0.5 * (self.minimum + self.maximum)
        return self.minimum or self.maximum or 1.0

    def kept(self, duration: float) -> float:
        """The nearest duration that is allowed: an optimizer meets bounds up to its tolerance."""
        return float(np.clip(duration, *self.range))

    @property
    def fixed(self) -> float:
        """The duration that a solver holds which cannot choose it."""
        if self.initial is None:
            raise InvalidProblemError(
                "the horizon is free and the Jacobian method holds it fixed; add `initial: 1` beside min and max",
                path="horizon",
            )
        return self.initial


@dataclass(frozen=True)
class Via:
    """A pose to pass at a share of the horizon."""

    share: float
    goal: Mapping[str, Array]


@dataclass(kw_only=True)
class PlanningProblem(Frozen):
    """Steer ``system`` from ``start`` to ``goal``.

    start: a value for every block of the state; goal: a value for every block that matters (the others are free), or
    for outputs of the pose. via: what to meet on the way, written like the goal.
    initial: coefficients Λ₀ (inputs × basis functions), or None to let the solver draw a seeded start.
    error_length: the length that counts as much as one radian in E; length_scale divides the rotation columns of the
    regularity matrices (None: the system's own length, else error_length). solvers: solver objects by name, used by
    `nhpocp.solve`.
    Errors: `InvalidProblemError` where the parts do not fit together.
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
    bounds: Sequence[Bound] = ()
    solvers: Mapping[str, Any] = field(default_factory=dict)
    samples: int = 201
    pictures: bool = True
    reference: Mapping[str, Any] = field(default_factory=dict)
    source: str | None = None  # the problem file's text, as read

    def __post_init__(self) -> None:
        self.start = checked_state(self.system.state_space, self.start)
        self.goal = checked_goal(self.system, self.goal, "goal")
        known = [objective.name for objective in available(self.system)]
        if self.objective not in known:
            raise InvalidProblemError(
                f"{self.objective!r} is none of {', '.join(known)}, the objectives of {self.system.model}",
                path="objective",
            )
        for name in ("error_length", "length_scale"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InvalidProblemError(f"{value:g} is not a length > 0", path=name)
        if self.samples < 2:
            raise InvalidProblemError("a trajectory needs at least 2 samples", path="output.samples")
        if self.initial is not None:
            self.initial = self._checked_initial()
        self.via = self._checked_via()
        self._check_assembly()
        self._check_bounds()

    def _check_assembly(self) -> None:
        """Whether the machine can be put together at the start, and its goals leave to its joints what they hold."""
        self._check_room()
        allowed = ASSEMBLED * max(1.0, self.system.default_length_scale())
        for name, (value, wanted) in self._invariants.items():
            if wanted is not None and not abs(float(value) - wanted) <= allowed:
                raise InvalidProblemError(
                    f"{name} is {float(value):.6g} here; the machine's joints hold it at {wanted:g}",
                    path="start",
                )

    @cached_property
    def _invariants(self) -> Mapping[str, tuple[Array, float | None]]:
        return self.system.invariants(self.start_point)

    def _check_room(self) -> None:
        """A goal that fixes what never changes makes the Jacobian of the end point singular, for every control."""
        held = len(self._invariants)
        blocks = [*self.system.state_space.blocks, *self.system.pose_outputs]
        for part, goal in (("goal", self.goal), *((f"via[{i}]", via.goal) for i, via in enumerate(self.via))):
            count, room = (
                sum(b.dimension for b in blocks if b.name in goal),
                self.system.state_space.dimension,
            )
            if held and count > room - held:
                names = ", ".join(block.name for block in blocks)
                raise InvalidProblemError(
                    f"fixes {count} numbers, but holonomic joints hold {held} of this machine's {room} as they are, "
                    f"which leaves {room - held} to choose; ask for fewer of {names}",
                    path=part,
                )

    def _checked_via(self) -> tuple[Via, ...]:
        """The via poses in the order of time."""
        found: list[Via] = []
        for place, via in enumerate(self.via):
            path = f"via[{place}]"
            if not 0 < via.share < 1:
                raise InvalidProblemError(
                    f"at {via.share:g}; expected a share of the horizon in (0, 1)", path=path
                )
            taken = {0.0: "the start is", 1.0: "the goal is"} | {
                other.share: "another via pose is" for other in found
            }
            beside = [words for share, words in taken.items() if abs(via.share - share) < SAME_TIME]
            if beside:
                raise InvalidProblemError(f"at {via.share:g}, where {beside[0]} already", path=path)
            found.append(Via(via.share, checked_goal(self.system, via.goal, path)))
        return tuple(sorted(found, key=lambda via: via.share))

    def _checked_initial(self) -> Array:
        path, inputs = "control.initial", self.system.input_space
        try:
            coefficients = Control(self.basis, self.initial).coefficients
        except (TypeError, ValueError) as error:
            raise InvalidProblemError(str(error), path=path) from error
        if len(coefficients) != inputs.size:
            raise InvalidProblemError(
                f"{len(coefficients)} rows; the system has {inputs.size} inputs "
                f"({', '.join(inputs.labels)}), one row each",
                path=path,
            )
        if not np.isfinite(coefficients).all():
            raise InvalidProblemError("NaN or infinity; expected finite numbers", path=path)
        return coefficients

    def _check_bounds(self) -> None:
        known = self._quantities()
        for bound in self.bounds:
            if bound.quantity not in known:
                raise InvalidProblemError(
                    f"no quantity {bound.quantity!r} to bound; there are {', '.join(known)}",
                    path=f"constraints.{bound.label}",
                )
        self.bounds = tuple(self._measured(bound) for bound in self.bounds)

    def _measured(self, bound: Bound) -> Bound:
        """With the scale of its quantity: by unit for states and inputs, else by what these change of it."""
        system, name, scales = self.system, bound.quantity, self.scales
        units = {block.name: block.unit for block in system.state_space.blocks}
        if name in units:
            return replace(bound, scale=scales.of(units[name]), coordinate=True)
        inputs = {block.name: block.unit for block in system.input_space.blocks}
        if name in inputs:
            return replace(bound, scale=scales.of(inputs[name]) / scales.time)
        return replace(bound, scale=1.0 if bound.margin else self._size_of_output(name))

    def _size_of_output(self, name: str) -> float:
        """How much an output changes, to first order about the start, when states and inputs do by their scales."""
        scales, space = self.scales, self.system.state_space
        still, changed = np.zeros(self.system.input_space.size), []
        here = np.asarray(self.system.output(name, self.start_point, still), dtype=float)
        for step in NUDGE * np.diag(scales.states):
            moved = np.asarray(space.retract(self.start_point, step))
            changed.append(self.system.output(name, moved, still) - here)
        for step in NUDGE * np.diag(scales.inputs):
            changed.append(self.system.output(name, self.start_point, step) - here)
        size = np.abs(np.array(changed, dtype=float)).sum(axis=0).max(initial=0.0) / NUDGE
        largest = float(np.abs(here).max(initial=0.0))
        return next((float(s) for s in (size, largest) if np.isfinite(s) and s > 0), 1.0)

    def _quantities(self) -> list[str]:
        """What may be bounded. Errors: `InvalidProblemError` where two entries of a trajectory have one name."""
        parts = numeric_system(self.system).quantities
        check_names(parts)
        signs = [det(name).name for name in numeric_system(self.system).matrices]
        return [block.name for _, block in parts if block.name not in signs]

    def towards(self, goal: Mapping[str, Any]) -> Self:
        """This problem with another goal; what a goal does not touch is not checked again."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, goal=checked_goal(self.system, goal, "goal"))
        for name in ("goal_point", "tasks", "scales"):
            other.__dict__.pop(name, None)
        other._check_room()
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
        wanted = [*((via.share, via.goal) for via in self.via), (1.0, self.goal)]
        length = self.scales.length
        return tuple(Task(self.system, goal, share, self.error_length, length) for share, goal in wanted)

    @cached_property
    def scales(self) -> Scales:
        """What counts as 1: what solvers divide by, so that a plan depends on no unit."""
        poses = [self.start, *(via.goal for via in self.via), self.goal]
        durations = (self.horizon.initial, self.horizon.maximum, self.horizon.minimum)
        boxes = [(bound.quantity, bound.lower, bound.upper) for bound in self.bounds]
        return natural_scales(self.system, poses, boxes, durations, self.error_length, self.length_scale)

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


def checked_state(space: StateSpace, values: Mapping[str, Any]) -> Mapping[str, Array]:
    """A value for every block of the start, as `checked_values`."""
    unknown = [name for name in values if name not in space.names]
    missing = [name for name in space.names if name not in values]
    if unknown or missing:
        raise InvalidProblemError(
            f"expected all of {', '.join(space.names)}"
            + (f"; unknown: {', '.join(unknown)}" if unknown else "")
            + (f"; missing: {', '.join(missing)}" if missing else ""),
            path="start",
        )
    return checked_values(space.blocks, values, "start")


def checked_goal(system: System, values: Mapping[str, Any], part: str) -> Mapping[str, Array]:
    """Values of a goal or via pose: some of the state's blocks and of the system's outputs of the pose."""
    blocks = [*system.state_space.blocks, *system.pose_outputs]
    unknown = [name for name in values if name not in [block.name for block in blocks]]
    if unknown or not values:
        raise InvalidProblemError(
            f"expected some of {', '.join(block.name for block in blocks)}"
            + (f"; unknown: {', '.join(unknown)}" if unknown else ""),
            path=part,
        )
    count, room = sum(b.dimension for b in blocks if b.name in values), system.state_space.dimension
    if count > room:
        raise InvalidProblemError(
            f"fixes {count} numbers of a state that has {room}; leave out one of {', '.join(values)}",
            path=part,
        )
    return checked_values(blocks, values, part)


def checked_values(blocks: Sequence[Block], values: Mapping[str, Any], part: str) -> Mapping[str, Array]:
    """Values per block, frozen, as arrays of the right shape; rotations must be rotations within 1e-6.

    Directions become unit vectors.
    """
    checked = {}
    for block in blocks:
        if block.name not in values:
            continue
        path = f"{part}.{block.name}"
        try:
            value = np.array(values[block.name], dtype=float)
        except (TypeError, ValueError) as error:
            raise InvalidProblemError(
                f"expected numbers of shape {block.shape}; {error}", path=path
            ) from error
        if value.shape != block.shape:
            raise InvalidProblemError(f"shape {value.shape}; expected {block.shape}", path=path)
        if not np.all(np.isfinite(value)):
            raise InvalidProblemError("NaN or infinity; expected finite numbers", path=path)
        if block.kind == "rotation":
            defect = max(np.abs(value @ value.T - np.eye(3)).max(), abs(np.linalg.det(value) - 1))
            if defect > 1e-6:
                raise InvalidProblemError(
                    f"no rotation matrix: RᵀR or det R is off by {defect:.2g}", path=path
                )
        if block.kind == "direction":
            value = _unit(value, path)
        value.flags.writeable = False
        checked[block.name] = value
    return FixedDict(checked)


def _unit(value: Array, path: str) -> Array:
    length = float(np.linalg.norm(value))
    if length < 1e-9:
        raise InvalidProblemError("the zero vector; expected a direction", path=path)
    return value if abs(length - 1) < 1e-15 else value / length  # else it would change each time it is read
