"""What a path must meet at one time: the goal at its end, a via pose on the way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from nhpocp import so3
from nhpocp.arrays import Array, namespace
from nhpocp.calls import call, side_by_side
from nhpocp.errors import OrientationAtPiError
from nhpocp.kept import kept
from nhpocp.singular_values import svd
from nhpocp.state_space import Block, StateSpace, Unit
from nhpocp.systems.system import System

HALF_TURN_WITHIN = 1e-7  # [rad]; closer to π the axis of the error is noise


@dataclass(frozen=True)
class Task:
    r"""Values for some blocks of the state, or for outputs of the pose, at a fraction of the horizon; the rest is free.

    e stacks, block by block and then output by output: x - x_d of a vector, log(R R_dᵀ) of a rotation, [Paper] eq. (8),
    y - y_d of an output, and for a direction the rotation vector from y_d to y, which has two numbers in the plane
    perpendicular to y_d. A goal in some of the coordinates only, or in a function of them, is a task function.
    error_length: the length that counts as much as one radian in E; scale: the problem's own length, by which lengths
    are divided in the linear algebra, so that a rank depends on no unit.
    """

    system: System
    values: Mapping[str, Any]
    share: float
    error_length: float
    scale: float

    @property
    def space(self) -> StateSpace:
        return self.system.state_space

    @cached_property
    def rows(self) -> Array:
        """Indices of the tangent numbers that the task fixes itself; outputs fix none."""
        numbers = np.arange(self.space.dimension)
        parts = [numbers[self.space.tangent_slice(n)] for n in self.space.names if n in self.values]
        return np.concatenate(parts) if parts else np.empty(0, dtype=int)

    @cached_property
    def outputs(self) -> list[Block]:
        """The outputs that the task fixes."""
        return [output for output in self.system.pose_outputs if output.name in self.values]

    @property
    def size(self) -> int:
        """Numbers in e."""
        return len(self.units)

    @cached_property
    def units(self) -> list[Unit]:
        """The unit of each number of e: length, angle, or none."""
        units = self.space.tangent_units
        return [units[i] for i in self.rows] + [o.unit for o in self.outputs for _ in range(o.dimension)]

    @cached_property
    def output_labels(self) -> list[str]:
        """One name per number of e that belongs to an output."""
        return [
            output.name if output.kind == "scalar" else f"{output.name}[{i}]"
            for output in self.outputs
            for i in range(output.dimension)
        ]

    @cached_property
    def weights(self) -> Array:
        """Weight of each number of e in E."""
        return np.where(np.array(self.units) == "length", 1.0 / self.error_length, 1.0)

    @cached_property
    def _fixed(self) -> StateSpace:
        return _part_of(self.space, tuple(name for name in self.space.names if name in self.values))

    @cached_property
    def _wanted(self) -> Array:
        """The blocks' values as a point of the space that they make."""
        return np.asarray(self._fixed.pack({name: self.values[name] for name in self._fixed.names}))

    def difference(self, point: Array) -> Array:
        """e, unweighted.

        Errors: `OrientationAtPiError` where a fixed rotation is a half turn away, or a direction opposite.
        """
        parts = []
        if self._fixed.blocks:
            error, angles = call(self.difference_function, point, self._wanted)
            _refuse_half_turn(angles)
            parts.append(error.ravel())
        for output in self.outputs:
            parts.append(self._output_error(output, _observed(self.system, output.name, point)[0]))
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    @cached_property
    def difference_function(self) -> ca.Function:
        """(point, the blocks' values as a point) ↦ (e of the blocks, unweighted; the angles of rotations)."""
        return _difference(self.space, self._fixed)

    def _output_error(self, output: Block, value: Array) -> Array:
        wanted = np.ravel(self.values[output.name])
        if output.kind == "direction":
            _refuse_half_turn(np.arctan2(np.linalg.norm(np.cross(wanted, value)), wanted @ value)[None])
            return np.asarray(_plane(wanted).T @ so3.between(wanted, value))
        return value - wanted

    def error(self, point: Array) -> float:
        """E at a packed point, [Paper] section 4; NaN where it has none."""
        if not np.isfinite(point).all():
            return float("nan")
        try:
            return float(np.linalg.norm(self.weights * self.difference(point)))
        except OrientationAtPiError:
            return float("nan")

    @cached_property
    def scales(self) -> Array:
        """What makes each number of e dimensionless."""
        return np.where(np.array(self.units) == "length", 1.0 / self.scale, 1.0)

    def jacobian(self, point: Array, jacobian: Array) -> Array:
        """The rows that belong to e, dimensionless, from the Jacobian (dimension, k) of a point.

        The rows for a rotation are s, not the derivative of the logarithm: [Paper] eq. (13) asks s = -γ r, which is
        parallel to r, so that ṙ = -γ r exactly. Those of an output are derivatives, whence ė = -γ e as well.
        """
        parts = [jacobian[self.rows]]
        for output in self.outputs:
            value, by_tangent = _observed(self.system, output.name, point)
            if output.kind == "direction":
                wanted = np.ravel(self.values[output.name])
                by_tangent = _plane(wanted).T @ call(_turning(), wanted, value)[0].T @ by_tangent
            parts.append(by_tangent @ jacobian)
        return self.scales[:, None] * (np.vstack(parts) if self.outputs else parts[0])

    def output_equations(self, state: Array) -> list[Array]:
        """Expressions of a point, one per number of e that belongs to an output, which vanish exactly where e does.

        Dimensionless, and rational where e is not: tan(φ/2) for the angle φ of a direction.
        """
        xp, equations = namespace(state), []
        control = xp.array([0.0] * self.system.input_space.size)
        for output in self.outputs:
            value = self.system.output(output.name, state, control)
            wanted = np.ravel(self.values[output.name])
            if output.kind == "direction":
                value = xp.array(_plane(wanted).T) @ so3.gibbs_between(xp.array(wanted), value)
            else:
                value = value - xp.array(wanted)
            equations += [value[i] for i in range(output.dimension)]
        scales = self.scales[len(self.rows) :]
        return [scale * value for scale, value in zip(scales, equations, strict=True)]

    def equations(self, state: Array) -> list[Array]:
        """Expressions that vanish exactly where e does, with Gibbs vectors of rotations; `output_equations` last."""
        space, blocks = self._fixed, []
        if space.blocks:
            local = space.coordinates(_part(self.space, space, state), namespace(state).array(self._wanted))
            blocks = [scale * local[i] for i, scale in enumerate(self.scales[: space.dimension])]
        return blocks + self.output_equations(state)


class AlikeTasks:
    """Tasks that fix the same blocks of the state, and no outputs, measured together."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.first = tasks[0]
        self._wanted = np.stack([task._wanted for task in tasks])
        self.scales = np.stack([task.scales for task in tasks])

    def differences(self, places: Array, points: Array) -> tuple[Array, Array]:
        """e (k, size), unweighted, of the tasks at these places, each at its point (k, n); which have one, (k,)."""
        lanes = np.arange(1 << (len(self._wanted) - 1).bit_length())  # so that few functions serve any number
        padded = (rows.take(lanes, axis=0, mode="wrap") for rows in (points, self._wanted[places]))
        errors, angles = call(side_by_side(self.first.difference_function, len(lanes)), *padded)
        single = (angles[: len(places)] <= np.pi - HALF_TURN_WITHIN).all(axis=1)
        return errors[: len(places)], single

    def errors(self, places: Array, points: Array) -> Array:
        """E of the tasks at these places, each at its point (k, n); infinite where it has none."""
        differences, single = self.differences(places, points)
        return np.where(single, np.linalg.norm(self.first.weights * differences, axis=1), np.inf)


def total_error(tasks: Iterable[Task], points: Iterable[Array]) -> float:
    """E over several tasks, each at the point that is to meet it."""
    return float(np.linalg.norm([task.error(point) for task, point in zip(tasks, points, strict=True)]))


def _refuse_half_turn(angles: Array) -> None:
    """Errors: `OrientationAtPiError` where one of the angles is a half turn, so that e has no direction."""
    if angles.size and angles.max() > np.pi - HALF_TURN_WITHIN:
        raise OrientationAtPiError(f"the orientation error is {angles.max():.9f} rad, a half turn")


def _part(space: StateSpace, fixed: StateSpace, point: Array) -> Array:
    """The numbers of a point that belong to some of its blocks."""
    here = space.unpack(point)
    return fixed.pack({name: here[name] for name in fixed.names})


@kept(most=64)
def _part_of(space: StateSpace, names: tuple[str, ...]) -> StateSpace:
    """The space of some of its blocks."""
    return StateSpace([block for block in space.blocks if block.name in names])


@kept(most=64)
def _difference(space: StateSpace, fixed: StateSpace) -> ca.Function:
    """(point, wanted blocks) ↦ (`StateSpace.difference` of the two, the angles of its rotations)."""
    point, wanted = ca.SX.sym("x", space.size), ca.SX.sym("wanted", fixed.size)
    part = _part(space, fixed, point)
    here, there = fixed.unpack(part), fixed.unpack(wanted)
    turns = [here[b.name] @ there[b.name].T for b in fixed.blocks if b.kind == "rotation"]
    outputs = [fixed.difference(part, wanted), ca.vertcat(*[so3.angle(turn) for turn in turns])]
    return ca.Function("difference", [point, wanted], ca.cse([ca.densify(ca.SX(part)) for part in outputs]))


def _plane(direction: Array) -> Array:
    """Orthonormal columns (3 × 2) perpendicular to a unit vector."""
    return svd(np.reshape(direction, (1, 3)))[2][1:].T


def _observed(system: System, name: str, point: Array) -> tuple[Array, Array]:
    """An output of the pose at a point, (k,), and its derivative by the tangent numbers, (k, dimension)."""
    value, by_tangent = call(_observer(system, name), point)
    return value.ravel(), by_tangent.T


@kept(most=64)
def _observer(system: System, name: str) -> ca.Function:
    space = system.state_space
    x, delta = ca.SX.sym("x", space.size), ca.SX.sym("delta", space.dimension)
    value = ca.densify(ca.SX(system.output(name, x, ca.DM.zeros(system.input_space.size))))
    along = ca.jacobian(value, x) @ space.lift(x, delta)
    return ca.Function("observed", [x], [value, ca.densify(ca.jacobian(along, delta))])


@lru_cache(maxsize=1)
def _turning() -> ca.Function:
    """(y_d, y) ↦ the derivative of `so3.between` by y, 3 × 3."""
    wanted, value = ca.SX.sym("wanted", 3), ca.SX.sym("value", 3)
    return ca.Function(
        "turning", [wanted, value], [ca.densify(ca.jacobian(so3.between(wanted, value), value))]
    )
