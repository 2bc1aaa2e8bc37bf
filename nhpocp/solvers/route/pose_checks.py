"""What makes a pose valid, put together from parts, each a number that is positive where the pose may be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import casadi as ca
import numpy as np

from nhpocp.arrays import Array
from nhpocp.calls import call, of_many
from nhpocp.constraints.bound import Bound, in_shape
from nhpocp.kept import kept
from nhpocp.objectives.quantity import quantity
from nhpocp.problem import PlanningProblem
from nhpocp.singular_values import svd
from nhpocp.systems.leg_accelerations import LEG_ACCELERATIONS
from nhpocp.systems.margins import det, sigma
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System

TINY = 1e-60  # for what would be 0/0
WITHIN = 5e-4  # of its size: by how much a bound may be passed, half of what verification forgives
STEEP = 20.0  # times as fast as at start or goal: how fast unit inputs may move a system that has no margins


class PoseCheck(ABC):
    """One part of a pose's validity.

    name: what is asked, in words. `expression` gives numbers of a pose as a symbolic column; `slacks` what these say.
    """

    name: str

    @abstractmethod
    def expression(self, state: ca.SX) -> ca.SX:
        """The numbers that it looks at, a column, of a packed symbolic pose."""

    @abstractmethod
    def slacks(self, numbers: Array) -> Array:
        """(k, slacks) of the numbers (k, …) of k poses: positive where they may be, dimensionless, of bounded slope.

        One for each limit of each number: the least of several would hide how another falls.
        """


@dataclass(frozen=True)
class OnOneSide(PoseCheck):
    """σ_min(M) ≥ least on the start's side of det M = 0.

    σ_min with the sign of det M passes through zero as smoothly as the path does, where σ_min alone has a kink.
    """

    system: System
    matrix: str
    sign: float  # of det M at the start
    least: float
    length_scale: float

    @property
    def name(self) -> str:  # type: ignore[override]
        least = f"{sigma(self.matrix).name} ≥ {self.least:.2g}"
        return f"{least} on the start's side of det {det(self.matrix).letter} = 0"

    def expression(self, state: ca.SX) -> ca.SX:
        matrix = numeric_system(self.system).matrices(state)[self.matrix]
        scales = self.system.column_scales(self.matrix, self.length_scale) or [1.0] * matrix.size2()
        scaled = matrix @ ca.diag(1.0 / ca.DM(scales))
        return signed_least(scaled) if scaled.shape == (3, 3) else ca.vec(scaled.T)

    def slacks(self, numbers: Array) -> Array:
        if numbers.shape[1] == 1:
            signed = numbers
        else:
            size = int(np.sqrt(numbers.shape[1]))
            matrices = numbers.reshape(-1, size, size)
            finite = np.isfinite(matrices).all(axis=(1, 2))
            matrices = np.where(finite[:, None, None], matrices, 0.0)
            signed = (np.sign(np.linalg.det(matrices)) * svd(matrices, compute_uv=False)[:, -1])[:, None]
        return np.where(np.isfinite(signed), self.sign * signed, 0.0) - self.least


def signed_least(matrix: ca.SX) -> ca.SX:
    """σ_min of a matrix (3 × 3) with the sign of its determinant, det M / (σ_1 σ_2), and no more than σ_2.

    λ of MᵀM by the cosine formula, whose largest two are as exact as MᵀM is; of nearly rank 1 only to 2e-5 σ_1.
    """
    square = matrix.T @ matrix
    middle = ca.trace(square) / 3
    apart = square - middle * ca.SX.eye(3)
    spread = ca.sqrt(ca.sumsqr(apart) / 6)
    cosine = ca.det(apart) / (2 * ca.fmax(spread, TINY) ** 3)
    angle = ca.acos(ca.fmin(ca.fmax(cosine, -1), 1)) / 3
    first, last = (middle + 2 * spread * ca.cos(angle + turn) for turn in (0.0, 2 * np.pi / 3))
    second = ca.fmax(3 * middle - first - last, 0)
    signed, most = ca.det(matrix) / ca.fmax(ca.sqrt(first * second), TINY), ca.sqrt(second)
    return ca.fmax(ca.fmin(signed, most), -most)


@dataclass(frozen=True)
class Within(PoseCheck):
    """A bound on a quantity that the pose alone decides. reserve: by what part of its limit it is kept at least."""

    system: System
    bound: Bound
    reserve: float = 0.0

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.bound.label

    def expression(self, state: ca.SX) -> ca.SX:
        at, _, value = self._quantity
        return ca.substitute(ca.vec(value.T), at, state)

    @cached_property
    def _quantity(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Of a symbolic state and control; many corners make it dear."""
        state = ca.SX.sym("x", self.system.state_space.size)
        control = ca.SX.sym("u", self.system.input_space.size)
        value = quantity(self.system, self.bound.quantity, state, control)
        return state, control, ca.densify(ca.SX(value))

    @cached_property
    def applies(self) -> bool:
        """Whether it has a limit, and is on a quantity that no control changes."""
        if self.bound.margin or self.bound.quantity == LEG_ACCELERATIONS:
            return False
        if not np.isfinite([*np.ravel(self.bound.lower), *np.ravel(self.bound.upper)]).any():
            return False
        _, control, value = self._quantity
        return not ca.depends_on(value, control)

    def reserving(self, reserve: float) -> Within:
        """With another reserve; what it knows of the quantity is kept."""
        other = copy(self)
        object.__setattr__(other, "reserve", reserve)
        return other

    def slacks(self, numbers: Array) -> Array:
        lower, upper, below, above = self._sides
        low, high = np.isfinite(lower), np.isfinite(upper)
        room = np.hstack([((numbers - lower) / below)[:, low], ((upper - numbers) / above)[:, high]])
        return np.where(np.isfinite(numbers).all(axis=1)[:, None], room, -1.0) + WITHIN - self.reserve

    @cached_property
    def _sides(self) -> list[Array]:
        """The limits and their sizes, one number a component."""
        shape = tuple(size for size in self._quantity[2].shape if size > 1)
        sides = self.bound.lower, self.bound.upper, *self.bound.sizes
        return [np.ravel(in_shape(side, shape)) for side in sides]


@dataclass(frozen=True)
class NotSteep(PoseCheck):
    """Inputs of their natural size move the pose at most so fast, of a system without margins: a car, say."""

    system: System
    inputs: Array
    states: Array  # the scales of both
    most: float
    name: str = "vector fields that do not run away"

    def expression(self, state: ca.SX) -> ca.SX:
        fields = ca.SX(self.system.vector_fields(state))
        scaled = ca.diag(1.0 / ca.DM(self.states)) @ fields @ ca.diag(ca.DM(self.inputs))
        return ca.sumsqr(scaled)

    def slacks(self, numbers: Array) -> Array:
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(numbers), 1.0 - np.sqrt(numbers) / self.most, -1.0)


class PoseChecks:
    """All parts together, evaluated on many poses at a time. A pose is valid where every slack is positive."""

    def __init__(self, system: System, checks: Sequence[PoseCheck]) -> None:
        space = system.state_space
        self.system = system
        a, tangent, s = ca.SX.sym("a", space.size), ca.SX.sym("delta", space.dimension), ca.SX.sym("s")
        columns = [ca.densify(ca.SX(check.expression(a))) for check in checks]
        edges = [0, *accumulate(column.numel() for column in columns)]
        self._numbers_of = [slice(*ends) for ends in pairwise(edges)]
        self._numbers = ca.Function("numbers", [a], [ca.cse(ca.vertcat(ca.SX(0, 1), *columns))])
        there = ca.densify(space.retract(a, s * tangent))
        self._between = ca.Function("between", [a, tangent, s], [there])
        b = ca.SX.sym("b", space.size)
        self._difference = ca.Function("difference", [b, a], [ca.densify(space.difference(b, a))])
        self._ask(checks)

    def _ask(self, checks: Sequence[PoseCheck]) -> None:
        self.checks = tuple(checks)
        self.refusals = dict.fromkeys((check.name for check in checks), 0)
        each = self._each(np.zeros((1, self._numbers.numel_out())))
        edges = [0, *accumulate(slacks.shape[1] for slacks in each)]
        self._slacks_of = [slice(*ends) for ends in pairwise(edges)]

    def asking(self, checks: Sequence[PoseCheck]) -> PoseChecks:
        """The same of other checks on the same numbers; nothing is made anew."""
        other = copy(self)
        other._ask(checks)
        return other

    def slacks(self, poses: Array) -> Array:
        """(k, slacks) of poses (k, size), those of one check after the other's."""
        return np.concatenate(self._each(of_many(self._numbers, poses)), axis=1)

    def _each(self, numbers: Array) -> list[Array]:
        """The slacks of each check."""
        with np.errstate(all="ignore"):
            return [c.slacks(numbers[:, p]) for c, p in zip(self.checks, self._numbers_of, strict=True)]

    def least(self, slacks: Array) -> Array:
        """Of each check the least of all poses, (checks,) of (k, slacks)."""
        return np.array([slacks[:, part].min() for part in self._slacks_of])

    def valid(self, poses: Array) -> bool:
        """Whether each of the poses (k, size) is; what refuses it is counted."""
        return not len(self.checks) or not self.refuse(self.slacks(poses))

    def difference(self, there: Array, here: Array) -> Array:
        """The tangent (dimension,) from one pose to another; NaN for a half turn."""
        return call(self._difference, there, here)[0].ravel()

    def between(self, here: Array, tangent: Array, fractions: Array) -> Array:
        """Poses (k, size) along a tangent from one of them."""
        k = len(fractions)
        return of_many(self._between, np.tile(here, (k, 1)), np.tile(tangent, (k, 1)), fractions[:, None])

    def refuse(self, slacks: Array) -> bool:
        """Whether one of the poses with these slacks (k, slacks) is not valid; what says so is counted."""
        if (slacks > 0).all():
            return False
        for check, least in zip(self.checks, self.least(slacks), strict=True):
            if not least > 0:
                self.refusals[check.name] += 1
        return True


def pose_checks(problem: PlanningProblem, fraction: float) -> PoseChecks:
    """What the poses of a problem's motion have to meet.

    fraction: of what start and goal have to spare, the lesser of them, that is kept: from det = 0 and from the bounds.
    """
    bare, least = _bare(problem), least_margins(problem, fraction)
    ends = bare.least(bare.slacks(np.stack([problem.start_point, problem.goal_point])))
    spared = fraction * np.maximum(ends - WITHIN, 0.0)
    checks: list[PoseCheck] = []
    for check, part in zip(bare.checks, spared, strict=True):
        if isinstance(check, Within):
            check = check.reserving(float(part))
        elif isinstance(check, OnOneSide):
            check = replace(check, least=least[check.matrix])
        checks.append(check)
    return bare.asking(checks)


@kept(most=4)  # to make it is dear where obstacles have many corners
def _bare(problem: PlanningProblem) -> PoseChecks:
    """That keeps nothing of what start and goal have to spare."""
    system, start = problem.system, problem.start_point
    determinants, least = numeric_system(system).determinants(start[None]), least_margins(problem, 0.0)
    checks: list[PoseCheck] = [
        OnOneSide(system, name, float(np.sign(determinants[name][0])), least[name], problem.scale)
        for name in system.separating()
    ]
    within = [check for bound in problem.bounds if (check := Within(system, bound)).applies]
    return PoseChecks(system, [*(checks or [_not_steep(problem)]), *within])


def least_margins(problem: PlanningProblem, fraction: float) -> dict[str, float]:
    """Of each separating matrix that fraction of σ_min at start or goal, the lesser, and no less than is asked."""
    system = problem.system
    ends = np.stack([problem.start_point, problem.goal_point])
    sigmas = numeric_system(system).sigmas(ends, problem.scale)
    asked = {
        name: max(
            (float(np.max(b.lower)) for b in problem.bounds if b.quantity == sigma(name).name), default=0.0
        )
        for name in system.separating()
    }
    return {name: max(fraction * float(sigmas[name].min()), asked[name]) for name in system.separating()}


def _not_steep(problem: PlanningProblem) -> NotSteep:
    scales, system = problem.scales, problem.system
    inputs, states = scales.inputs * scales.time, scales.states
    fields = [
        np.linalg.norm(np.asarray(system.vector_fields(x), dtype=float) * inputs / states[:, None])
        for x in (problem.start_point, problem.goal_point)
    ]
    return NotSteep(system, inputs, states, STEEP * float(max(fields)))
