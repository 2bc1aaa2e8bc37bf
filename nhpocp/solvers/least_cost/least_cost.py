"""What the Jacobian method does once the goal is reached: into every bound and to the least cost, never leaving it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from nhpocp.arrays import Array, norm
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.integrators import Integrator
from nhpocp.flow.simulation import simulate
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.provenance import afford
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.barrier import barrier_map
from nhpocp.solvers.least_cost.curvature import MOST
from nhpocp.solvers.least_cost.null_space import Cost, NoSurfaceError, NullSpaceResult, minimise
from nhpocp.solvers.least_cost.path_rows import FINE_STEPS, FORGIVEN, INSIDE, PathRows, worst
from nhpocp.solvers.least_cost.slsqp import BoundedProblem, Point, Round, rounds
from nhpocp.solvers.metrics import Coordinates, WeightedMetric

DENSE = 64.0  # bytes for each entry of the model of the Hessian: it, its projection, and copies of both
SEEN = 32.0  # for each entry of the directions that it knows: they, and what is made of them
HELD = 1e-6  # of a limit: a violation that is rounding; verification forgives a thousand times as much
DEAR = 1.5  # times the cost of the reached control
NOTHING = 1e-6  # of a problem's own cost
BARRIERS = (
    1e-2,
    1e-3,
)  # of the cost, one after another: what the barrier weighs on a path as clear as its start
SETTLED = 5e-3  # of the cost: what the last of them takes off a plan that no surface holds


@dataclass(frozen=True)
class Residual:
    """What one control makes of the goal: e (rows,), J = ∂e/∂λ (rows, inputs·size), and its path (times, n)."""

    error: Array
    jacobian: Array
    path: Array


class ResidualEvaluator(Protocol):
    """Where controls lead, as long as the budget lasts."""

    times: Array  # the grid of the paths
    budget: Budget

    def __call__(self, coefficients: Array) -> Residual | None:
        """What Λ (inputs × size) makes of the goal; None where no path of use leads, or the budget is spent."""
        ...

    def tell(self, **figures: Any) -> None:
        """Hears what the search knows of the last control, ``cost`` and ``worst_bound``, for whoever watches."""
        ...


@dataclass(frozen=True)
class LeastCostResult:
    """The control that the search ends with, and what is to be said of it."""

    coefficients: Array
    moved: bool  # away from the control that the search began with
    held: bool  # short of a stationary point, before paths that cannot be used
    outcome: Outcome
    sentence: str
    details: dict[str, Any]


@dataclass(frozen=True)
class _Candidate:
    """A control that reaches the goal."""

    y: Array
    cost: float
    violation: float  # of the bounds, relative to their limits
    ended: NullSpaceResult | Round | None = None  # the search that led to it

    @property
    def held(self) -> bool:
        return self.violation <= HELD

    def better(self, other: _Candidate) -> _Candidate:
        """Of two: inside every bound before outside, then the least cost, or the least violation."""
        less = other.cost <= self.cost if self.held and other.held else other.violation <= self.violation
        return other if less else self


@dataclass
class LeastCost:
    """The search from one control that reaches the goal.

    ``objective``: a name of `OBJECTIVES`, or none; then the nearest control (in L²) within every bound is looked for.
    """

    problem: PlanningProblem
    horizon: float
    integrator: Integrator
    objective: str
    tolerance: float  # of the goal
    evaluator: ResidualEvaluator
    reached: Array  # coefficients, inputs × size

    def __post_init__(self) -> None:
        problem, horizon = self.problem, self.horizon
        size = self.reached.size
        search = f"the search for less in the null space of {size} coefficients"
        if self.objective != "none":
            afford(SEEN * size * min(size, MOST), search)
        if problem.bounds:
            afford(DENSE * size**2, search)
            rows = len(self.evaluator.times) + FINE_STEPS
            afford(DENSE * rows * size, f"the bounds at {rows} times by {size} coefficients")
        basis, scales = problem.basis, problem.scales
        # in which the effort is |y|² in units of its scale, and each input counts by its own size where these differ
        metric = WeightedMetric(1.0 / scales.inputs**2)
        self._coordinates = Coordinates.natural(metric, basis, scales.inputs, horizon)
        self._path_rows = PathRows(problem, basis, horizon, self.evaluator.times) if problem.bounds else None
        self._goal = min(1e-7, 1e-3 * self.tolerance)
        self._aimless = self.objective == "none"
        name = "effort" if self._aimless else self.objective
        self._scale = OBJECTIVES[name].scale(scales)
        self._map = cost_map(name, problem, basis, horizon, self.integrator)
        self._history: list[dict[str, Any]] = []
        self._rounds: list[dict[str, Any]] = []
        self._refused = 0  # paths that cannot be used
        self._surfaces: list[str] = []  # that a barrier held the best control off
        self._stalled: float | None = None  # the least violation at which a search came to rest
        first = self._coordinates.of(self.reached.ravel())
        self._first = self._best = _Candidate(first, self._cost(first)[0], self._violation(first))

    def run(self, *, off: bool = False) -> LeastCostResult:
        """The search, as far as it comes; ``off`` the surfaces that no path crosses, without bounds."""
        end = ""
        try:
            if off:
                self._search_off()
            else:
                self._search()
        except NoSurfaceError:
            end = "the null space could not be searched: Newton's method from there does not come nearer to the goal"
        except np.linalg.LinAlgError as error:
            end = f"the null space could not be searched: {error}"
        if self.evaluator.budget.refused and (end or self._path_rows):
            end = "max_iterations ended the search"
        return self._result(end)

    def _search(self) -> None:
        """The least cost without bounds, then from there into the bounds; from the reached control if not, or if dear.

        From the free optimum the way in led to a cost as low or lower in each of 14 cases, and twice much lower; where
        it leads across a singular surface, the other one may cost less than half.
        """
        y, nearest = self._first.y, False
        if self._aimless:
            if self._first.held or self._bounded(self._distance, y, 2.0 * np.eye(len(y))):
                return
            nearest = self._stalled is not None
        free = self._minimised(self._cost, y)
        self._history = [record | {"cost": self._scale * record["cost"]} for record in free.history]
        candidate = _Candidate(free.y, free.cost, self._violation(free.y), free)
        self._best = self._best.better(candidate)
        within = candidate.held or self._bounded(self._cost, free.y, free.hessian.full)
        if (not within and not nearest) or (within and self._best.cost > DEAR * self._first.cost):
            self._bounded(self._cost, y, self._curvature(y) * np.eye(len(y)))

    def _search_off(self) -> None:
        """From where a search was held, off the surface that holds it: along a barrier that shrinks.

        Where the cost falls all the way to a surface it has no least off it, and steps end there wherever they happen
        to hit it: 8.0 to 9.7 from seven starts, of which five came to 7.2 so. What no surface holds ends without.
        """
        barrier = barrier_map(self.problem, self.problem.basis, self.horizon, self.integrator)
        y, last, settled = self._first.y, self._first.cost, barrier is None
        for weight in BARRIERS:
            if barrier is None:
                break
            barred = partial(self._barred, barrier, weight * self._first.cost)
            ended = self._minimised(barred, y)
            y, cost = ended.y, self._cost(ended.y)[0]
            ended = replace(ended, cost=cost, stationarity=self._slope(y), converged=False)
            self._best = self._best.better(_Candidate(y, cost, 0.0, ended))
            self._surfaces = [f"det {name.upper()} = 0" for name in self.problem.system.breaking()]
            last, settled = cost, cost > (1.0 - SETTLED) * last
        if settled:
            free = self._minimised(self._cost, y)
            self._best = self._best.better(_Candidate(free.y, free.cost, 0.0, free))

    def _minimised(self, cost: Cost, y: Array) -> NullSpaceResult:
        budget, curvature = self.evaluator.budget, self._curvature(y)
        return minimise(self._surface, cost, y, curvature=curvature, goal=self._goal, budget=budget)

    def _barred(self, barrier: Cost, weight: float, y: Array) -> tuple[float, Array]:
        """The cost with so much of the barrier."""
        (cost, slope), (value, gradient) = self._cost(y), barrier(self._coefficients(y))
        return cost + weight * value, slope + weight * self._coordinates.jacobian(gradient)

    def _slope(self, y: Array) -> float:
        """The size of the cost's gradient in the null space of J."""
        tried = self._attempt(y)
        if tried is None:
            return np.inf
        slope = self._cost(y)[1]
        return float(norm(slope - np.linalg.pinv(tried.jacobian) @ (tried.jacobian @ slope)))

    def _bounded(self, cost: Cost, y: Array, hessian: Array) -> bool:
        """From y to the least cost within the bounds; whether the search ends within them."""

        def evaluate(y: Array) -> Point | None:
            tried = self._attempt(y)
            if tried is None:
                return None
            table = self._rows.values(tried.path, self._coefficients(y))
            rows = table.ravel()
            self.evaluator.tell(worst_bound=self._rows.worst_words(table))
            return Point(tried.error, tried.jacobian, *cost(y), rows) if np.isfinite(rows).all() else None

        violation = np.inf
        bounded = BoundedProblem(evaluate, self._row_slopes, self._between)
        for ended in rounds(bounded, y, hessian, slack=INSIDE + HELD, budget=self.evaluator.budget):
            violation = max(0.0, -ended.least - INSIDE)
            self._rounds.append(
                {
                    "weight": ended.weight,
                    "violation": violation if np.isfinite(violation) else None,
                    "cost": self._scale * ended.cost,
                    "steps": ended.steps,
                    "stationarity": ended.stationarity,
                }
            )
            if ended.infeasibility <= self._goal:
                self._best = self._best.better(_Candidate(ended.y, ended.cost, violation, ended))
            else:
                violation = np.inf
            if ended.stalled:
                self._stalled = min(violation, self._stalled or np.inf)
        return violation <= HELD

    # --- what the search asks ------------------------------------------------------------------------------------

    def _coefficients(self, y: Array) -> Array:
        return self._coordinates.coefficients(y).reshape(self.reached.shape)

    def _attempt(self, y: Array) -> Residual | None:
        """Where y leads, with ∂e/∂y."""
        tried = self.evaluator(self._coefficients(y))
        self._refused += tried is None
        return tried and replace(tried, jacobian=self._coordinates.jacobian(tried.jacobian))

    def _surface(self, y: Array) -> tuple[Array, Array] | None:
        tried = self._attempt(y)
        return (tried.error, tried.jacobian) if tried else None

    def _distance(self, y: Array) -> tuple[float, Array]:
        """∫ |u - u_reached|² dt."""
        step = y - self._first.y
        return float(step @ step), 2.0 * step

    def _cost(self, y: Array) -> tuple[float, Array]:
        """The objective, in units of its scale; the effort where there is none."""
        value, gradient = self._map(self._coefficients(y))
        if not self._aimless:
            self.evaluator.tell(cost=value)
        return value / self._scale, self._coordinates.jacobian(gradient) / self._scale

    def _curvature(self, y: Array) -> float:
        """A guess at the cost's curvature, exact for the effort."""
        squared = float(y @ y)
        return 2.0 * self._cost(y)[0] / squared or 2.0 if squared > 0 else 2.0

    @property
    def _rows(self) -> PathRows:
        if self._path_rows is None:
            raise RuntimeError("rows of a problem without bounds")
        return self._path_rows

    def _row_slopes(self, y: Array) -> Array:
        slopes = self._rows.derivatives(self._coefficients(y))
        return self._coordinates.jacobian(slopes.reshape(-1, len(y)))

    def _between(self, y: Array) -> Array:
        return self._rows.between(self._coefficients(y)).ravel()

    def _violation(self, y: Array) -> float:
        """The worst relative excess over a bound; 0 where all hold."""
        if not self._path_rows:
            return 0.0
        least = float(np.min(self._between(y)))
        return max(0.0, -least - INSIDE) if np.isfinite(least) else np.inf

    # --- endings -------------------------------------------------------------------------------------------------

    def _result(self, end: str) -> LeastCostResult:
        best = self._best
        ended = best.ended
        coefficients = self._coefficients(best.y) if ended else self.reached
        details: dict[str, Any] = {"null_space": self._history} if self._history else {}
        parts = []
        if not self._aimless:
            control = self.problem.control(coefficients, self.horizon)
            cost = simulate(self.problem, control).costs[self.objective]  # not what is smooth in its place
            details["objective_value"] = cost
            nothing = cost <= NOTHING * self._scale  # and none costs less
            stationary = bool(nothing or (ended and ended.converged and not end))
            details["stationary"] = stationary
            words = "at a stationary point" if stationary else "not at a stationary point"
            if self._surfaces and not stationary:
                details["falls_towards"] = self._surfaces
                words = f"held off {' and '.join(self._surfaces)}, towards which it falls"
            parts.append(f"{self.objective} {cost:.6g} {words}")
        if ended:
            details["optimality"] = {"stationarity": ended.stationarity, "feasibility": ended.infeasibility}
        outcome = Outcome.CONVERGED
        if self._path_rows:
            details["constraints"] = {
                "rounds": self._rounds,
                "violation": best.violation,
                "stalled": self._stalled,
            }
            parts.append("every bound holds")
            if not best.violation <= FORGIVEN:  # verification would refuse it
                outcome = Outcome.CONSTRAINT_VIOLATED
                reports = self._rows.reports(self.problem.control(coefficients, self.horizon))
                report = worst(reports)
                broken = [each.bound.label for each in reports if not each.ok]
                details["constraints"]["broken"] = broken
                together = " and ".join(broken) if len(broken) > 1 else "every bound"
                parts[-1] = (
                    f"no control near it over this basis was found that keeps {together}: {report.describe()}; "
                    "more harmonics may find one"
                )
        sentence = "; ".join([*parts, end] if end else parts)
        stopped = self._refused > 0 and not (end or self.evaluator.budget.refused or self.problem.bounds)
        held = stopped and not details.get("stationary", True)
        return LeastCostResult(coefficients, ended is not None, held, outcome, sentence, details)
