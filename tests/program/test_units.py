"""`units` of a problem file: words in pictures, tables and pages, and nowhere a number that is another for them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import nhpocp
from nhpocp.comparison import Entry
from nhpocp.problem_file import dump_problem, parse_problem
from nhpocp.views import animation, report
from nhpocp.views.figures import FIGURES
from tests.conftest import paper_problem

METRES = {"length": "m", "time": "s"}


@pytest.fixture(scope="module")
def plan() -> nhpocp.Solution:
    problem = paper_problem(units=METRES, bounds={"leg_length": [20, 60]})
    return nhpocp.solve(problem, nhpocp.Continuation(step_rule=nhpocp.Euler(1.0)))


def labels(figure: Any) -> list[str]:
    return [label.get_text() for axes in figure.axes for label in (axes.xaxis.label, axes.yaxis.label)]


def test_pictures_name_the_units(plan: nhpocp.Solution) -> None:
    assert labels(FIGURES["controls"](plan)) == [
        *("time $t$ [s]", "control $v$ [rad/s]", "time $t$ [s]", "leg length $l$ [m]")
    ]
    assert labels(FIGURES["relative_pose"](plan))[1] == "position error $p - p_d$ [m]"
    assert FIGURES["robot"](plan).axes[0].get_xlabel() == "$x$ [m]"


def test_pages_name_the_units(plan: nhpocp.Solution) -> None:
    entries = [Entry(plan, "jacobian")]
    page = animation.render(entries)
    assert '"time_unit":"s"' in page
    assert "[rad/s]" in page
    assert "Lengths in m, times in s, angles in radians." in report.render(nhpocp.Comparison(entries))


def test_columns_are_documented(plan: nhpocp.Solution, tmp_path: Path) -> None:
    folder = nhpocp.save_solution(plan, tmp_path / "plan")
    with (folder / "columns.csv").open(newline="", encoding="utf-8") as stream:
        rows = {row["column"]: row for row in csv.DictReader(stream)}
    with (folder / "trajectory.csv").open(newline="", encoding="utf-8") as stream:
        assert list(rows) == next(csv.reader(stream))
    units = {name: row["unit"] for name, row in rows.items()}
    expected = {
        "t": "s",
        "position_1": "m",
        "v_2": "rad/s",
        "u_3": "m/s",
        "leg_lengths_1": "m",
        "theta_1_2": "rad",
    }
    expected |= {"orientation_1_1": "", "sigma_s": "", "e_p_1": "m", "r_1": "rad", "yaw": "rad"}
    assert {name: units[name] for name in expected} == expected
    assert rows["theta_1_2"]["entry"] == "joint_angles[0][1]"
    assert rows["theta_1_2"]["meaning"] == "joint angle"
    again = nhpocp.load_solution(folder)
    assert again.problem.units == nhpocp.Units("m", "s")
    assert nhpocp.verify(again).ok


def test_nothing_is_converted(plan: nhpocp.Solution) -> None:
    plain = nhpocp.solve(plan.problem.with_(units={}), nhpocp.Continuation(step_rule=nhpocp.Euler(1.0)))
    np.testing.assert_array_equal(plain.control.coefficients, plan.control.coefficients)
    assert labels(FIGURES["controls"](plain))[:2] == ["time $t$ [–]", "control $v$ [rad per unit time]"]


def test_a_file_says_them(plan: nhpocp.Solution) -> None:
    text = dump_problem(plan.problem)
    assert "units: {length: m, time: s}" in text
    assert parse_problem(text).units == plan.problem.units
    assert parse_problem(text, None, ["units={length: µm, time: 1/s}"]).units == nhpocp.Units("µm", "1/s")


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"lenght": "m"}, "did you mean 'length'?"),
        ({"length": 1}, "expected a text"),
        ({"length": "$m$"}, "expected a unit's name"),
        ({"time": ""}, "expected a unit's name"),
        ({"time": "s] [kg"}, "expected a unit's name"),
        ({"time": "second by second"}, "expected a unit's name"),
    ],
)
def test_what_is_no_unit_is_refused(units: dict[str, Any], words: str) -> None:
    with pytest.raises(nhpocp.InvalidProblemError, match="units"):
        nhpocp.Units.of(units)
    with pytest.raises(nhpocp.InvalidProblemError) as refused:
        paper_problem(units=units)
    assert words in str(refused.value)
    with pytest.raises(nhpocp.InvalidProblemError) as refused:
        parse_problem(dump_problem(paper_problem()), None, [f"units={units!r}"])
    assert words.split("'")[0].split(" a ")[0] in str(refused.value)
