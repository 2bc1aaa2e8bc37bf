"""Laws of whole families: what is announced in one line is what it says, and whatever follows from it agrees."""

import numpy as np
import pytest

from nhpocp.constraints.registry import KINDS, block_of, bounds_of
from nhpocp.controls.control import Control
from nhpocp.controls.registry import BASES
from nhpocp.controls.sequence import join
from nhpocp.errors import InvalidProblemError
from nhpocp.objectives.objective import ControlObjective
from nhpocp.objectives.registry import OBJECTIVES, exact_costs
from nhpocp.problem_file.building import build_solver
from nhpocp.solvers.continuation.settings import INVERSES, METRICS, STEP_RULES
from nhpocp.solvers.nlp.settings import GUESSES, OPTIMIZERS
from nhpocp.solvers.registry import SOLVERS
from tests.conftest import paper_problem

OF_THE_CONTROL = [cost for cost in OBJECTIVES.values() if isinstance(cost, ControlObjective)]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def test_every_member_is_called_as_it_is_announced():
    assert {name: cost.name for name, cost in OBJECTIVES.items()} == {name: name for name in OBJECTIVES}
    assert {key: kind.key for key, kind in KINDS.items()} == {key: key for key in KINDS}
    assert {name: build_solver(name).name for name in SOLVERS} == {name: name for name in SOLVERS}
    for family in (BASES, STEP_RULES, INVERSES, METRICS, GUESSES, OPTIMIZERS):
        assert {name: member.kind for name, member in family.items()} == {name: name for name in family}


def controls(horizon):
    random = np.random.default_rng(3)
    return [Control(basis(), random.normal(size=(2, basis().size)), horizon) for basis in BASES.values()]


@pytest.mark.parametrize("cost", OF_THE_CONTROL, ids=lambda cost: cost.name)
def test_a_cost_of_the_control_is_the_integral_of_its_density(cost):
    one = controls(1.0)
    for control in (*controls(2.5), join([one[0], one[1]])):
        if cost.lacking_control(control.basis):
            assert cost.of_control(control) is None
            assert cost.name not in exact_costs(control)
            continue
        inner = np.unique(np.concatenate([np.linspace(0, control.horizon, 33), control.breakpoints]))
        middles, halves = 0.5 * (inner[1:] + inner[:-1])[:, None], 0.5 * np.diff(inner)[:, None]
        density = cost.density(control, (middles + halves * NODES).ravel())
        assert cost.of_control(control) == pytest.approx((halves * WEIGHTS).ravel() @ density, rel=1e-9)


@pytest.mark.parametrize("cost", OF_THE_CONTROL, ids=lambda cost: cost.name)
def test_the_gram_matrix_grows_with_the_duration_as_the_pace_says(cost):
    for control in controls(1.0):
        if not cost.lacking_control(control.basis):
            short, long = (np.asarray(cost.gram(control.basis, T)) for T in (1.0, 3.0))
            np.testing.assert_allclose(long, 3.0 ** (cost.pace + 2) * short, rtol=1e-9, atol=1e-9)


def test_every_kind_of_constraint_is_read_as_it_is_written():
    system = paper_problem().system
    start = {"position": [0, 0, 25]}
    given = {key: shown for key, kind in KINDS.items() if (shown := kind.shown(system, start)) is not None}
    assert set(given) == set(KINDS)
    bounds = bounds_of(given, system)
    again = bounds_of(block_of(bounds, system), system)
    for one, other in zip(bounds, again, strict=True):
        assert (one.label, one.quantity) == (other.label, other.quantity)
        np.testing.assert_array_equal(*np.broadcast_arrays(one.lower, other.lower))
        np.testing.assert_array_equal(*np.broadcast_arrays(one.upper, other.upper))


def test_unknown_solvers_are_answered_with_those_that_there_are():
    with pytest.raises(InvalidProblemError, match=", ".join(SOLVERS)):
        build_solver("simplex")
