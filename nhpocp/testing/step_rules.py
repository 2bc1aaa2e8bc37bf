"""Laws of step rules: they reach what is easy, end when nothing is left, and say of themselves what a file says."""

from __future__ import annotations

import json
from inspect import signature
from itertools import pairwise

from nhpocp import planning
from nhpocp.errors import expect
from nhpocp.outcome import Outcome
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import StepRule
from nhpocp.testing.laws import Law, apart, holds, run
from nhpocp.testing.usual import loop, straight


def check_step_rule(rule: StepRule) -> None:
    """Holds a step rule of the continuation against the laws that nhpocp's own keep.

    rule: an instance. It is tried on a goal that depends on the control linearly, and on one that takes a loop.
    Errors: `AssertionError` with the first law that does not hold, and why; `CallError` for what is no step rule.
    """
    expect(rule, StepRule, "a step rule, such as Adaptive()", "rule")
    run(rule.kind, LAWS, rule)


def its_settings_are_plain_data(rule: StepRule) -> None:
    settings = rule.settings()
    holds(json.loads(json.dumps(settings)) == settings, f"settings() gives {settings}, which JSON changes")
    takes = "gamma" in signature(type(rule)).parameters
    holds(
        takes or "gamma" not in settings, "settings() gives a gamma that a file cannot set; make it a field"
    )


def it_reaches_what_is_easy(rule: StepRule) -> None:
    for problem in (straight(), loop()):
        solution = planning.solve(problem, Continuation(step_rule=rule, max_iterations=1000))
        holds(solution.converged, f"{problem.name}: {solution.outcome.value}: {solution.message}")


def every_update_is_one_that_was_evaluated(rule: StepRule) -> None:
    solution = Continuation(step_rule=rule, max_iterations=1000).solve(loop())
    steps = [record["k"] for record in solution.iterations]
    holds(steps[0] == 0, f"the first record's k is {steps[0]}; expected 0")
    jumps = [after for before, after in pairwise(steps) if after > before + 1]
    holds(not jumps, f"the records go on with k = {jumps[:1]}: an update without an evaluation")
    holds(solution.evaluations == len(steps), f"{solution.evaluations} evaluations, {len(steps)} records")


def it_ends_when_nothing_is_left(rule: StepRule) -> None:
    for most in (0, 1):
        solution = Continuation(step_rule=rule, max_iterations=most, tolerance=1e-12).solve(loop())
        ends = solution.outcome in (Outcome.ITERATION_LIMIT, Outcome.CONVERGED)
        holds(ends, f"with {most} updates it ends as {solution.outcome.value}: {solution.message}")
        last = max(record["k"] for record in solution.iterations)
        holds(last <= most, f"{last} updates where {most} were allowed")


def it_does_the_same_again(rule: StepRule) -> None:
    """A rule is used for many searches: what it remembers of one must not change another."""
    solver = Continuation(step_rule=rule, max_iterations=1000)
    one, other = solver.solve(loop()), solver.solve(loop())
    first, second = ([record["error"] for record in solution.iterations] for solution in (one, other))
    words = "a second search takes other steps; keep what changes in `updates`, not in the rule"
    # it may be evaluated in other ways, which round differently
    holds(len(first) == len(second) and apart(second, first) < 1e-6, words)


LAWS: tuple[Law, ...] = (
    its_settings_are_plain_data,
    it_reaches_what_is_easy,
    every_update_is_one_that_was_evaluated,
    it_ends_when_nothing_is_left,
    it_does_the_same_again,
)
