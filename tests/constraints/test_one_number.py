"""Bounds on vectors of one number, which CasADi takes for scalars, by every way of keeping them."""

from __future__ import annotations

import pytest

import nhpocp
from nhpocp.problem_file import parse_problem

TEXT = """
nhpocp: 1
name: one
system: {model: double_integrator, n: 1}
start: {q: [-1], q_dot: [0]}
goal: {q: [0], q_dot: [0]}
control: {basis: legendre, degree: 4}
constraints: {control: [[-5.5, 5.5]], state: {q: [[-1.1], [0.1]], q_dot: [[-1], [2]]}}
solvers:
  jacobian: {objective: effort}
  nlp: {intervals: 10}
"""


@pytest.mark.parametrize(
    ("solver", "changes"),
    [
        ("jacobian", []),
        ("nlp", []),
        ("nlp", ["solvers.nlp.shooting=single"]),
        ("nlp", ["solvers.nlp.plugin=fatrop"]),
    ],
)
def test_they_are_kept(solver, changes):
    problem = parse_problem(TEXT, overrides=changes)
    solution = nhpocp.solve(problem, solver)
    assert solution.converged, solution.message
    assert [report.bound.label for report in solution.verdict.bounds] == ["control", "state.q", "state.q_dot"]
    assert 12 < solution.costs["effort"] < 12.6  # 12 without the bound on u
