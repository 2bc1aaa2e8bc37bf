"""Verdicts in company: what is verified together gets the verdict that it gets alone."""

from __future__ import annotations

import numpy as np
import pytest

from nhpocp import planning
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.outcome import Outcome
from nhpocp.problem import PlanningProblem
from nhpocp.solvers.claimed import claimed
from nhpocp.systems.numeric import NumericSystem
from nhpocp.systems.unicycle import Unicycle
from nhpocp.verification import company, verify, verify_many
from tests.conftest import PAPER_START, paper_problem


def claims_of(problem, tables, solver="jacobian"):
    """Solutions that claim to have reached the goal by these controls."""
    method = planning.own_solver(problem, solver)
    return [
        claimed(problem, method, Control(Fourier(2), table, 1.0), Outcome.CONVERGED, "Said so.", 0.0)
        for table in tables
    ]


@pytest.fixture(scope="module")
def mixed():
    """Five controls of the paper's robot: three plain ones, one into a singularity and one that blows up."""
    problem = paper_problem("default")
    wild = np.zeros((3, 5))
    wild[0, 1] = 60.0
    tables = [PAPER_START, 0.5 * PAPER_START, wild, -0.3 * PAPER_START, 1e3 * wild]
    return claims_of(problem, tables)


def test_verdicts_are_those_of_each_alone(mixed):
    together, alone = verify_many(mixed), [verify(solution) for solution in mixed]
    assert any("the replay stopped" in " ".join(verdict.reasons) for verdict in alone)
    for one, other in zip(together, alone, strict=True):
        assert one.ok == other.ok
        assert len(one.reasons) == len(other.reasons)
        assert len(one.warnings) == len(other.warnings)
        assert [c.matrix for c in one.crossings] == [c.matrix for c in other.crossings]
        np.testing.assert_allclose(one.reached, other.reached, rtol=1e-6)
        if other.error is not None:
            np.testing.assert_allclose(one.error, other.error, rtol=1e-9)
            assert (one.original is None) == (other.original is None)
            if other.original is not None and other.original.error is not None:
                np.testing.assert_allclose(one.original.error, other.original.error, rtol=1e-8)


def test_paths_in_company_are_those_alone_to_the_tolerance(mixed):
    problem = mixed[0].problem
    calm = [mixed[i].control for i in (0, 1, 3)]
    numeric, starts = NumericSystem(problem.system), [problem.start_point] * 3
    paths = company.replays(numeric, calm, starts, problem.scales.points)
    times = np.linspace(0.0, 1.0, 41)
    assert all(path.times is not None and len(path.times) == len(paths[0].times) for path in paths)
    for path, control in zip(paths, calm, strict=True):
        (alone,) = company.replays(numeric, [control], starts[:1], problem.scales.points)
        np.testing.assert_allclose(path(times), alone(times), atol=1e-9)
    joined = company.beside(paths)
    expected = np.hstack([path(times) for path in paths])
    np.testing.assert_array_equal(joined(times), expected)


def test_only_what_is_alike_goes_together_and_the_order_stays(mixed):
    car = PlanningProblem(
        system=Unicycle(), start={"x": 0, "y": 0, "theta": 0}, goal={"x": 1, "y": 0, "theta": 0}
    )
    ahead = np.zeros((2, 5))
    ahead[0, 0] = 1.0
    other = claims_of(car, [ahead, 0.5 * ahead])
    verdicts = verify_many([other[0], mixed[0], other[1], mixed[1]])
    assert [verdict.ok for verdict in verdicts] == [True, False, False, False]
    assert verdicts[0].error == pytest.approx(0.0, abs=1e-9)
    assert verdicts[2].error == pytest.approx(0.5, abs=1e-9)
