"""One control tried: where it leads, what the Jacobian says there, and what is wrong with its path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.errors import OrientationAtPiError
from nhpocp.flow.end_point_map import EndPoint, EndPointMap
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.continuation.end_point_error import EndPointError
from nhpocp.solvers.continuation.ending import Ending
from nhpocp.solvers.continuation.generalized_inverses import Direction, GeneralizedInverse, LinearisedPath
from nhpocp.solvers.continuation.singularity_crossings import determinants, first_crossing, nearest_approach
from nhpocp.solvers.metrics import Coordinates
from nhpocp.systems.numeric import numeric_system

BEYOND_NUMBERS = Ending(
    Outcome.NOT_FINITE,
    "the end point is finite, and its error overflows; choose units, an `error_length` and a goal nearer to 1",
)


@dataclass(frozen=True)
class Evaluation:
    """One control and where it leads."""

    coefficients: Array
    end: EndPoint
    # E; infinite where the end point is not finite or an orientation is at π
    error: float
    # e, dimensionless (`EndPointError`), and its derivative by λ
    residual: Array | None = None
    jacobian: Array | None = None
    # J, e ↦ the direction
    invert: Callable[[Array, Array], Direction] | None = None
    # the end point is useless
    failure: Ending | None = None
    # the path jumps across a surface that its equations cannot cross
    crossing: Ending | None = None

    @property
    def usable(self) -> bool:
        """Whether the path is one to go on from."""
        return self.failure is None and self.crossing is None

    @cached_property
    def direction(self) -> Direction | None:
        """The full step; None where there is no error to reduce."""
        if self.invert is None or self.residual is None or self.jacobian is None:
            return None
        return self.invert(self.jacobian, self.residual)

    @cached_property
    def merit(self) -> float:
        """|e| in the scale in which the direction was found; infinite where there is none."""
        return float(norm(self.residual)) if self.residual is not None else np.inf


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
        end, times = self.map(coefficients), self.map.times
        finite = bool(np.isfinite(end.path).all())
        along = determinants(self.numeric, end, finite)
        crossing = first_crossing(along, times)
        if not (finite and np.isfinite(end.jacobian).all()):
            failure = crossing or nearest_approach(along, times) or self._overflow(end.path)
            return Evaluation(coefficients, end, np.inf, failure=failure)
        measured = EndPointError(self.problem, end)
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # said in words below
                error, residual = measured.measured()
                jacobian = measured.jacobian
        except OrientationAtPiError as opposite:
            failure = Ending(Outcome.ORIENTATION_AT_PI, str(opposite))
            return Evaluation(coefficients, end, np.inf, failure=failure)
        if not (np.isfinite(error) and np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            return Evaluation(coefficients, end, np.inf, failure=BEYOND_NUMBERS)

        def invert(jacobian: Array, residual: Array) -> Direction:
            return self.inverse(jacobian, residual, self._metric(end))

        return Evaluation(coefficients, end, error, residual, jacobian, invert, crossing=crossing)

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

    def _overflow(self, path: Array) -> Ending:
        good = int(np.isfinite(path).all(axis=1).sum())
        where = self.map.times[min(good, len(self.map.times) - 1)]
        return Ending(Outcome.NOT_FINITE, f"the integration is not finite from t = {where:.4g} on")


def _finite(path: Array) -> Array:
    finite = np.isfinite(path)
    return path if finite.all() else path[finite.all(axis=1)]
