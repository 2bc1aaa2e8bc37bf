"""The report of a study: the numbers that its rows give, bounded, escaped, self-contained, whatever the axes are."""

from __future__ import annotations

import json
import re
import signal
import statistics
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nhpocp.errors import InvalidProblemError
from nhpocp.study import charting
from nhpocp.study.report import write_report
from nhpocp.study.store import Store
from nhpocp.study.surveying import survey
from nhpocp.survey import Axis, Map, Points, Profiles, shift_of
from nhpocp.views import study_words as words
from nhpocp.views.latex_table import study_table
from nhpocp.views.study_charts import pairs
from nhpocp.views.study_report import render
from tests.conftest import axe_violations
from tests.study.made_up import BOTH, DRAWN, ROBOT, TILTS, store_of
from tests.study.test_sweep import ran
from tests.views.test_report import Page

SCRIPT = "<script>alert('you')</script>"


def surveyed(file: Path):
    with Store.open(file) as store:
        return survey(store)


@pytest.fixture(scope="module")
def tilts(tmp_path_factory):
    """(survey, rows) of a study over three axes by two solvers."""
    file, _, rows = store_of(ROBOT + TILTS + BOTH, tmp_path_factory.mktemp("tilts") / "study.sqlite")
    return surveyed(file), rows


@pytest.fixture(scope="module")
def page(tilts):
    return render(tilts[0])


# --- the numbers ------------------------------------------------------------------------------------------------------


def test_every_run_is_counted_once(tilts):
    found, rows = tilts
    assert (found.runs, found.stored, found.solved) == (120, 120, sum(row["converged"] for row in rows))
    for label in found.solvers:
        mine = [row["converged"] for row in rows if row["variant"] == label]
        assert found.tallies[label] == (60, sum(mine))
    assert sum(some.count for some in found.failures) == found.stored - found.solved
    assert found.outcomes[0] == "converged"
    assert set(found.outcomes) == {row["outcome"] for row in rows}
    assert (found.processor, found.workers) == (pytest.approx(sum(r["solve_s"] + 0.1 for r in rows)), (2,))


def test_cells_hold_the_runs_of_their_levels(tilts):
    found, rows = tilts
    chart = found.chart
    assert isinstance(chart, Map)
    paths = [chart.columns.path, chart.rows.path, chart.panels.path]
    assert paths == ["goal.orientation.rpy[0]", "goal.orientation.rpy[1]", "goal.position[2]"]
    assert chart.single
    for row in rows:
        values = json.loads(row["parameters"])
        column, line, panel = (
            axis.levels.index(values[axis.path]) for axis in (chart.columns, chart.rows, chart.panels)
        )
        cells, cell = chart.cells[row["variant"]], (panel, line, column)
        assert (cells.stored[cell], cells.solved[cell]) == (1, row["converged"])
        assert found.outcomes[cells.outcome[cell]] == row["outcome"]
        for name, values in cells.medians.items():
            assert values[cell] == (row[name] if row["converged"] else pytest.approx(np.nan, nan_ok=True))


@pytest.mark.parametrize("cells", [60, 2])
def test_cells_of_many_runs_have_shares_and_medians(tmp_path, monkeypatch, cells):
    monkeypatch.setattr(charting, "PANELS", 1)
    monkeypatch.setattr(charting, "CELLS", cells)
    file, _, rows = store_of(ROBOT + TILTS, tmp_path / "study.sqlite")
    chart = surveyed(file).chart
    assert (chart.panels, [axis.path for axis in chart.beside]) == (None, ["goal.position[2]"])
    assert not chart.single
    (found,) = chart.cells.values()
    together: dict[tuple[int, int], list] = {}
    for row in rows:
        values = json.loads(row["parameters"])
        line, column = (
            axis.levels.index(values[axis.path]) // group
            for axis, group in zip((chart.rows, chart.columns), chart.group[::-1], strict=True)
        )
        together.setdefault((line, column), []).append(row)
    assert found.stored[0].size == len(together)
    for cell, mine in together.items():
        efforts = [row["effort"] for row in mine if row["converged"]]
        assert (found.stored[0][cell], found.solved[0][cell]) == (len(mine), len(efforts))
        assert found.medians["effort"][0][cell] == pytest.approx(statistics.median(efforts))


def test_distributions_are_of_the_solved_runs(tilts):
    found, rows = tilts
    for name, column in (("effort", "effort"), ("seconds", "solve_s"), ("evaluations", "evaluations")):
        for label, spread in found.spreads[name].items():
            values = [row[column] for row in rows if row["variant"] == label and row["converged"]]
            assert (spread.count, spread.at(0.0), spread.at(1.0)) == (len(values), min(values), max(values))
            assert spread.at(0.5) == pytest.approx(statistics.median(values))
    label, spread = next(iter(found.spreads["sigma_w"].items()))
    mine = [json.loads(r["margins"])["sigma_w"] for r in rows if r["variant"] == label and r["converged"]]
    assert spread.at(0.0) == min(mine)


VALUES = st.lists(
    st.tuples(*[st.none() | st.floats(1e-3, 1e3)] * 3),
    min_size=1,
    max_size=12,
)


@settings(max_examples=40, deadline=None)
@given(VALUES, st.floats(1.0, 900.0))
def test_profiles_by_their_definition(points, ratio):
    profiles = Profiles(("a", "b", "c"), shift=0.5)
    for point in points:
        profiles.add(point)
    place = int(np.searchsorted(profiles.ratios, ratio, side="right")) - 1
    below, above = profiles.ratios[place] * (1 - 1e-9), profiles.ratios[place] * (1 + 1e-3)
    for k in range(3):
        ratios = [
            point[k] / min(v for v in point if v is not None) for point in points if point[k] is not None
        ]
        least, most = (sum(r <= tau for r in ratios) / len(points) for tau in (below, above))
        assert least - 1e-12 <= profiles.shares[k, place] <= most + 1e-12
    whole = [point for point in points if None not in point]
    assert profiles.shared == len(whole)
    if whole:
        shifted = [
            np.exp(np.mean(np.log(np.array(values) + 0.5))) - 0.5 for values in zip(*whole, strict=True)
        ]
        assert profiles.means == pytest.approx(shifted)
    else:
        assert profiles.means == [None] * 3


def test_shifts_are_round_and_below_the_medians():
    assert [shift_of(values) for values in ([0.21, 3.0], [5.0, None], [None], [0.0])] == [0.1, 1.0, 1.0, 1.0]


def test_points_that_a_solver_has_not_run_are_in_no_profile(tmp_path):
    file, _, rows = store_of(ROBOT + TILTS + BOTH, tmp_path / "study.sqlite", runs=9)
    found = surveyed(file)
    assert {profile.points for profile in found.profiles.values()} == {4}
    assert "111 runs are not stored yet" in " ".join(words.verdict(found))
    assert len(rows) == 9


def test_failures_name_what_was_broken_and_a_run_that_comes_back(tilts):
    found, rows = tilts
    told = {(some.outcome, some.broken): some for some in found.failures}
    assert set(told) == {
        ("infeasible", ("leg_length",)),
        ("singular_s", ("det S",)),
        ("stagnated", ()),
        ("not_verified", ("leg_length",)),
    }
    for (outcome, _), some in told.items():
        mine = [row for row in rows if row["outcome"] == outcome]
        assert (some.count, some.run, some.kept) == (len(mine), mine[0]["run"], outcome != "stagnated")
    counts = [some.count for some in found.failures]
    assert counts == sorted(counts, reverse=True)


# --- axes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "label", "level"),
    [
        ("goal.orientation.rpy[1]: [10 deg, -pi/6]", "goal pitch [°]", "10"),
        ("goal.orientation.rpy[1]: [0.1, 0.2]", "goal pitch [rad]", "0.1"),
        ("goal.position[2]: [30, 31]", "goal position $p_{3}$ [length]", "30"),
        ("system.roller_tilt: {linspace: [70 deg, 80 deg, 2]}", "roller tilt [°]", "70"),
        ("solvers.jacobian.gamma: {logspace: [0.1, 1, 2]}", r"$\gamma$", "0.1"),
        ("solvers.jacobian.inverse: [damped, transpose]", "inverse", "damped"),
        ("horizon.min: [1, 2]", "horizon min", "1"),
        ("constraints.leg_length: [[24, 46], [20, 60]]", "leg length", "[24, 46]"),
    ],
)
def test_axes_are_called_as_their_study_writes_them(tmp_path, axis, label, level):
    text = ROBOT.replace("    constraints", "    horizon: {min: 0.5, max: 4, initial: 2}\n    constraints")
    file, _, _ = store_of(f"{text}  axes:\n    {axis}\n", tmp_path / "study.sqlite")
    found = surveyed(file)
    (made,) = found.axes
    assert words.axis_words(made, found.problem) == label
    assert words.level_words(made, made.levels[0]) == level
    assert made.logarithmic is ("logspace" in axis)


def test_points_are_shown_over_all_axes_that_are_drawn(tmp_path):
    file, _, rows = store_of(ROBOT + DRAWN, tmp_path / "study.sqlite")
    chart = surveyed(file).chart
    assert isinstance(chart, Points)
    (places,) = chart.places.values()
    yaws = sorted(np.degrees(json.loads(row["parameters"])["goal.orientation.rpy[2]"]) for row in rows)
    assert sorted(places[:, 2]) == pytest.approx(yaws)
    assert [pairs(k) for k in (1, 2, 3, 4)] == [[(0, 0)], [(0, 1)], [(0, 1), (2, 0)], [(0, 1), (2, 3)]]
    assert {place for pair in pairs(6) for place in pair} == set(range(6))


AXES = {
    "drawn": DRAWN,
    "one": "  axes:\n    solvers.jacobian.gamma: {logspace: [0.01, 1, 7]}\n",
    "one drawn": "  axes:\n    horizon: {uniform: [1, 2], samples: 9}\n",
    "words": "  axes:\n    control.basis: [fourier, legendre]\n    solvers.jacobian.inverse: [damped, transpose]\n",
    "few": "  axes:\n    horizon: [1, 2]\n",
    "nothing varies": "  axes:\n    horizon: [1]\n",
}


@pytest.mark.parametrize("axes", AXES)
def test_every_kind_of_axes_gives_a_page(tmp_path, axes):
    basis = "    control: {degree: 3, basis: legendre}\n" if axes == "words" else ""
    text = ROBOT.replace("    constraints", f"{basis}    constraints") + AXES[axes].replace("[fourier, ", "[")
    file, _, _ = store_of(text, tmp_path / "study.sqlite")
    made = render(surveyed(file))
    Page(made)
    assert ("nothing to chart" in made) == (axes == "nothing varies")
    assert not re.search(r"\b(nan|inf|None)\b", made)


@pytest.mark.parametrize("runs", [0, 1])
def test_a_study_that_hardly_began_gives_a_page(tmp_path, runs):
    def failed(row):
        return {**row, "outcome": "stagnated", "converged": 0}

    file, _, _ = store_of(ROBOT + TILTS + BOTH, tmp_path / "study.sqlite", failed, runs)
    made = render(surveyed(file))
    assert "No run was solved." in made
    assert f"{runs} of 120 runs: 0 solved" in " ".join(Page(made).words.split())


# --- the page ---------------------------------------------------------------------------------------------------------


def test_the_page_is_well_formed_and_needs_nothing_from_outside(page):
    parsed = Page(page)
    for _, attributes in parsed.tags:
        for name in ("src", "href", "srcset", "data", "action"):
            assert str(attributes.get(name, "#")).startswith(("#", "data:"))
    assert "http" not in page
    assert parsed.named("script") == []
    assert all("scope" in attributes for attributes in parsed.named("th"))
    assert all(len(svg["aria-label"]) > 20 for svg in parsed.named("svg"))
    titles = [
        "What was asked",
        "Over the axes",
        "Distributions",
        "Solvers against",
        "Failures",
        "Limits",
        "Files",
    ]
    places = [page.index(f">{title}") for title in titles]
    assert places == sorted(places)


def test_the_page_says_what_the_store_does(page, tilts):
    said = " ".join(Page(page).words.split())
    found, rows = tilts
    assert f"120 runs: {found.solved} solved and confirmed" in said
    first = next(row["run"] for row in rows if row["outcome"] == "infeasible")
    assert f"nhpocp solve --from {found.store} --run {first}" in said
    assert "60 points × 2 solvers" in said
    assert "It left no control to begin with." in said


def test_words_of_users_are_escaped(tmp_path):
    def evil(row):
        return {**row, "message": f"{SCRIPT} $x$."}

    text = f"{ROBOT}  axes:\n    control.basis: [fourier]\n  # {SCRIPT}\n"
    file, _, _ = store_of(text, tmp_path / "a $b$ <i>.sqlite", evil)
    made = render(surveyed(file))
    assert "<script" not in made
    assert made.count("&lt;script&gt;") == 1 + len(surveyed(file).failures)
    assert "a $b$ &lt;i&gt;.sqlite" in made
    Page(made)
    assert study_table(surveyed(file)).isascii()


def test_a_page_does_not_grow_with_the_runs(tmp_path):
    axes = "  axes:\n    goal.position[0]: {linspace: [-2, 2, 70]}\n    goal.position[1]: {linspace: [-2, 2, 70]}\n"
    file, _, rows = store_of(ROBOT + axes, tmp_path / "study.sqlite")
    assert len(rows) == 4900  # more than are shown one by one
    made = render(surveyed(file))
    assert len(made.encode()) < 800_000
    assert made.count("<tr") < 30


def test_the_page_passes_axe_and_asks_for_nothing(browser, tmp_path, page):
    file = tmp_path / "report.html"
    file.write_text(page, encoding="utf-8")
    tab = browser.new_page(viewport={"width": 1200, "height": 900})
    said, asked = [], []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(file.as_uri())
    assert axe_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert (said, [url for url in asked if not url.startswith("data:")]) == ([], [file.as_uri()])
    tab.close()


def test_the_table_has_a_row_a_solver(tilts):
    table = study_table(tilts[0])
    columns = re.search(r"\\begin\{tabular\}\{@\{\}([lr]+)@\{\}\}", table)
    lines = [text for text in table.splitlines() if text.endswith(r"\\")]
    assert len(lines) == 1 + len(tilts[0].solvers)
    assert {len(re.findall(r"(?<!\\)&", text)) + 1 for text in lines} == {len(columns[1])}
    assert "$s=" in lines[0]
    assert lines[1].startswith("Jacobian method & 60 & ")


# --- the files --------------------------------------------------------------------------------------------------------


def test_compare_writes_the_report_of_a_store_again(tmp_path):
    file, _, rows = store_of(ROBOT + AXES["few"], tmp_path / "study.sqlite")
    status, out, errors = ran("compare", "--from", file, "--json", cwd=tmp_path)
    solved = sum(row["converged"] for row in rows)
    assert (status, errors) == (int(solved < 2), "")
    assert json.loads(out) == {
        "store": str(file),
        "report": str(tmp_path / "report.html"),
        "runs": 2,
        "converged": solved,
        "failed": 2 - solved,
        "seconds": None,
    }
    out = ran("compare", "--from", file, "-o", "there", cwd=tmp_path)[1]
    assert out == f"2 of 2 runs: {solved} solved and verified\nreport: there/report.html\n"
    for name in ("report.html", "comparison.tex"):
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / name).read_bytes()
    status, _, errors = ran("compare", "--from", file, file, cwd=tmp_path)
    assert (status, "--from takes one study's store" in errors) == (2, True)


@pytest.mark.parametrize("name", ["report.html", "comparison.tex"])
def test_what_nhpocp_did_not_write_is_left_alone(tmp_path, name):
    file, _, _ = store_of(ROBOT + DRAWN, tmp_path / "study.sqlite", runs=0)
    (tmp_path / name).write_text("mine")
    with pytest.raises(InvalidProblemError, match="was not written by nhpocp"):
        write_report(file, tmp_path)
    assert (tmp_path / name).read_text() == "mine"


def full(*_):
    raise OSError(28, "No space left on device")


def stopped(*_):
    signal.raise_signal(signal.SIGINT)
    time.sleep(60)


@pytest.mark.parametrize(
    ("drawing", "why"), [(full, "No space left on device"), (stopped, "stopped by hand")]
)
def test_a_report_that_cannot_be_written_is_missing_and_said(tmp_path, monkeypatch, drawing, why):
    file, _, _ = store_of(ROBOT + AXES["few"], tmp_path / "study.sqlite")
    monkeypatch.setattr("nhpocp.views.study_report.write_study_report", drawing)
    monkeypatch.setattr("nhpocp.interruption.PATIENCE", 0.05)
    (tmp_path / "report.html").write_text('<meta name="generator" content="nhpocp sweep">')
    _, out, errors = ran("compare", "--from", file, "--json", cwd=tmp_path)
    assert json.loads(out)["report"] is None
    assert errors == (
        f"warning: the report could not be written ({why}); `nhpocp compare --from {file}` writes it\n"
    )
    assert not (tmp_path / "report.html").exists()


def test_levels_that_are_no_numbers_stand_in_a_row():
    assert list(Axis("a", ("x", [1, 2])).places()) == [0, 1]
    assert list(Axis("a", (0.0, np.pi / 6), degrees=True).places()) == pytest.approx([0, 30])
