"""One control tried: where it leads, what the Jacobian says there, and what is wrong with its path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.errors import OrientationAtPiError
from nhpocp.flow.end_point_map import EndPoint, EndPointMap
from nhpocp.problem import PlanningProblem
from nhpocp.solution import Outcome
from nhpocp.solvers.continuation.end_point_error import EndPointError
from nhpocp.solvers.continuation.generalized_inverses import Direction, GeneralizedInverse, LinearisedPath
from nhpocp.solvers.metrics import Coordinates
from nhpocp.systems.numeric import numeric_system

SINGULAR = {"s": Outcome.SINGULAR_S, "w": Outcome.SINGULAR_W}  # by the name of the regularity matrix
SINGULAR_BELOW = 0.05  # |det| against its value at the start, before a path that is not finite


@dataclass(frozen=True)
class Trouble:
    """Why a path cannot be trusted, or not gone on from."""

    outcome: Outcome
    sentence: str


BEYOND_NUMBERS = Trouble(
    Outcome.NOT_FINITE,
    "the end point is finite, and its error overflows; choose units, an `error_length` and a goal nearer to 1",
)


@dataclass(frozen=True)
class Evaluation:
    """One control and where it leads."""

    coefficients: Array
    end: EndPoint
    error: float  # E; infinite where the end point is not finite or an orientation is at π
    vector: Array | None = None  # e, dimensionless (`EndPointError`)
    jacobian: Array | None = None  # its derivative by λ
    look: Callable[[Array, Array], Direction] | None = None  # e, J ↦ the direction
    failure: Trouble | None = None  # the end point is useless
    crossing: Trouble | None = None  # the path jumps across a surface that its equations cannot cross

    @cached_property
    def direction(self) -> Direction | None:
        """The full step; None where there is no error to reduce."""
        if self.look is None or self.vector is None or self.jacobian is None:
            return None
        return self.look(self.jacobian, self.vector)

    @cached_property
    def merit(self) -> float:
        """|e| in the scale in which the direction was found; infinite where there is none."""
        return float(norm(self.vector)) if self.vector is not None else np.inf


class Evaluator:
    """Evaluates controls of one problem with one end-point map and one generalized inverse."""

    def __init__(
        self,
        problem: PlanningProblem,
        end_point_map: EndPointMap,
        inverse: GeneralizedInverse,
        metric: Coordinates,
    ) -> None:
        self.problem, self.map, self.inverse, self.metric = problem, end_point_map, inverse, metric
        self.numeric = numeric_system(problem.system)

    def __call__(self, coefficients: Array) -> Evaluation:
        end = self.map(coefficients)
        finite = bool(np.isfinite(end.path).all())
        determinants = self._determinants(end, finite)
        crossing = self._crossing(determinants)
        if not (finite and np.isfinite(end.jacobian).all()):
            failure = crossing or self._vanishing(determinants) or self._overflow(end.path)
            return Evaluation(coefficients, end, np.inf, failure=failure)
        residual = EndPointError(self.problem, end)
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # said in words below
                error, vector = residual.measured()
                jacobian = residual.jacobian
        except OrientationAtPiError as opposite:
            trouble = Trouble(Outcome.ORIENTATION_AT_PI, str(opposite))
            return Evaluation(coefficients, end, np.inf, failure=trouble)
        if not (np.isfinite(error) and np.isfinite(vector).all() and np.isfinite(jacobian).all()):
            return Evaluation(coefficients, end, np.inf, failure=BEYOND_NUMBERS)
        return Evaluation(
            coefficients,
            end,
            error,
            vector,
            jacobian,
            lambda jacobian, vector: self.inverse(jacobian, vector, self._metric(end)),
            crossing=crossing,
        )

    def _metric(self, end: EndPoint) -> Coordinates:
        """How δλ is measured here."""
        if end.variations is None:
            return self.metric
        scales = self.problem.scales
        variations = end.variations / scales.states[:, None]
        path = LinearisedPath(self.map.times, variations, self.problem.basis, scales.inputs)
        own = self.inverse.metric(path)
        return self.metric if own is None else Coordinates(own)

    def looked_at(self, evaluation: Evaluation) -> dict[str, float | None]:
        """What only a reader of a record asks for: J's rank, the least σ of it and of every regularity matrix."""
        direction, finite = evaluation.direction, _finite(evaluation.end.path)
        values = direction.singular_values if direction else np.empty(0)  # empty too where there is no input
        return {
            "rank": direction.rank if direction else None,
            "sigma_jacobian": float(values[-1]) if len(values) else None,
            **(self.numeric.least_sigmas(finite, self.problem.scale) if len(finite) else {}),
        }

    def _determinants(self, end: EndPoint, finite: bool) -> dict[str, Array]:
        """Of the matrices that the equations divide by; undefined counts as zero (a leg along its own w4 has no w3)."""
        watched = end.watched if finite else end.watched[np.isfinite(end.path).all(axis=1)]
        found = self.numeric.breaking(watched)
        return {name: np.where(np.isnan(values), 0.0, values) for name, values in found.items()}

    def _crossing(self, determinants: dict[str, Array]) -> Trouble | None:
        """The first change of sign of a determinant that the equations divide by."""
        for name, values in determinants.items():
            if values.min() > 0 or values.max() < 0:
                continue
            changes = np.flatnonzero(np.sign(values) * np.sign(values[0]) <= 0)
            if changes.size and changes[0] == 0:
                return _trouble(name, "vanishes at the start")
            if changes.size:
                before, after = self.map.times[changes[0] - 1 : changes[0] + 1]
                return _trouble(name, f"changes sign between t = {before:.4g} and {after:.4g}")
        return None

    def _vanishing(self, determinants: dict[str, Array]) -> Trouble | None:
        """A path that is not finite may have landed on the same side of a surface that it ran into."""
        for name, values in determinants.items():
            share = np.abs(values / values[0])
            if share.min() < SINGULAR_BELOW:
                where = self.map.times[int(np.argmin(share))]
                return _trouble(name, f"falls to {share.min():.2g} of its first value at t = {where:.4g}")
        return None

    def _overflow(self, path: Array) -> Trouble:
        good = int(np.isfinite(path).all(axis=1).sum())
        where = self.map.times[min(good, len(self.map.times) - 1)]
        return Trouble(Outcome.NOT_FINITE, f"the integration is not finite from t = {where:.4g} on")


def _finite(path: Array) -> Array:
    finite = np.isfinite(path)
    return path if finite.all() else path[finite.all(axis=1)]


def _trouble(name: str, words: str) -> Trouble:
    return Trouble(SINGULAR.get(name, Outcome.NOT_FINITE), f"det {name.upper()} {words}")
