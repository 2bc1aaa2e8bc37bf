"""Controls of many functions: what they cost grows with their number, and what cannot be done is said before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nhpocp import planning, provenance
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.legendre import Legendre
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.controls.projection import project
from nhpocp.flow.integrators import RungeKutta4
from nhpocp.flow.step_error import enough_steps
from nhpocp.outcome import Outcome
from nhpocp.provenance import reset_peak_memory
from nhpocp.solvers.continuation.continuation import Continuation
from nhpocp.solvers.continuation.step_rules import Adaptive
from nhpocp.solvers.metrics import Coordinates, L2Metric
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from tests.conftest import paper_problem

LARGE = [Fourier(1000), Legendre(1000), BSpline(3, 1000), PiecewiseConstant(6000)]
each_large_basis = pytest.mark.parametrize("basis", LARGE, ids=lambda basis: f"{basis.kind}-{basis.size}")


def over(basis):
    problem = paper_problem()
    return replace(
        problem, basis=basis, initial=project(problem.control(problem.initial), basis).coefficients
    )


def peak(work):
    """Megabytes that work takes at most, where the operating system counts them."""
    if not reset_peak_memory():
        return 0.0
    before = provenance.peak_memory() or 0.0
    work()
    return (provenance.peak_memory() or 0.0) - before


@each_large_basis
def test_a_large_control_costs_what_its_numbers_take(basis):
    """A single full matrix over 3 · 6000 coefficients would take 2.6 GB, one over 6000 functions 0.3 GB."""
    coefficients = np.random.default_rng(0).normal(size=(3, basis.size))
    control, times = Control(basis, coefficients), np.linspace(0, 1, 201)

    def work():
        assert np.isfinite(control(times)).all()
        assert control.effort > 0
        coordinates = Coordinates.natural(L2Metric(), basis, np.ones(3), 1.0)
        assert coordinates.length(coefficients.ravel()) ** 2 == pytest.approx(control.effort, rel=1e-9)

    assert peak(work) < 100


@pytest.mark.parametrize(
    "basis", [Legendre(100), BSpline(3, 1000), PiecewiseConstant(2000)], ids=lambda b: b.kind
)
def test_a_large_control_reaches_the_papers_goal(basis):
    found = []
    solver = Continuation(step_rule=Adaptive())
    assert peak(lambda: found.append(solver.find(over(basis)))) < 600
    assert found[0].outcome is Outcome.CONVERGED


def test_steps_that_cannot_resolve_a_basis_are_raised_and_it_is_said():
    """A hundred steps see nothing of sin(2π 100 t)."""
    assert enough_steps(100, Fourier(10)) == enough_steps(100, PiecewiseConstant(5000)) == 100
    assert enough_steps(100, Fourier(50)) == 500
    assert enough_steps(400, Fourier(50)) == 400
    solution = planning.solve(
        over(Fourier(50)), Continuation(step_rule=Adaptive(), integrator=RungeKutta4(100))
    )
    assert solution.converged, solution.message
    assert any("100 steps cannot resolve" in word and "500 were taken" in word for word in solution.warnings)
    fewer = planning.solve(over(Fourier(5)), Continuation(step_rule=Adaptive(), integrator=RungeKutta4(100)))
    assert fewer.warnings == []


@pytest.mark.parametrize("basis", [Fourier(1000), PiecewiseConstant(100_000)], ids=lambda basis: basis.kind)
def test_an_nlp_that_does_not_fit_is_refused_in_words(basis):
    start = np.zeros((3, basis.size))
    solution = MultipleShooting(over_basis=True).solve(replace(paper_problem(), basis=basis, initial=start))
    assert solution.outcome is Outcome.SOLVER_ERROR
    assert "GB of memory" in solution.message
    assert "take fewer functions" in solution.message


def test_a_search_that_does_not_fit_is_refused_in_words(monkeypatch):
    monkeypatch.setattr(provenance, "free_memory", lambda: 1e6)
    solver = Continuation(step_rule=Adaptive(), objective="effort")
    found = solver.find(over(PiecewiseConstant(100)))
    assert found.outcome is Outcome.SOLVER_ERROR
    assert "null space of 300 coefficients would take about" in found.message


def test_no_memory_is_an_ending_and_no_traceback(monkeypatch):
    def exhausted(self, coefficients):
        raise MemoryError("Unable to allocate 75 GiB")

    monkeypatch.setattr("nhpocp.solvers.continuation.evaluation.Evaluator.__call__", exhausted)
    found = Continuation().find(paper_problem())
    assert found.outcome is Outcome.SOLVER_ERROR
    assert "75 GiB" in found.message
