"""Bounds on the angles of the legs' joints, from the file to both methods."""

import numpy as np
import pytest

import nhpocp
from nhpocp.constraints.registry import bounds_of
from nhpocp.errors import InvalidProblemError
from nhpocp.problem_file import dump_problem, parse_problem, read_text
from nhpocp.problem_file.building import build_solver
from tests.conftest import paper_problem

TEXT = dump_problem(paper_problem(pictures=False))
METHODS = {
    "jacobian": {"step_rule": "adaptive", "objective": "effort"},
    "nlp": {"intervals": 20},
}


def test_a_file_bounds_an_angle_of_every_leg_and_is_written_again():
    problem = parse_problem(
        TEXT + "constraints: {joint_angle: {theta3: [-40 deg, 40 deg], theta1: [null, 1]}}\n"
    )
    third, first = problem.bounds
    np.testing.assert_allclose(third.upper, [np.inf, np.inf, np.radians(40), np.inf])
    assert (first.label, first.quantity) == ("joint_angle.theta1", "joint_angles")
    again = parse_problem(dump_problem(problem.with_()))
    for one, other in zip(problem.bounds, again.bounds, strict=True):
        np.testing.assert_allclose([one.lower, one.upper], [other.lower, other.upper])


def test_what_it_does_not_know_is_refused_at_its_place():
    for value in ("[-1, 1]", "3"):  # the name comes before the form
        with pytest.raises(InvalidProblemError) as refused:
            read_text(TEXT + f"constraints: {{joint_angle: {{kone: {value}}}}}\n")
        told = "constraints.joint_angle.kone: unknown key; did you mean 'cone'?"
        assert [str(each).partition(": ")[2] for each in refused.value.each] == [told]
        with pytest.raises(InvalidProblemError) as refused:
            paper_problem(bounds={"joint_angle": {"kone": value}})
        assert str(refused.value) == told
    with pytest.raises(InvalidProblemError, match="unicycle has no joint angles"):
        read_text(
            "nhpocp: 1\nsystem: {model: unicycle}\nstart: {x: 0, y: 0, theta: 0}\ngoal: {x: 1, y: 1, theta: 0}\n"
            "constraints: {joint_angle: {theta3: [-1, 1]}}\n"
        )


@pytest.mark.parametrize("method", METHODS)
def test_both_methods_keep_it(method):
    problem, solver = paper_problem(pictures=False), build_solver(method, METHODS[method])
    free = nhpocp.solve(problem, solver)
    ends = np.asarray(free.trajectory["joint_angles"])[[0, -1], :, 3].max()
    most = np.asarray(free.trajectory["joint_angles"])[:, :, 3].max()
    assert most > ends + 0.005  # the bound between them is active
    limit = 0.5 * (most + ends)
    bounds = bounds_of({"joint_angle": {"theta4": [None, limit]}}, problem.system)
    bounded = nhpocp.solve(problem.with_(bounds=bounds), solver)
    assert bounded.converged
    assert np.asarray(bounded.trajectory["joint_angles"])[:, :, 3].max() <= limit + 1e-3
    assert bounded.control.effort > free.control.effort


@pytest.mark.parametrize(
    ("written", "told"), [("15 deg", "above 15 deg"), ("0.26179938779914946", "above 0.261799")]
)
def test_what_was_written_in_degrees_is_told_in_degrees(written, told):
    problem = parse_problem(TEXT + f"constraints: {{joint_angle: {{theta3: {{max: {written}}}}}}}\n")
    message = nhpocp.solve(problem).message
    assert told in message
    assert ("112.6 deg" in message or " deg, above" in message) == ("deg" in written)
    in_python = paper_problem(bounds={"joint_angle": {"theta3": {"max": 15 * nhpocp.deg}}})
    assert "above 15 deg" in nhpocp.solve(in_python).message


def test_rounding_is_told_as_zero():
    """At the start a leg is at its direction there, but for rounding."""
    file = read_text(TEXT + "constraints: {joint_angle: {cone: [12 deg, 40 deg]}}\n")
    assert (
        "start: joint_angle.cone[0] is 0 deg, outside [12 deg, 40 deg]; no plan can begin there"
        in file.warnings
    )
