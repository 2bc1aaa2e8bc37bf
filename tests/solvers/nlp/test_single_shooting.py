"""Single shooting: the same programme with the path rolled out."""

import numpy as np
import pytest

from nhpocp.constraints.bound import Bound
from nhpocp.controls.fourier import Fourier
from nhpocp.errors import InvalidProblemError
from nhpocp.flow.compiled.kernels import Interpreted
from nhpocp.horizon import Horizon
from nhpocp.outcome import Outcome
from nhpocp.solvers.nlp.fatrop import Fatrop
from nhpocp.solvers.nlp.guesses import ProblemGuess, make_guess
from nhpocp.solvers.nlp.multiple_shooting import MultipleShooting
from nhpocp.solvers.nlp.single_shooting import EXACT_HESSIAN_UP_TO, SingleShooting
from nhpocp.solvers.nlp.staged_transcription import StagedTranscription
from tests.conftest import paper_problem


def both(problem, **settings):
    for kind in (SingleShooting, StagedTranscription):
        yield MultipleShooting(transcription=kind, **settings).solve(problem)


def test_the_rolled_out_path_satisfies_every_continuity_row():
    """Costs and rows of the two transcriptions are the same numbers where the path is the rolled-out one."""
    bounds = [Bound("leg_speed", "u", -50, 50), Bound("leg_length", "leg_lengths", 20, 60)]
    for basis in (None, Fourier(1)):
        problem = paper_problem(objective="leg_effort", horizon=Horizon(1.0, 0.5, 2.0))
        guess = make_guess(ProblemGuess(), problem, basis, 4, 0)
        single, multiple = (
            kind(problem, guess, basis, 4, 2, bounds, Interpreted())
            for kind in (SingleShooting, StagedTranscription)
        )
        x = single.pack(guess)
        cost, rows = (np.array(part).ravel() for part in single.functions["nlp"](x, []))
        same_cost, more = (
            np.array(part).ravel() for part in multiple.functions["nlp"](multiple.pack(single.unpack(x)), [])
        )
        kept = [i for i, row in enumerate(multiple.rows) if row.stated or row.name.startswith("goal")]
        assert cost == pytest.approx(same_cost, rel=1e-7)
        np.testing.assert_allclose(rows, more[kept], rtol=1e-5, atol=1e-5)
        assert [single.rows[i] for i in range(len(kept))] == [multiple.rows[i] for i in kept]
        others = np.delete(more, kept)
        assert np.abs(others).max() < 1e-5


@pytest.mark.parametrize("intervals", [6, 15])  # with and without an exact Hessian
def test_piecewise_constant_controls_agree_with_multiple_shooting(intervals):
    assert 3 * 6 <= EXACT_HESSIAN_UP_TO < 3 * 15
    one, other = both(paper_problem(), intervals=intervals, steps_per_interval=1)
    assert one.outcome is other.outcome is Outcome.CONVERGED
    assert one.details["objective_value"] == pytest.approx(other.details["objective_value"], rel=1e-6)
    np.testing.assert_allclose(one.control.coefficients, other.control.coefficients, atol=1e-3)
    assert one.settings["shooting"] == "single"
    assert one.details["costates"] is None
    assert one.details["optimality"]["stationarity"] < 1e-6


def test_fourier_controls_agree_with_multiple_shooting():
    one, other = both(paper_problem(), intervals=25, over_basis=True, steps_per_interval=2)
    assert one.details["objective_value"] == pytest.approx(other.details["objective_value"], rel=1e-6)
    np.testing.assert_allclose(one.control.coefficients, other.control.coefficients, atol=1e-5)


def test_fatrop_is_refused_in_words():
    with pytest.raises(InvalidProblemError, match="use plugin: ipopt"):
        MultipleShooting(intervals=4, transcription=SingleShooting, optimizer=Fatrop()).solve(paper_problem())
