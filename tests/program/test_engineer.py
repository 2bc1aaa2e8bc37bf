"""A design engineer's robot in metres: from a file to the least time, and to a table of set points at 1 kHz."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from nhpocp.cli.entry import status

STROKE, MOTOR = (0.3, 0.6), 0.15  # m, m/s
ROBOT = f"""\
nhpocp: 1
name: engineer
system: {{model: three_upu, base_radius: 0.15, platform_radius: 0.075, roller_tilt: 75 deg}}
start: {{position: [0, 0, 0.35], orientation: {{rpy: [0, 0, -30 deg]}}}}
goal: {{position: [0, 0, 0.5], orientation: {{rpy: [0, 0, -45 deg]}}}}
horizon: {{min: 0.5, max: 4, initial: 4}}
objective: time
error_length: 0.15
constraints: {{leg_length: {list(STROKE)}, leg_speed: {{max: {MOTOR}}}, clearance: 0.05}}
solvers:
  nlp: {{intervals: 10, initial: jacobian, tolerance: 1e-4}}
output: {{pictures: false}}
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    file = tmp_path_factory.mktemp("engineer") / "engineer.yaml"
    file.write_text(ROBOT)
    return file


def solved(robot, solver, *overrides):
    """Its solution.json and the rows of its trajectory.csv by column."""
    folder = robot.parent / solver
    words = [word for override in overrides for word in ("--set", override)]
    assert status(["solve", str(robot), "--solver", solver, *words, "-o", str(folder)]) == 0
    with open(folder / "trajectory.csv", encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return json.loads((folder / "solution.json").read_text()), dict(
        zip(head, np.array(rows, dtype=float).T, strict=True)
    )


def legs(columns, name):
    return np.array([values for head, values in columns.items() if head.startswith(name)])


def test_the_least_time_is_that_of_motors_at_their_limit(robot):
    solution, columns = solved(robot, "nlp", "constraints.clearance=null")  # it takes no part
    assert 0.5 < columns["t"][-1] < 4
    assert solution["constraints"]["leg_speed"]["ok"]
    assert np.abs(legs(columns, "u")).max() == pytest.approx(MOTOR, rel=1e-2)
    assert solution["crossings"] == []  # motors can drive it
    assert columns["sigma_w"].min() > 0.05


def test_set_points_at_1_khz_are_a_motion_that_the_motors_can_make(robot):
    _, columns = solved(robot, "jacobian", "horizon=4", "objective=leg_effort", "output.samples=4001")
    np.testing.assert_allclose(np.diff(columns["t"]), 1e-3, rtol=1e-9)
    lengths, speeds = legs(columns, "leg_lengths"), legs(columns, "u")
    assert lengths.shape == speeds.shape == (3, 4001)
    assert np.abs(speeds).max() <= MOTOR * 1.001
    assert STROKE[0] * 0.999 <= lengths.min() <= lengths.max() <= STROKE[1] * 1.001
    moved = np.cumsum(0.5e-3 * (speeds[:, 1:] + speeds[:, :-1]), axis=1)
    np.testing.assert_allclose(lengths[:, :1] + moved, lengths[:, 1:], atol=1e-6)
