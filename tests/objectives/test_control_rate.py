"""The rate of the control as an objective: both methods lower it, and controls that jump are refused."""

import numpy as np
import pytest

import nhpocp
from nhpocp.controls.bspline import BSpline
from nhpocp.controls.control import Control
from nhpocp.controls.fourier import Fourier
from nhpocp.controls.piecewise_constant import PiecewiseConstant
from nhpocp.errors import InvalidProblemError
from nhpocp.objectives.control_rate import ControlRate
from nhpocp.problem_file import read_text
from nhpocp.problem_file.building import build_solver
from tests.conftest import paper_problem


def test_it_is_known_in_closed_form():
    rate = ControlRate().of_control(Control(Fourier(1), [[2.0, 3.0, 0.0]], 2.0))  # 3 sin πt
    assert rate == pytest.approx(9 * np.pi**2)


@pytest.mark.parametrize(
    ("basis", "jumps"), [(BSpline(0, 4), True), (BSpline(1, 4), False), (PiecewiseConstant(3), True)]
)
def test_it_is_refused_where_controls_jump(basis, jumps):
    assert bool(ControlRate().lacking_control(basis)) is jumps
    if jumps:
        problem = paper_problem(objective="control_rate", basis=basis, initial=None)
        with pytest.raises(InvalidProblemError, match="controls jump"):
            nhpocp.solve(problem)


def test_a_file_that_asks_for_it_over_steps_is_answered_at_its_line():
    text = (
        "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {x: 1, y: 1, theta: 0}\n"
        "control: {basis: piecewise_constant}\nobjective: control_rate\n"
    )
    with pytest.raises(InvalidProblemError, match="piecewise_constant controls jump") as caught:
        read_text(text)
    assert caught.value.path == "objective"
    with pytest.raises(InvalidProblemError, match="write control: basis"):
        nhpocp.solve(paper_problem(objective="control_rate"), build_solver("nlp", {"intervals": 5}))


def test_both_methods_agree_on_a_least_one():
    """From its own start the Jacobian method ends at another stationary point, of twice the cost."""
    problem = paper_problem(objective="control_rate", pictures=False)
    nlp = nhpocp.solve(problem, build_solver("nlp", {"intervals": 20, "control": "basis"}))
    assert nlp.converged
    settings = {"step_rule": "auto", "objective": "control_rate", "tolerance": 1e-6}
    begun = problem.with_(initial=nlp.control.coefficients)
    jacobian = nhpocp.solve(begun, build_solver("jacobian", settings))
    assert jacobian.converged
    assert "at a stationary point" in jacobian.message
    assert jacobian.costs["control_rate"] == pytest.approx(nlp.costs["control_rate"], rel=1e-3)
    assert nlp.costs["control_rate"] == pytest.approx(55.166, rel=1e-4)
