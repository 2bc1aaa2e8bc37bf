"""`step_rule: auto`: what it tries, in order, and what it says of it."""

import numpy as np
from conftest import paper_problem, yaw

from nhpocp import planning, so3
from nhpocp.solution import Outcome
from nhpocp.solution_folder import load_solution, save_solution
from nhpocp.solvers import strategies
from nhpocp.solvers.continuation import Continuation
from nhpocp.solvers.step_rules import Euler
from nhpocp.solvers.strategies import Auto
from nhpocp.verification import verify


def test_the_direct_way_is_enough_for_the_paper(problem):
    solution = planning.solve(problem, Auto())
    assert solution.converged
    assert solution.evaluations <= 10
    assert [entry["way"] for entry in solution.details["tried"]] == ["the given start"]
    assert solution.settings["step_rule"] == "auto"


def test_a_start_without_rank_is_left_for_a_seeded_one():
    """Λ0 = 0 moves the end point in three directions only."""
    solution = planning.solve(paper_problem(initial=np.zeros((3, 5))), Auto())
    assert solution.converged
    tried = solution.details["tried"]
    assert tried[0]["outcome"] == "rank_deficient"
    assert tried[-1]["way"].startswith("seeded start")
    assert "after 1 other tr" in solution.message
    assert {record["attempt"] for record in solution.iterations} == {0, 1}


def test_manoeuvres_in_sequence_are_joined_and_stored(tmp_path):
    """Two plans, one after the other, as one control of basis `sequence`, its waste taken out."""
    tilted = so3.exp(np.array([0.1, -0.05, 0.0])) @ yaw(-np.pi / 3)
    problem = paper_problem("normal75", goal={"position": [1.0, -1.0, 28.0], "orientation": tilted})
    found = Auto()._manoeuvres(problem, 2, None)
    assert found.outcome is Outcome.CONVERGED
    assert found.control.basis.kind == "sequence"
    assert len(found.control.basis.bases) == 2
    assert found.control.horizon == 1.0
    verdict = verify(found)
    assert verdict.ok, verdict.reasons
    back = load_solution(save_solution(found.judged(verdict), tmp_path / "sequence"))
    assert back.converged
    np.testing.assert_allclose(
        back.control(np.linspace(0, 1, 11)), found.control(np.linspace(0, 1, 11)), atol=1e-12
    )


def test_what_is_not_reached_is_said_with_everything_tried(monkeypatch):
    """Two steps of γ = 0.001 reach nothing; no try may claim it."""
    for name, value in {"PIECES": (1, 2), "SEEDS": 2, "HALVINGS": 2}.items():
        monkeypatch.setattr(strategies, name, value)
    lame = Auto(Continuation(step_rule=Euler(1e-3), max_iterations=2), restarts=1)
    solution = planning.solve(paper_problem(), lame)
    assert solution.outcome is Outcome.NOT_REACHED
    for way in ("the given start: iteration_limit", "seeded start 1: iteration_limit", "walking the goal"):
        assert way in solution.message
    assert solution.verdict.error > 1
