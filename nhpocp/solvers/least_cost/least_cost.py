"""What the Jacobian method does once the goal is reached: into every bound and to the least cost, never leaving it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from nhpocp.arrays import Array
from nhpocp.flow.cost_map import cost_map
from nhpocp.flow.integrators import Integrator
from nhpocp.flow.simulation import simulate
from nhpocp.objectives.registry import OBJECTIVES
from nhpocp.problem import PlanningProblem
from nhpocp.provenance import afford
from nhpocp.solution import Outcome
from nhpocp.solvers.budget import Budget
from nhpocp.solvers.least_cost.augmented_lagrangian import rounds
from nhpocp.solvers.least_cost.curvature import MOST, Curvature
from nhpocp.solvers.least_cost.null_space import Cost, NoSurfaceError, NullSpaceResult, minimise
from nhpocp.solvers.least_cost.path_rows import FINE_STEPS, FORGIVEN, INSIDE, PathRows, worst
from nhpocp.solvers.metrics import Coordinates, WeightedMetric

DENSE = 64.0  # bytes for each entry of the model of the Hessian: it, its projection, and copies of both
SEEN = 32.0  # for each entry of the directions that it knows: they, and what is made of them
HELD = 1e-6  # of a limit: a violation that is rounding; verification forgives a thousand times as much
NOTHING = 1e-6  # of a problem's own cost


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


@dataclass(frozen=True)
class LeastCostResult:
    """The control that the search ends with, and what is to be said of it."""

    coefficients: Array
    moved: bool  # away from the control that the search began with
    outcome: Outcome
    sentence: str
    details: dict[str, Any]


@dataclass
class _Best:
    """The best control so far: inside every bound before outside, then the least cost, or the least violation."""

    y: Array
    cost: float
    violation: float  # of the bounds, relative to their limits
    found: NullSpaceResult | None = None

    @property
    def held(self) -> bool:
        return self.violation <= HELD

    def offer(self, found: NullSpaceResult, violation: float) -> None:
        both_hold = self.held and violation <= HELD
        better = found.cost <= self.cost if both_hold else violation <= self.violation
        if better:
            self.y, self.cost, self.violation, self.found = found.y, found.cost, violation, found


@dataclass
class LeastCost:
    """The search from one control that reaches the goal.

    ``objective``: a name of `OBJECTIVES`, or none; then the nearest control (in L²) within every bound is looked for.
    ``times``: the grid of the paths that ``attempt`` hands back.
    """

    problem: PlanningProblem
    horizon: float
    integrator: Integrator
    objective: str
    tolerance: float  # of the goal
    evaluator: ResidualEvaluator
    reached: Array  # coefficients, inputs × size
    history: list[dict[str, Any]] = field(default_factory=list)
    weights: list[dict[str, Any]] = field(
        default_factory=list
    )  # of the augmented Lagrangian, round after round

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
        self._first = self._coordinates.of(self.reached.ravel())
        self._last: tuple[Array, Array] | None = None  # y and the path of the latest attempt
        self._path_rows = PathRows(problem, basis, horizon, self.evaluator.times) if problem.bounds else None
        self._goal = min(1e-7, 1e-3 * self.tolerance)
        self._aimless = self.objective == "none"
        name = "effort" if self._aimless else self.objective
        self._scale = OBJECTIVES[name].scale(scales)
        self._map = cost_map(name, problem, basis, horizon, self.integrator)

    def run(self) -> LeastCostResult:
        """The search, as far as it comes."""
        best = _Best(self._first, self._cost(self._first)[0], self._violation(self._first))
        if self._aimless and best.held:
            return self._improved(best, "")
        end = ""
        try:
            if not (self._aimless and self._bounded(best, self._distance, self._first)):
                self._search(best)
        except NoSurfaceError:
            end = "the null space could not be searched: Newton's method from there does not come nearer to the goal"
            if self.evaluator.budget.refused:
                end = "max_iterations ended the search"
        except np.linalg.LinAlgError as error:
            end = f"the null space could not be searched: {error}"
        return self._improved(best, end)

    def _search(self, best: _Best) -> None:
        """The least cost without bounds, then from there into the bounds; from the reached control if that fails.

        From the free optimum the way in led to a cost as low or lower in each of 14 cases, and twice much lower.
        """
        curvature = self._curvature(self._cost, self._first)
        budget = self.evaluator.budget
        free = minimise(
            self._constraint, self._cost, self._first, curvature=curvature, goal=self._goal, budget=budget
        )
        self._remember(free)
        violation = self._violation(free.y)
        best.offer(free, violation)
        if violation > HELD and not self._bounded(best, self._cost, free.y, free.hessian):
            self._bounded(best, self._cost, self._first)

    def _bounded(self, best: _Best, cost: Cost, y: Array, hessian: Curvature | None = None) -> bool:
        """The rounds of the method of multipliers from y; whether they end within the bounds."""
        searched = rounds(
            self._constraint,
            cost,
            self,
            y,
            scale=cost(y)[0] or float(y @ y) or 1.0,
            slack=INSIDE + HELD,
            tolerance=1e-3 if self._aimless else 1e-5,
            goal=self._goal,
            curvature=self._curvature(cost, y),
            hessian=hessian,
            budget=self.evaluator.budget,
        )
        violation = np.inf
        for round_ in searched:
            found, violation = round_.found, max(0.0, -round_.least - INSIDE)
            self._remember(found)
            self.weights.append(
                {
                    "weight": round_.weight,
                    "violation": violation if np.isfinite(violation) else None,
                    "cost": self._scale * found.cost,
                    "steps": len(found.history) - 1,
                    "stationarity": found.optimality,
                }
            )
            best.offer(found, violation)
            if self._aimless and violation <= HELD:  # no least cost was asked for
                break
        return violation <= HELD

    def _remember(self, found: NullSpaceResult) -> None:
        self.history += [record | {"cost": self._scale * record["cost"]} for record in found.history]

    # --- what the search asks ------------------------------------------------------------------------------------

    def _coefficients(self, y: Array) -> Array:
        return self._coordinates.coefficients(y).reshape(self.reached.shape)

    def _constraint(self, y: Array) -> tuple[Array, Array] | None:
        tried = self.evaluator(self._coefficients(y))
        if tried is None:
            return None
        self._last = y, tried.path
        return tried.error, self._coordinates.jacobian(tried.jacobian)

    def _distance(self, y: Array) -> tuple[float, Array]:
        """∫ |u - u_reached|² dt."""
        step = y - self._first
        return float(step @ step), 2.0 * step

    def _cost(self, y: Array) -> tuple[float, Array]:
        """The objective, in units of its scale; the effort where there is none."""
        value, gradient = self._map(self._coefficients(y))
        return value / self._scale, self._coordinates.jacobian(gradient) / self._scale

    def _curvature(self, cost: Cost, y: Array) -> float:
        """A guess at the cost's curvature, exact for the effort."""
        squared = float(y @ y)
        return 2.0 * cost(y)[0] / squared or 2.0 if squared > 0 else 2.0

    @property
    def _rows(self) -> PathRows:
        if self._path_rows is None:
            raise RuntimeError("rows of a problem without bounds")
        return self._path_rows

    def values(self, y: Array) -> Array:
        if self._last is None or self._last[0] is not y:
            raise RuntimeError("rows are asked where the path was just seen")
        return self._rows.values(self._last[1], self._coefficients(y)).ravel()

    def slopes(self, y: Array) -> Array:
        slopes = self._rows.derivatives(self._coefficients(y))
        return self._coordinates.jacobian(slopes.reshape(-1, len(y)))

    def between(self, y: Array) -> Array:
        return self._rows.between(self._coefficients(y)).ravel()

    def _violation(self, y: Array) -> float:
        """The worst relative excess over a bound; 0 where all hold."""
        if not self._path_rows:
            return 0.0
        least = float(np.min(self.between(y)))
        return max(0.0, -least - INSIDE) if np.isfinite(least) else np.inf

    # --- endings -------------------------------------------------------------------------------------------------

    def _improved(self, best: _Best, end: str) -> LeastCostResult:
        found = best.found
        coefficients = self.reached if found is None else self._coefficients(best.y)
        details: dict[str, Any] = {"null_space": self.history} if self.history else {}
        parts = []
        if not self._aimless:
            control = self.problem.control(coefficients, self.horizon)
            cost = simulate(self.problem, control).costs[self.objective]  # not what is smooth in its place
            details["objective_value"] = cost
            nothing = cost <= NOTHING * self._scale  # and none costs less
            words = "at" if nothing or (found and found.converged and not end) else "not at"
            parts.append(f"{self.objective} {cost:.6g} {words} a stationary point")
        if found:
            details["optimality"] = {"stationarity": found.optimality, "feasibility": found.infeasibility}
        outcome = Outcome.CONVERGED
        if self._path_rows:
            details["constraints"] = {"rounds": self.weights, "violation": best.violation}
            parts.append("every bound holds")
            if not best.violation <= FORGIVEN:  # verification would refuse it
                outcome = Outcome.CONSTRAINT_VIOLATED
                report = worst(self._rows.reports(self.problem.control(coefficients, self.horizon)))
                parts[-1] = (
                    f"no control near it over this basis was found that keeps every bound: {report.describe()}; "
                    "more harmonics may find one"
                )
        return LeastCostResult(
            coefficients, found is not None, outcome, "; ".join([*parts, end] if end else parts), details
        )
