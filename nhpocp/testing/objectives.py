"""Laws of objectives: integrals of their densities, growth with the duration, numbers and symbols alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nhpocp.arrays import Array
from nhpocp.controls.control import Control
from nhpocp.controls.registry import BASES
from nhpocp.controls.sequence import join
from nhpocp.errors import expect
from nhpocp.objectives.objective import ControlObjective, Objective, PathObjective
from nhpocp.objectives.registry import RESERVED
from nhpocp.problem import PlanningProblem
from nhpocp.systems.numeric import numeric_system
from nhpocp.systems.system import System
from nhpocp.testing.laws import Law, agree, holds, run
from nhpocp.testing.systems import random_control, random_state, standing
from nhpocp.testing.usual import one_that_has_it, that_have_it

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
SLOWER = 3.0


def check_objective(objective: Objective, systems: Sequence[System] = ()) -> None:
    """Holds an objective against the laws that nhpocp's own keep, over every basis that there is.

    objective: an instance of a subclass of `ControlObjective` or `PathObjective`. systems: some that have it; by
    default those of a few of nhpocp's own that do.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no objective.
    """
    expect(objective, Objective, "an objective, as an instance", "objective")
    run(objective.name, [it_says_what_it_is], objective)
    if isinstance(objective, ControlObjective):
        run(objective.name, LAWS_OF_THE_CONTROL, objective)
    for system in systems or list(that_have_it(objective)) or [one_that_has_it(objective)]:
        problem = standing(system)
        run(f"{objective.name} of {system.model}", [its_scale_is_a_number], objective, problem)
        if isinstance(objective, PathObjective):
            run(f"{objective.name} of {system.model}", LAWS_OF_A_PATH, objective, problem)


def controls(horizon: float) -> list[Control]:
    """A seeded control of two inputs over every basis."""
    random = np.random.default_rng(3)
    return [Control(basis(), random.normal(size=(2, basis().size)), horizon) for basis in BASES.values()]


def it_says_what_it_is(objective: Objective) -> None:
    kinds = isinstance(objective, ControlObjective) + isinstance(objective, PathObjective)
    holds(
        kinds == 1 or not objective.of_motion,
        "derive it from ControlObjective or from PathObjective, not from both",
    )
    for name in ("symbol", "meaning") if objective.of_motion else ("symbol",):
        holds(str(getattr(objective, name)).strip(), f"its {name} is empty")
    holds(objective.name.isidentifier(), f"{objective.name!r} is no name")
    holds(
        objective.name not in RESERVED, f"{objective.name} means something else in files; choose another name"
    )
    holds(
        objective.pace == int(objective.pace), f"its pace is {objective.pace!r}; expected a whole power of T"
    )
    softenings = objective.softenings
    ordered = (
        len(softenings) > 0 and min(softenings) >= 0 and list(softenings) == sorted(softenings, reverse=True)
    )
    holds(ordered, f"softenings are {softenings}; expected numbers ≥ 0 that fall")


def its_scale_is_a_number(objective: Objective, problem: PlanningProblem) -> None:
    scale = objective.scale(problem.scales)
    holds(np.isfinite(scale) and scale > 0, f"scale(scales) is {scale!r}; expected a number > 0")


# --- of the control alone ---------------------------------------------------------------------------------------------


def a_cost_of_the_control_is_the_integral_of_its_density(cost: ControlObjective) -> None:
    one = controls(1.0)
    for control in (*controls(2.5), join([one[0], one[1]])):
        if cost.lacking_control(control.basis):
            holds(
                cost.of_control(control) is None, f"it has a value over {control.basis.kind}, which lacks it"
            )
            continue
        inner = np.unique(np.concatenate([np.linspace(0, control.horizon, 33), control.breakpoints]))
        middles, halves = 0.5 * (inner[1:] + inner[:-1])[:, None], 0.5 * np.diff(inner)[:, None]
        density = cost.density(control, (middles + halves * NODES).ravel())
        integral = (halves * WEIGHTS).ravel() @ density
        agree(
            f"by gram over {control.basis.kind} it", cost.of_control(control), integral, 1e-9, abs(integral)
        )


def the_gram_matrix_grows_with_the_duration_as_the_pace_says(cost: ControlObjective) -> None:
    for control in controls(1.0):
        if not cost.lacking_control(control.basis):
            short, long = (np.asarray(cost.gram(control.basis, T)) for T in (1.0, SLOWER))
            expected = SLOWER ** (cost.pace + 2) * short
            agree(f"gram over {control.basis.kind} and T = {SLOWER:g}", long, expected, 1e-9)


# --- along a path -----------------------------------------------------------------------------------------------------


def numbers_and_symbols_cost_alike(cost: PathObjective, problem: PlanningProblem) -> None:
    here, scale = _samples(problem), problem.scale
    rest = (cost.softenings[-1] or 1e-3) * cost.scale(problem.scales)
    for what, integrand in (("integrand", cost.integrand), ("searched", _searched(cost, rest))):
        for state, control in here:
            number = np.asarray(integrand(problem.system, state, control, scale), dtype=float)
            holds(number.shape == (), f"{what} is of shape {number.shape}; expected a number")
            holds(np.isfinite(number) and number >= 0, f"{what} is {number}; expected a finite number ≥ 0")
            by_casadi = numeric_system(problem.system).along(integrand, state[None], control[None], scale)
            agree(f"{what} by CasADi", np.ravel(by_casadi), [float(number)], 1e-10)


def _searched(cost: PathObjective, rest: float) -> Callable[..., Any]:
    return lambda system, state, control, scale: cost.searched(system, state, control, scale, rest)


def it_grows_with_the_duration_as_the_pace_says(cost: PathObjective, problem: PlanningProblem) -> None:
    """Run k times slower a path costs k · c(x, u/k) where it cost c(x, u)."""
    if not problem.system.driftless:
        return
    for state, control in _samples(problem):
        fast, slow = (
            cost.integrand(problem.system, state, each, problem.scale) for each in (control, control / SLOWER)
        )
        expected = SLOWER**cost.pace * fast
        agree(f"run {SLOWER:g} times slower the cost", SLOWER * slow, expected, 1e-9, float(np.abs(expected)))


def what_is_searched_tends_to_it(cost: PathObjective, problem: PlanningProblem) -> None:
    for state, control in _samples(problem):
        integrand = float(cost.integrand(problem.system, state, control, problem.scale))
        searched = float(
            cost.searched(problem.system, state, control, problem.scale, 1e-9 * (integrand or 1.0))
        )
        agree("searched(…, rest) with hardly any rest", searched, integrand, 1e-6, integrand)


def _samples(problem: PlanningProblem) -> list[tuple[Array, Array]]:
    times = np.array([0.2, 0.5, 0.8])
    return [(random_state(problem, seed), random_control(problem, seed)(times)[seed]) for seed in range(3)]


LAWS_OF_THE_CONTROL: tuple[Law, ...] = (
    a_cost_of_the_control_is_the_integral_of_its_density,
    the_gram_matrix_grows_with_the_duration_as_the_pace_says,
)
LAWS_OF_A_PATH: tuple[Law, ...] = (
    numbers_and_symbols_cost_alike,
    it_grows_with_the_duration_as_the_pace_says,
    what_is_searched_tends_to_it,
)
